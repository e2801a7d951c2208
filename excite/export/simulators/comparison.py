"""What changes in a robot's model, parameter by parameter, as a person reads it."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.units import unit_at
from excite.export.simulators.subject import JOINT_TERMS, Subject
from excite.identification.inertia import central_inertia_matrices

_BODY = (
    ("mass", "kg"),
    *((f"com_{axis}", "m") for axis in "xyz"),
    *((f"I{axes}", "kg·m²") for axes in ("xx", "yy", "zz", "xy", "xz", "yz")),
)
_UPPER = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])
_COLUMNS = ("place", "parameter", "unit", "before", "after", "change")


@dataclass(frozen=True)
class Change:
    """One parameter before and after [SI].

    Attributes:
        place: link or joint.
        parameter: ``mass``, ``com_x`` … (of the link, in its joint's frame), ``Ixx`` … about the centre of mass, or a
            joint's ``viscous``, ``coulomb``, ``armature``.
        unit: its unit.
        before: of the nominal model.
        after: as found; equal to ``before`` where it was not.
    """

    place: str
    parameter: str
    unit: str
    before: float
    after: float

    @property
    def change(self) -> float:
        """After minus before."""
        return self.after - self.before

    @property
    def percent(self) -> float | None:
        """The change in per cent of what was before; None where that was zero."""
        return 100.0 * self.change / abs(self.before) if self.before else None

    def to_json(self) -> dict[str, Any]:
        """Its entry in a document."""
        values = {name: getattr(self, name) for name in _COLUMNS}
        return values | {"percent": self.percent}


def list_changes(subject: Subject) -> tuple[Change, ...]:
    """All parameters of bodies and joints, before and after."""
    before = _body_values(subject.found.identified.nominal)
    after = _body_values(subject.parameters)
    rows = [
        Change(segment.link, name, unit, float(before[k, j]), float(after[k, j]))
        for k, segment in enumerate(subject.robot.segments)
        for j, (name, unit) in enumerate(_BODY)
    ]
    for term, unit in JOINT_TERMS.items():
        declared, found = getattr(subject.declared, term), subject.term(term)
        rows += [
            Change(joint, term, unit_at(subject.robot, joint, unit), float(old), float(new))
            for joint, old, new in zip(subject.robot.joint_names, declared, found, strict=True)
            if np.isfinite(new)
        ]
    return tuple(rows)


def changes_csv(rows: tuple[Change, ...]) -> str:
    """The rows, comma-separated, numbers with all digits."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for row in rows:
        writer.writerow(
            [row.place, row.parameter, row.unit, repr(row.before), repr(row.after), repr(row.change)]
        )
    return stream.getvalue()


def _body_values(parameters: Array) -> Array:
    """Mass, centre of mass and central inertia of each segment, ``(n, 10)``; zeros without mass."""
    ten = parameters.reshape(-1, 10)
    rows = np.zeros((len(ten), 10))
    rows[:, 0] = ten[:, 0]
    heavy = ten[:, 0] > 0.0
    rows[heavy, 1:4] = ten[heavy, 1:4] / ten[heavy, :1]
    rows[heavy, 4:] = central_inertia_matrices(parameters)[heavy][:, _UPPER[0], _UPPER[1]]
    return rows
