"""What came of a recording: the log, what was guessed to make it, and what the doctor finds in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from excite.doctor.examine import Chart
from excite.logs.log import Log
from excite.shown import Row, Tabled, count

SCHEMA = "excite.convert/1"
# Columns without a use that are named in a summary.
_SHOWN = 8


@dataclass(frozen=True, eq=False, repr=False)
class Conversion(Tabled):
    """What came of a recording.

    Attributes:
        folder: the log folder.
        log: its content as read again.
        columns: by channel, the column that it comes from and its factor to SI.
        guesses: what was guessed: channel, source, reason.
        trials: name, role and reason of each trial.
        notes: what was done to the rows, a sentence each.
        chart: what the doctor finds in it; None where it could not be examined.
        unused: columns that nothing was made of.
    """

    folder: Path
    log: Log
    columns: dict[str, tuple[str, float]]
    guesses: tuple[tuple[str, str, str], ...]
    trials: tuple[tuple[str, str, str], ...]
    notes: tuple[str, ...]
    chart: Chart | None
    unused: tuple[str, ...]

    tables = ("guessed", "trials", "columns", "findings")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.shown.Tabled`: what was guessed, trials, columns, what the doctor finds."""
        if table == "guessed":
            return [{"what": w, "source": s, "because": b} for w, s, b in self.guesses]
        if table == "trials":
            return [{"trial": n, "role": r, "because": b} for n, r, b in self.trials]
        if table == "columns":
            return [{"channel": t, "column": c, "factor": f} for t, (c, f) in self.columns.items()]
        return [] if self.chart is None else self.chart.rows(table)

    def summary(self) -> str:
        """What was made of the recording, a line each."""
        trials = self.log.trials
        seconds = sum(float(trial.time[-1] - trial.time[0]) for trial in trials)
        joints = count(len(self.log.header.joints), "joint")
        lines = [f"{count(len(trials), 'trial')} of {joints}, {seconds:.0f} s"]
        lines += [f"note: {note}" for note in self.notes]
        if self.unused:
            shown = ", ".join(self.unused[:_SHOWN]) + (" …" if len(self.unused) > _SHOWN else "")
            lines.append(f"note: nothing was made of {shown}")
        if self.chart is not None:
            lines += ["", self.chart.summary(), ""]
        lines.append(
            f"wrote {self.folder}; map.yaml in it repeats this without guessing: correct it and use --map"
        )
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """The document ``excite.convert/1``."""
        return {
            "schema": SCHEMA,
            "log": str(self.folder),
            "joints": list(self.log.header.joints),
            "columns": {target: {"column": c, "factor": f} for target, (c, f) in self.columns.items()},
            "guessed": self.rows("guessed"),
            "trials": self.rows("trials"),
            "notes": list(self.notes),
            "unused": list(self.unused),
            "findings": [] if self.chart is None else [f.to_json() for f in self.chart.findings],
        }
