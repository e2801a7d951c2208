"""Tables of published numbers beside ours."""

from __future__ import annotations

from collections.abc import Sequence
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
        reason: why the bar is known to be missed; such a line does not fail the command.
    """

    what: str
    paper: Number
    ours: Number
    met: bool | None = None
    bar: str = ""
    reason: str = ""

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
        """Lines that miss their bar, and nobody knows why."""
        return tuple(line for line in self.lines if line.met is False and not line.reason)

    @property
    def known(self) -> tuple[Line, ...]:
        """Lines that are known to miss their bar."""
        return tuple(line for line in self.lines if line.met is False and line.reason)

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
            mark = f"known: {line.reason}" if line.met is False and line.reason else marks[line.met]
            rows.append(row + (f" {line.bar} | {mark} |" if barred else ""))
        return "\n".join(rows)

    def summary_row(self) -> str:
        """A row of :func:`summary`."""
        met = sum(line.met is True for line in self.lines)
        counts = f"{met} | {len(self.known)} | {len(self.missed)}"
        return f"| {self.title} | {len(self.lines)} | {counts} |"

    def _text(self, value: Number, sign: str = "") -> str:
        if value is None:
            return ""
        if isinstance(value, str):
            return value
        if isinstance(value, int):
            return f"{value:{sign}d}"
        return f"{value:{sign}.{self.digits}g}"


def summary(tables: Sequence[Table]) -> str:
    """How many bars all tables meet, and each line that misses one, with its reason where it is known."""
    rows = ["", "### Summary", "", "| | numbers | bars met | known to be missed | missed |"]
    rows += ["| --- | ---: | ---: | ---: | ---: |", *(table.summary_row() for table in tables)]
    lines = [line for table in tables for line in table.lines]
    met = sum(line.met is True for line in lines)
    missed = [(table, line) for table in tables for line in table.missed]
    known = [(table, line) for table in tables for line in table.known]
    counts = f"{met} | {len(known)} | {len(missed)}"
    rows.append(f"| **together** | {len(lines)} | {counts} |")
    rows += [f"- known: {table.title}: {line.what}: {line.reason}" for table, line in known]
    rows += [f"- missed: {table.title}: {line.what}: {line.ours} ({line.bar})" for table, line in missed]
    return "\n".join(rows)
