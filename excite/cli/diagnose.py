"""``excite diagnose``: where the simulator differs from the robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import excite
from excite.cli.session.options import JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.session.output import emit
from excite.diagnosis.answer.result import Diagnosis
from excite.json_document import write_json

NAME = "diagnose"


def command(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log folder (excite.log/1).")],
    budget: Annotated[
        bool,
        typer.Option(
            "--budget/--no-budget", help="Say where each joint's gap goes, all effects taken together."
        ),
    ] = True,
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """Diagnose the sim-to-real gap: where it lies, which effect causes it, how far it shrinks."""
    result = excite.diagnose(log, seed=seed, out=out, budget=budget)
    summary = result.summary()
    if out is not None:
        summary += f"\nreport: {_save(result, out)}"
    emit(summary, result.to_json(), as_json=as_json)


def _save(result: Diagnosis, out: Path) -> Path:
    """Write the curves, the document, and the page that shows both; returns the page."""
    from excite.report.data import ForceComparison, ReportData, save_report_data  # lazy: pydantic

    c = result.curves
    if c is not None:
        curves = ForceComparison(c.trial, c.channels, c.units, c.time, c.measured, c.before, c.after)
        save_report_data(ReportData(gap=curves), out / "report_data.npz")
    write_json(result.to_json(), out / "diagnosis.json")
    return excite.report(out)
