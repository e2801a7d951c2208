"""What a motion laboratory records: marker positions and force plates, in metres and newtons, axes as in the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.finding import Finding, list_names
from excite.human.markers.marker_set import MarkerSet, bare_label
from excite.human.segments import Subject


@dataclass(frozen=True, eq=False)
class PlateRecording:
    """What one force plate (or one foot, where the file has separated them) measured.

    Attributes:
        name: of the plate.
        time: ``(k,)`` [s].
        force: on the person, ``(k, 3)`` [N].
        moment: on the person about the file's origin, ``(k, 3)`` [N·m].
        corners: of its surface, ``(4, 3)`` [m]; None where the file does not say where the plate is.
        foot: ``right`` or ``left`` where the file says whose force it is.
    """

    name: str
    time: Array
    force: Array
    moment: Array
    corners: Array | None = None
    foot: str | None = None


@dataclass(frozen=True, eq=False)
class Recording:
    """One trial.

    Attributes:
        source: file with the markers.
        time: of the markers' frames ``(n,)`` [s].
        markers: by label, ``(n, 3)`` [m], NaN where a marker is missing.
        plates: force plates, empty where the file has none.
        findings: what was odd and what was done about it.
    """

    source: Path
    time: Array
    markers: Mapping[str, Array]
    plates: tuple[PlateRecording, ...] = ()
    findings: tuple[Finding, ...] = field(default=())

    @property
    def rate_hz(self) -> float:
        """Rate of the markers [Hz]."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])

    def turn_axes(self, rotation: Array) -> Recording:
        """The recording in other axes: ``x ↦ rotation @ x``."""
        plates = tuple(
            replace(
                plate,
                force=plate.force @ rotation.T,
                moment=plate.moment @ rotation.T,
                corners=None if plate.corners is None else plate.corners @ rotation.T,
            )
            for plate in self.plates
        )
        markers = {label: values @ rotation.T for label, values in self.markers.items()}
        return replace(self, markers=markers, plates=plates)

    def build_finding(
        self, kind: str, text: str, values: Mapping[str, float], channels: Sequence[str]
    ) -> Finding:
        """A finding of the file, which its text names."""
        return Finding(kind, f"{self.source.name}: {text}", values, tuple(channels))

    def with_findings(self, *findings: Finding) -> Recording:
        """The recording with more findings."""
        return replace(self, findings=(*self.findings, *findings))


# From a laboratory's axes and units to a world with z up, in metres; and what is wrong with a file named.

_UP = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "x": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
}
AXES = tuple(_UP)
"""Axes of a laboratory, one of which points up."""
_UNITS = {1e-3: "millimetres", 1e-2: "centimetres", 1e3: "metres", 1e2: "metres"}
_SEEN_TOO_SELDOM = 0.1


def with_known_labels(recording: Recording, markers: MarkerSet) -> Recording:
    """The recording with the set's labels only, and findings on those that are missing or unknown.

    Raises:
        LogError: no marker of the set is in the file, or markers of several people are.
    """
    people = sorted({label.rsplit(":", 1)[0] for label in recording.markers if ":" in label})
    bare = [bare_label(label) for label in recording.markers]
    known = {
        name: values
        for name, values in zip(bare, recording.markers.values(), strict=True)
        if name in markers.sites
    }
    if len(people) > 1 and sum(name in known for name in bare) > len(known):
        raise LogError(
            f"holds the markers of {len(people)} people: {list_names(people)}",
            source=recording.source,
            remedy="export one person's markers at a time",
        )
    if not known:
        raise LogError(
            f"has none of the markers of set {markers.name!r}",
            source=recording.source,
            remedy="give the right set or a mapping file with --markers",
        )
    found = replace(recording, markers=known)
    unknown = sorted(set(bare) - known.keys())
    if not unknown:
        return found
    text = f"{len(unknown)} labels are not in marker set {markers.name!r}: {list_names(unknown)}"
    return found.with_findings(
        found.build_finding("unknown_markers", text, {"markers": float(len(unknown))}, unknown)
    )


