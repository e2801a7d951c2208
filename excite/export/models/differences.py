"""What identification changed, parameter by parameter, with uncertainties."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from excite.atomic import write_text

_NAMES = {
    "mass": ("m",),
    "first_moment": ("mx", "my", "mz"),
    "inertia": ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"),
}
_UNITS = {"mass": "kg", "first_moment": "kg·m", "inertia": "kg·m²"}
_CLEAR = 2.0
_MEASURED = 0.5
_COLUMNS = ("link", "parameter", "unit", "nominal", "identified", "change", "std", "determined", "clear")


@dataclass(frozen=True)
class Difference:
    """One parameter, nominal and identified [SI], about the joint frame.

    Attributes:
        link: link of its segment.
        segment: readable name of the segment.
        parameter: ``m``, ``mx`` … ``Iyz``.
        unit: its unit.
        nominal: value of the model as supplied.
        identified: value found.
        std: standard deviation of the identified value given data and nominal model; None where not known.
        determined: share of the nominal model's uncertainty that the data have removed, 0 to 1; None likewise.
    """

    link: str
    segment: str
    parameter: str
    unit: str
    nominal: float
    identified: float
    std: float | None
    determined: float | None

    @property
    def change(self) -> float:
        """Identified minus nominal."""
        return self.identified - self.nominal

    @property
    def clear(self) -> bool:
        """Whether the data determined it (by more than half) and it moved by more than two deviations."""
        measured = self.determined is not None and self.determined > _MEASURED
        return measured and self.std is not None and abs(self.change) > _CLEAR * self.std


@dataclass(frozen=True)
class Differences:
    """The table nominal → identified.

    Attributes:
        rows: ten a segment, in the model's order.
    """

    rows: tuple[Difference, ...]

    def summary(self) -> str:
        """Masses of all links and the parameters that clearly changed, for a terminal."""
        shown = [row for row in self.rows if row.parameter == "m" or row.clear]
        width = max([len(row.link) for row in shown] + [len("link")])
        lines = [f"{'link':{width}}  parameter    nominal  identified     change         ±  from data"]
        for row in shown:
            share = "–" if row.determined is None else f"{100.0 * row.determined:.0f} %"
            std = "–" if row.std is None else f"{row.std:.2g}"
            lines.append(
                f"{row.link:{width}}  {row.parameter:9}  {row.nominal:9.4g}  {row.identified:10.4g}  "
                f"{row.change:+9.3g}  {std:>8}  {share:>9}{'  clear' if row.clear else ''}"
            )
        return "\n".join(lines)

    def to_csv(self) -> str:
        """All rows, comma-separated, numbers with all digits [SI]."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(_COLUMNS)
        for row in self.rows:
            std, share = ("" if value is None else repr(value) for value in (row.std, row.determined))
            values = [repr(row.nominal), repr(row.identified), repr(row.change), std, share]
            writer.writerow([row.link, row.parameter, row.unit, *values, int(row.clear)])
        return stream.getvalue()

    def save(self, path: Path) -> Path:
        """Write the CSV file."""
        return write_text(path, self.to_csv())


def find_differences(standard_parameters: Mapping[str, Mapping[str, Any]]) -> Differences:
    """The table of an identification.

    Args:
        standard_parameters: that block of an ``excite.identification/1`` document; links without nominal
            values in it are left out.
    """
    rows = []
    for link, block in standard_parameters.items():
        nominal, std, determined = (block.get(key) or {} for key in ("nominal", "std", "determined"))
        for kind, names in _NAMES.items():
            for k, name in enumerate(names):
                values = [_value_at(source.get(kind), k) for source in (nominal, block, std, determined)]
                if values[0] is None or values[1] is None:
                    continue
                segment = str(block.get("name") or link)
                rows.append(
                    Difference(link, segment, name, _UNITS[kind], values[0], values[1], values[2], values[3])
                )
    return Differences(tuple(rows))


def _value_at(source: Any, index: int) -> float | None:
    if isinstance(source, list):
        source = source[index] if index < len(source) else None
    return None if source is None else float(source)
