"""Tables of published numbers beside ours."""

from __future__ import annotations

from dataclasses import dataclass

Number = float | int | str | None


@dataclass(frozen=True)
class Line:
    """One number of a table.

    Attributes:
        what: what it is of.
        paper: the published number, None where there is none.
        ours: ours.
        met: whether ours is good enough; None for a number without a bar.
        bar: the bar, in words.
    """

    what: str
    paper: Number
    ours: Number
    met: bool | None = None
    bar: str = ""

    @property
    def difference(self) -> float | None:
        """Ours minus the paper's, None unless both are numbers."""
        if isinstance(self.paper, str | None) or isinstance(self.ours, str | None):
            return None
        return self.ours - self.paper


@dataclass(frozen=True)
class Table:
    """A table of a paper.

    Attributes:
        title: paper and table.
        lines: its numbers.
        note: how ours were found, and what cannot agree.
        digits: significant digits that are printed.
    """

    title: str
    lines: tuple[Line, ...]
    note: str = ""
    digits: int = 4

    @property
    def missed(self) -> tuple[Line, ...]:
        """Lines that miss their bar."""
        return tuple(line for line in self.lines if line.met is False)

    def markdown(self) -> str:
        """The table for a terminal or a README."""
        rows = ["", f"### {self.title}", ""]
        if self.note:
            rows += [self.note, ""]
        barred = any(line.met is not None for line in self.lines)
        rows.append("| | paper | ours | difference |" + (" bar | |" if barred else ""))
        rows.append("| --- | ---: | ---: | ---: |" + (" --- | --- |" if barred else ""))
        marks = {True: "✓", False: "✗", None: ""}
        for line in self.lines:
            cells = [self._text(line.paper), self._text(line.ours), self._text(line.difference, sign="+")]
            row = f"| {line.what} | " + " | ".join(cells) + " |"
            rows.append(row + (f" {line.bar} | {marks[line.met]} |" if barred else ""))
        return "\n".join(rows)

    def _text(self, value: Number, sign: str = "") -> str:
        if value is None:
            return ""
        if isinstance(value, str):
            return value
        if isinstance(value, int):
            return f"{value:{sign}d}"
        return f"{value:{sign}.{self.digits}g}"