def absent_markers(recording: Recording, wanted: tuple[str, ...]) -> tuple[Finding, ...]:
    """Findings on markers that are not in a file, or hardly ever seen."""
    share = {
        label: float(np.isfinite(values).all(axis=1).mean()) for label, values in recording.markers.items()
    }
    absent = [label for label in wanted if label not in share]
    rare = [label for label in share if share[label] < _SEEN_TOO_SELDOM]
    gaps = [label for label in share if _SEEN_TOO_SELDOM <= share[label] < 1.0]
    found = [
        recording.build_finding(
            "missing_markers", f"{text}: {list_names(labels, 12)}", {"markers": float(len(labels))}, labels
        )
        for text, labels in (
            ("markers missing from the file", absent),
            ("markers seen in fewer than a tenth of the frames", rare),
        )
        if labels
    ]
    if gaps:
        worst = min(gaps, key=share.__getitem__)
        left = 1.0 - share[worst]
        text = f"{len(gaps)} markers have gaps, most of all {worst} ({100 * left:.1f} % of frames)"
        found.append(recording.build_finding("gaps", text, {"worst_share": left}, gaps))
    return tuple(found)


def in_metres(recording: Recording, subject: Subject) -> Recording:
    """The recording in metres, judged by the body's size; a wrong unit is put right and named.

    The largest distance between two markers in a frame is some 0.4 to 1.4 of the stature.

    Raises:
        LogError: no marker is ever seen, or the size fits no unit of length.
    """
    points = np.stack(list(recording.markers.values()), axis=1)
    if not np.isfinite(points).all(axis=2).any():
        raise LogError(
            "no marker is seen in any frame",
            source=recording.source,
            field="markers",
            remedy="export the markers again, with their positions",
        )
    extent = np.nanmedian(np.nanmax(points, axis=1) - np.nanmin(points, axis=1), axis=0).max()
    share = float(extent) / subject.height
    if 0.3 < share < 1.6:
        return recording
    said = f"markers span {extent:.4g} m on a person of {subject.height:.2f} m"
    for factor, unit in _UNITS.items():
        if 0.3 < share * factor < 1.6:
            text = f"{said}: they are {unit} while the file says otherwise; converted"
            markers = {label: values * factor for label, values in recording.markers.items()}
            values = {"span": float(extent), "factor": factor}
            return replace(recording, markers=markers).with_findings(
                recording.build_finding("units", text, values, ["markers"])
            )
    raise LogError(
        said,
        source=recording.source,
        field="units",
        remedy="state the unit that the file is in, or the right height",
    )


def up_axis(recording: Recording, markers: MarkerSet) -> str:
    """Which axis points up: ``x``, ``y`` or ``z``, from feet to trunk.

    Raises:
        LogError: the person does not stand along an axis, or upside down.
    """
    high = _marker_middle(recording, markers, lambda segment: segment in ("torso", "head", "pelvis"))
    low = _marker_middle(recording, markers, lambda segment: segment.endswith(("foot", "shank")))
    direction = high - low
    axis = int(np.argmax(np.abs(direction)))
    if not np.isfinite(direction).all() or direction[axis] < 0.7 * float(np.linalg.norm(direction)):
        raise LogError(
            f"trunk lies {np.round(direction, 2).tolist()} m from the feet",
            source=recording.source,
            field="axes",
            remedy="say which axis points up with --up, and check the marker set",
        )
    return "xyz"[axis]


def _marker_middle(recording: Recording, markers: MarkerSet, chosen: Callable[[str], bool]) -> Array:
    values = [v for label, v in recording.markers.items() if chosen(markers.sites[label].segment)]
    if not values:
        return np.full(3, np.nan)
    return np.median([np.nanmedian(v, axis=0) for v in values], axis=0)


def turn_z_up(recording: Recording, axis: str) -> Recording:
    """The recording turned so that ``axis`` becomes z."""
    return recording.turn_axes(_UP[axis])
