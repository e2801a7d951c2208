"""What the columns of a laboratory's table are, by their names: time, markers, and what plates measured."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

_TIMES = {"time", "t", "times", "timestamp", "seconds", "sec"}
_UNIT = re.compile(r"\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))\s*$")
# To metres, newtons, newton metres and seconds.
_FACTORS = {
    "mm": 1e-3,
    "cm": 1e-2,
    "nmm": 1e-3,
    "n·mm": 1e-3,
    "n.mm": 1e-3,
    "n*mm": 1e-3,
    "kn": 1e3,
    "ms": 1e-3,
}
_BETWEEN = r"[\s._:\-]*"
_MARKER = re.compile(r"(?P<stem>.+?)(?P<between>[\s._:\-]*)(?P<axis>[xyzXYZ])")
# FP1_Fx, plate.left.fx, Fx1, Force Plate 2 - COPy, ground_force_r_px.
_PLATE = re.compile(
    rf"(?P<stem>.*?)(?<![a-z])(?P<kind>force|moment|torque|cop|f|m|t|p)[ _]?(?P<axis>[xyz])(?P<tail>{_BETWEEN}\d*)",
    re.IGNORECASE,
)
_KINDS = {"force": "f", "moment": "m", "torque": "t", "cop": "p"}


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes:
        label: as it stands in the file.
        factor: to SI, by the unit in brackets behind its name; 1 without one.
    """

    label: str
    factor: float


@dataclass(frozen=True)
class Plate:
    """Columns of one plate by kind and axis, ``fx … fz``; ``mx`` moments, ``tx`` torques, ``px`` centre of pressure."""

    name: str
    columns: dict[str, Column] = field(default_factory=dict)

    def has(self, kind: str) -> bool:
        """Whether all three components of a kind are there."""
        return all(kind + axis in self.columns for axis in "xyz")


@dataclass(frozen=True)
class Columns:
    """A table's columns.

    Attributes:
        time: None where no column is called so.
        markers: x, y and z by label of the marker; less than three where the file lacks one.
        plates: those of which there are forces.
    """

    time: Column | None
    markers: dict[str, dict[str, Column]]
    plates: tuple[Plate, ...]


def columns_of(labels: Sequence[str]) -> Columns:
    """What the columns are.

    Markers end in an axis, ``RSHO.x``, ``RSHO_X``, ``RSHO X (mm)``; forces, moments and centres of pressure of a
    plate share what stands before and behind: ``FP1_Fx``, ``FP1_Mx``, ``FP1_COPx`` or ``Fx1``, ``Mx1``.
    """
    time = next((column for name, column in map(_parse_label, labels) if name.lower() in _TIMES), None)
    plates: dict[str, Plate] = {}
    for label in labels:
        name, column = _parse_label(label)
        found = _PLATE.fullmatch(name)
        if found:
            kind = found["kind"].lower()
            whose = (found["stem"] + found["tail"]).strip(" ._:-")
            key = _KINDS.get(kind, kind) + found["axis"].lower()
            plates.setdefault(whose, Plate(_plate_name(whose))).columns[key] = column
    plates = {whose: plate for whose, plate in plates.items() if plate.has("f")}
    taken = {column.label for plate in plates.values() for column in plate.columns.values()}
    markers: dict[str, dict[str, Column]] = {}
    for label in labels:
        name, column = _parse_label(label)
        found = _MARKER.fullmatch(name)
        if found and label not in taken and column != time:
            markers.setdefault(found["stem"].strip(), {})[found["axis"].lower()] = column
    # A name that happens to end in x is no marker; one with a dot says that it is.
    markers = {stem: axes for stem, axes in markers.items() if len(axes) == 3 or f"{stem}.x" in labels}
    return Columns(time, markers, tuple(plates.values()))


def _parse_label(label: str) -> tuple[str, Column]:
    unit = _UNIT.search(label)
    if unit is None:
        return label, Column(label, 1.0)
    said = (unit[1] or unit[2] or "").strip().lower()
    return label[: unit.start()].strip(), Column(label, _FACTORS.get(said, 1.0))


def _plate_name(whose: str) -> str:
    return re.sub(r"^plate\.", "", whose) or "plate"
