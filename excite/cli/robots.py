"""``excite robots``: the bundled robots."""

from __future__ import annotations

import excite
from excite.cli.session.options import JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.session.output import command_line, write_and_emit

NAME = "robots"


def command(
    as_json: JsonOption = False,
    out: OutOption = None,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """List the bundled robots: degrees of freedom, mass, sensors, base type."""
    summaries = excite.robot_summaries()
    document = {"schema": "excite.robots/1", "robots": [summary.to_json() for summary in summaries]}
    if write_and_emit(document, "robots.json", as_json=as_json, out=out):
        return
    from rich.console import Console
    from rich.table import Table

    table = Table("robot", "title", "base", "DoF", "mass [kg]", "sensors", box=None, pad_edge=False)
    for summary in summaries:
        table.add_row(
            summary.name,
            summary.title,
            summary.base,
            str(summary.n_joints),
            f"{summary.mass:.1f}",
            ", ".join(summary.sensors),
        )
    Console(soft_wrap=True).print(table)
    print(f"then: {command_line('plan', 'ROBOT', '--out', 'plan')}")
