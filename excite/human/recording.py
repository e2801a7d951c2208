"""What a motion laboratory records: marker positions and force plates, in metres and newtons, axes as in the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from excite.arrays import Array
from excite.finding import Finding


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

    def turned(self, rotation: Array) -> Recording:
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

    def noting(self, *findings: Finding) -> Recording:
        """The recording with more findings."""
        return replace(self, findings=(*self.findings, *findings))
