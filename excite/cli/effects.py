"""``excite effects``: what a diagnosis can name."""

from __future__ import annotations

import excite
from excite.cli.session.options import JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.session.output import command_line, write_and_emit

NAME = "effects"


def command(
    as_json: JsonOption = False,
    out: OutOption = None,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
) -> None:
    """List the effects that a diagnosis can name: law, what looks like it, what tells them apart."""
    summaries = excite.effect_summaries()
    document = {"schema": "excite.effects/1", "effects": [summary.to_json() for summary in summaries]}
    if write_and_emit(document, "effects.json", as_json=as_json, out=out):
        return
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    console = Console()
    titles = {"fixed": "Arms", "floating": "Standing robots and people"}
    for base, title in titles.items():
        console.print(Text(title, style="bold"))
        for summary in summaries:
            if summary.base == base:
                form = "" if summary.form == summary.name else f" ({summary.form.replace('_', ' ')})"
                console.print(Text(summary.name + form, style="cyan"))
                for text in (
                    summary.law,
                    f"looks like: {summary.looks_like}",
                    f"told apart by: {summary.told_apart_by}" if summary.told_apart_by else "",
                    f"in MuJoCo: {summary.mujoco}" if summary.mujoco else "",
                ):
                    if text:
                        console.print(Padding(Text(text), (0, 0, 0, 4), expand=False))
    print(f"then: {command_line('diagnose', 'LOG', '--out', 'diagnosis')}")
