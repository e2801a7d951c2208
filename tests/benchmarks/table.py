"""Rows of the table of figures: what was asked for, what was reached, and whether that is enough."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """One figure.

    Attributes:
        what: what was measured.
        bar: what was asked for, as text.
        reached: what was found, as text.
        met: whether it is enough; None for a figure without a bar.
    """

    what: str
    bar: str
    reached: str
    met: bool | None

    @classmethod
    def at_most(cls, what: str, value: float, limit: float, unit: str = "", digits: int = 3) -> Row:
        """A figure that must not exceed ``limit``."""
        return cls(
            what, f"≤ {limit:g} {unit}".strip(), f"{value:.{digits}g} {unit}".strip(), bool(value <= limit)
        )

    @classmethod
    def at_least(cls, what: str, value: float, limit: float, unit: str = "", digits: int = 3) -> Row:
        """A figure that must reach ``limit``."""
        return cls(
            what, f"≥ {limit:g} {unit}".strip(), f"{value:.{digits}g} {unit}".strip(), bool(value >= limit)
        )

    @classmethod
    def holds(cls, what: str, bar: str, reached: str, met: bool) -> Row:
        """A statement that must be true."""
        return cls(what, bar, reached, bool(met))


def markdown(rows: list[Row]) -> str:
    """The rows as a table for the README."""
    lines = ["| what | asked | reached | |", "| --- | --- | --- | --- |"]
    marks = {True: "✓", False: "✗", None: ""}
    lines += [f"| {row.what} | {row.bar} | {row.reached} | {marks[row.met]} |" for row in rows]
    return "\n".join(lines)
