"""Which marker sits where: marker sets and the mapping files that describe others."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.errors import InputError, UnknownNameError
from excite.finding import list_names
from excite.formats.documents import read_yaml
from excite.human.body import DUMAS_PELVIS, Dimensions, joint_offsets
from excite.human.segments import NAMES, SIDES, Subject

# Where bony landmarks lie on the segments: first guesses, which calibration refines.

_HERE = Path(__file__).parent


class Landmark(NamedTuple):
    """A landmark of one side (of the right one, y counted outwards) or of the middle, as ``landmarks.yaml`` has it."""

    kind: str
    anchor: str | None
    place: tuple[float, float, float]


_LANDMARKS = {
    group: {name: Landmark(*row) for name, row in rows.items()}
    for group, rows in read_yaml(_HERE / "landmarks.yaml").items()
}
LANDMARKS: tuple[str, ...] = (
    *_LANDMARKS["middle"],
    *(f"{side}_{name}" for side in SIDES for name in _LANDMARKS["sided"]),
)


def landmark_segment(name: str) -> str:
    """The segment that carries a landmark; raises UnknownNameError."""
    landmark, side = _find_landmark(name)
    return _of_side(landmark.kind, side)


def landmark_place(name: str, subject: Subject, dimensions: Dimensions) -> Array:
    """Where a landmark lies in its segment's frame, ``(3,)`` [m]; raises UnknownNameError."""
    landmark, side = _find_landmark(name)
    outward = -1.0 if side == "right" else 1.0
    if name.endswith("asis"):
        # Dumas' pelvis in units of the distance of the hips, which is what the dimensions hold.
        x, y, z = DUMAS_PELVIS[subject.sex].hip
        return dimensions["hip_half_width"] / z * np.array([-x, 50.0 * outward, -y])
    # Stature that the places of the landmarks are of [m].
    place = np.array(landmark.place) * [1.0, outward, 1.0] * subject.height / 1.77
    if landmark.anchor is not None:
        place += joint_offsets()[NAMES.index(_of_side(landmark.anchor, side))] @ dimensions.values
    return place


def _of_side(kind: str, side: str | None) -> str:
    return kind if side is None or kind in NAMES else f"{side}_{kind}"


def _find_landmark(name: str) -> tuple[Landmark, str | None]:
    side, _, rest = name.partition("_")
    if side in SIDES and rest in _LANDMARKS["sided"]:
        return _LANDMARKS["sided"][rest], side
    if name in _LANDMARKS["middle"]:
        return _LANDMARKS["middle"][name], None
    raise UnknownNameError("landmark", name, list(LANDMARKS))


SCHEMA = "excite.markers/1"
MARKER_SETS = {path.stem: path for path in sorted((_HERE / "sets").glob("*.yaml"))}
"""Sets that come with excite: mapping files as users write them."""


@dataclass(frozen=True)
class MarkerSite:
    """Where a marker sits.

    Attributes:
        segment: segment that carries it.
        landmark: bony landmark under it, None for a marker whose place only calibration finds.
    """

    segment: str
    landmark: str | None = None


@dataclass(frozen=True, eq=False)
class MarkerSet:
    """Markers by label.

    Attributes:
        name: of the set.
        sites: by label.
    """

    name: str
    sites: Mapping[str, MarkerSite]


def bare_label(label: str) -> str:
    """A label without the subject's name that capture programs put before a colon."""
    return label.rsplit(":", 1)[-1].strip()


def find_marker_set(labels: Iterable[str]) -> MarkerSet:
    """The set that most labels of a file belong to.

    Raises:
        InputError: no set has half of its markers in the file; a mapping file is needed.
    """
    present = {bare_label(label) for label in labels}
    best = max(map(read_marker_set, MARKER_SETS), key=lambda item: len(present & item.sites.keys()))
    found = len(present & best.sites.keys())
    if found < max(10, 0.5 * min(len(best.sites), len(present))):
        raise InputError(
            f"labels fit no known marker set ({best.name} has {found} of them): {list_names(sorted(present), 4)}",
            field="markers",
            remedy="give a mapping file with --markers: schema: excite.markers/1, markers:, and a line a label, "
            "{landmark: right_acromion} or {segment: right_thigh} behind it",
        )
    return best


def read_marker_set(name_or_path: str | Path) -> MarkerSet:
    """A marker set by name, or from a mapping file.

    The file is YAML: ``schema: excite.markers/1``, ``markers:`` and below it one line a label,
    ``RASI: {landmark: right_asis}`` or ``RTH1: {segment: right_thigh}``.

    Raises:
        InputError: the file is missing or malformed, or names no segment or landmark.
    """
    name = str(name_or_path)
    path = MARKER_SETS.get(name, Path(name_or_path))
    # Not Path.is_file, which raises for names that no file can have.
    if not os.path.isfile(path):
        raise UnknownNameError("marker set (or mapping file)", name[:200], list(MARKER_SETS))
    content = read_yaml(path)
    entries = content.get("markers")
    stated = content.get("schema") == SCHEMA
    if not stated or not isinstance(entries, dict) or not entries:
        raise InputError(
            "lists no markers" if stated else "is no mapping file",
            source=path,
            field="markers" if stated else "schema",
            remedy="map label to landmark or segment" if stated else f"begin with schema: {SCHEMA}",
        )
    return MarkerSet(
        path.stem, {str(label): _read_site(entry, str(label), path) for label, entry in entries.items()}
    )


def _read_site(entry: object, label: str, path: Path) -> MarkerSite:
    field = f"markers.{label}"
    if not isinstance(entry, dict) or not entry.keys() <= {"segment", "landmark"} or not entry:
        raise InputError(
            f"is {str(entry)[:60]!r}", source=path, field=field, remedy="write {landmark: …} or {segment: …}"
        )
    for kind, known in (("landmark", LANDMARKS), ("segment", NAMES)):
        given = entry.get(kind)
        if given is not None and str(given) not in known:
            raise InputError(
                f"no {kind} {str(given)[:60]!r}",
                source=path,
                field=field,
                remedy="choose one of " + ", ".join(known),
            )
    landmark, segment = (
        None if entry.get(kind) is None else str(entry[kind]) for kind in ("landmark", "segment")
    )
    return MarkerSite(segment or landmark_segment(str(landmark)), landmark)
