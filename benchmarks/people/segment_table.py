"""The table of segment masses: both tables beside what was identified, as table IV of Jovic et al., T-RO 2016."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.errors import InputError
from excite.human.body import ANTHROPOMETRY, Body
from excite.human.segments import NAMES
from excite.identification.result import Identification

STATED = "stated"
"""Column of nominal masses that are no table's."""


@dataclass(frozen=True)
class SegmentMass:
    """One row.

    Attributes:
        segment: segment.
        nominal: mass by table, and as ``stated`` where the model's own is no table's [kg].
        identified: [kg].
        std: standard deviation from data and nominal model together [kg], None where it was not computed.
        determined: share of what is known of the mass that comes from the data, 0 to 1, None likewise.
    """

    segment: str
    nominal: Mapping[str, float]
    identified: float
    std: float | None
    determined: float | None


@dataclass(frozen=True)
class SegmentTable:
    """All rows, in the order of the segments."""

    rows: tuple[SegmentMass, ...]

    def summary(self) -> str:
        """The table in words, for a terminal."""
        tables = list(self.rows[0].nominal)
        lines = ["segment masses [kg]:"]
        lines.append(f"  {'segment':16}" + "".join(f"{name:>10}" for name in tables) + f"{'identified':>20}")
        for row in (*self.rows, self.total):
            std = "" if row.std is None else f" ± {row.std:.2f}"
            lines.append(
                f"  {row.segment:16}"
                + "".join(f"{row.nominal[name]:10.2f}" for name in tables)
                + f"{f'{row.identified:.2f}{std}':>20}"
            )
        return "\n".join(lines)

    @property
    def total(self) -> SegmentMass:
        """The sums."""
        nominal = {name: sum(row.nominal[name] for row in self.rows) for name in self.rows[0].nominal}
        return SegmentMass("total", nominal, sum(row.identified for row in self.rows), None, None)

    def csv(self) -> str:
        """The table as comma-separated values, masses in kilograms."""
        tables = list(self.rows[0].nominal)
        lines = [",".join(["segment", *(f"{name}_kg" for name in tables), "identified_kg", "std_kg"])]
        for row in self.rows:
            std = "" if row.std is None else f"{row.std:.6g}"
            values = [f"{row.nominal[name]:.6g}" for name in tables]
            lines.append(",".join([row.segment, *values, f"{row.identified:.6g}", std]))
        return "\n".join(lines) + "\n"


def segment_table(body: Body, result: Identification) -> SegmentTable:
    """Table of a person's segment masses.

    Args:
        body: the person as measured.
        result: what was identified of the person's model.

    Raises:
        InputError: the result is of another robot.
    """
    ten = _rows_of(result.parameters, result)
    uncertainty = result.uncertainty
    std = None if uncertainty is None else _rows_of(uncertainty.std[: len(result.parameters)], result)
    known = (
        None if uncertainty is None else _rows_of(uncertainty.determined[: len(result.parameters)], result)
    )
    tables = {name: body.with_table(name).inertias for name in ANTHROPOMETRY}  # type: ignore[arg-type]
    own = np.array([inertia.mass for inertia in body.inertias])
    if not any(np.allclose(own, [inertia.mass for inertia in table]) for table in tables.values()):
        tables[STATED] = body.inertias
    return SegmentTable(
        tuple(
            SegmentMass(
                segment=name,
                nominal={table: inertias[k].mass for table, inertias in tables.items()},
                identified=float(ten[k, 0]),
                std=None if std is None else float(std[k, 0]),
                determined=None if known is None else float(known[k, 0]),
            )
            for k, name in enumerate(NAMES)
        )
    )


def _rows_of(values: Array, result: Identification) -> Array:
    missing = [name for name in NAMES if name not in result.links]
    if missing:
        raise InputError(
            f"has no segment {missing[0]!r}", source=result.robot, remedy="identify the person's own model"
        )
    ten = np.asarray(values).reshape(-1, 10)
    return ten[[result.links.index(name) for name in NAMES]]
