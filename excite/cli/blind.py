"""The commands ``effects`` and ``blind``: what a diagnosis can name, and how often it names it rightly."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Annotated, Literal

import typer

import excite
from excite.cli.options import (
    command,
    requested_workers,
    working_in,
)
from excite.cli.output import command_line, emit_result, progress_bars, write_and_emit
from excite.display import count
from excite.errors import InputError
from excite.results import write_json


@command("effects")
def list_effects(
    *,
    as_json: bool,
    out: Path | None,
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


FolderArgument = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of cases that `make` wrote.")]


def _check_checkout() -> None:
    """Refuse where the benchmark is not there: it is part of the repository, not of what is installed."""
    if importlib.util.find_spec("benchmarks") is None or importlib.util.find_spec("benchmarks.blind") is None:
        raise InputError(
            "the benchmark is part of the repository, not of what is installed",
            source="excite blind",
            remedy="run it from a checkout of the repository",
        )


@command("blind make")
def make_blind_cases(
    cases: Annotated[int, typer.Option("--cases", min=1, help="Number of cases.")] = 20,
    robots: Annotated[
        list[str] | None, typer.Option("--robot", help="Bundled robot to draw from (may be repeated).")
    ] = None,
    base: Annotated[
        Literal["fixed", "floating", "both"],
        typer.Option("--base", help="Arms, standing robots with contact wrenches, or both by turns."),
    ] = "fixed",
    torque: Annotated[
        Literal["motor_side", "none"],
        typer.Option(
            "--torque", help="none: logs of commands and positions, as of a servo without a sensor."
        ),
    ] = "motor_side",
    kind: Annotated[
        Literal["ordinary", "everything", "both"],
        typer.Option(
            "--class",
            help="ordinary: one effect, two or none; everything: arms with three to eight effects of any size, the "
            "true share of each in the answers; both by turns.",
        ),
    ] = "ordinary",
    *,
    out: Path | None,
    as_json: bool,
    seed: int,
    jobs: int | None,
    cluster: str | None,
) -> None:
    """Write cases into a folder, and what is hidden in them into a file beside it."""
    _check_checkout()
    from benchmarks.blind.make import make_cases  # lazy: pinocchio

    with working_in(out or Path("blind"), jobs, cluster) as (folder, crew, progress):
        answers = make_cases(
            folder,
            seed=seed,
            cases=cases,
            base=base,
            robots=tuple(robots or ()),
            torque=torque,
            kind=kind,
            jobs=crew,
            progress=progress,
        )
    document = {"schema": "excite.blind/1", "cases": cases, "folder": str(folder), "answers": str(answers)}
    then = command_line("blind", "score", folder)
    emit_result(
        f"{count(cases, 'case')} in {folder}, answers in {answers}", document, as_json=as_json, then=then
    )


@command("blind enter")
def enter_answers(
    folder: FolderArgument,
    method: Annotated[
        Literal["diagnose", "alone", "mujoco-sysid"],
        typer.Option(
            "--method",
            help="diagnose: `excite diagnose`; alone: each effect fitted alone, lowest BIC; mujoco-sysid: all "
            "parameters of mujoco.sysid at once, largest change.",
        ),
    ] = "diagnose",
    *,
    out: Path | None,
    as_json: bool,
    seed: int,
    jobs: int | None,
    cluster: str | None,
) -> None:
    """Let a program answer every case, one file a case; it sees nothing but the log."""
    _check_checkout()
    from benchmarks.blind.programs import answer_cases  # lazy: pinocchio

    cases = _case_folders(folder)
    with working_in(out or Path(f"{folder.name}-{method}"), jobs, cluster) as (entry, crew, progress):
        for case, (document, _) in zip(cases, answer_cases(cases, method, seed, crew, progress), strict=True):
            write_json(document, entry / f"{case.name}.json")
    document = {"schema": "excite.blind_entry/1", "cases": len(cases), "method": method, "folder": str(entry)}
    then = command_line("blind", "score", folder, "--entry", entry)
    emit_result(f"{len(cases)} answers in {entry}", document, as_json=as_json, then=then)


@command("blind score")
def score_answers(
    folder: FolderArgument,
    entries: Annotated[
        list[Path] | None,
        typer.Option(
            "--entry",
            metavar="DIR",
            help="Folder of answers made elsewhere, CASE.json each (may be repeated, for a table); without it "
            "`excite diagnose` answers.",
        ),
    ] = None,
    *,
    out: Path | None,
    as_json: bool,
    seed: int,
    jobs: int | None,
    cluster: str | None,
) -> None:
    """Compare answers with what is hidden: those of entries, or diagnoses by processes that see nothing but the log."""
    _check_checkout()
    from benchmarks.blind.answers import from_diagnosis, read_entry  # lazy: pinocchio
    from benchmarks.blind.board import score_board  # lazy: pinocchio
    from benchmarks.blind.make import answers_file, load_answers  # lazy: pinocchio
    from benchmarks.blind.programs import answer_cases  # lazy: pinocchio
    from benchmarks.blind.score import score_entry  # lazy: pinocchio

    cases = _case_folders(folder)
    answers = load_answers(folder)
    for case in cases:
        if case.name not in answers:
            remedy = "make the cases again, or take this one away"
            raise InputError(
                f"has no answer to {case.name}", source=answers_file(folder), field="cases", remedy=remedy
            )
    answers = {case.name: answers[case.name] for case in cases}
    if entries:
        scores = {str(entry): score_entry(answers, read_entry(entry, answers)) for entry in entries}
    else:
        with requested_workers(jobs, cluster) as crew, progress_bars() as progress:
            found = answer_cases(cases, "diagnose", seed, crew, progress)
        said = {case.name: from_diagnosis(*item) for case, item in zip(cases, found, strict=True)}
        scores = {"excite diagnose": score_entry(answers, said)}
    documents = {name: result.to_json() for name, result in scores.items()}
    (document, *others) = documents.values()
    if others:
        document = {"schema": "excite.blind_board/1", "entries": documents}
    if out is not None:
        write_json(document, out / "blind_score.json")
    text = next(iter(scores.values())).summary() if not others else score_board(scores)
    emit_result(text, document, as_json=as_json)


def _case_folders(folder: Path) -> list[Path]:
    cases = sorted(path for path in folder.glob("case_*") if path.is_dir())
    if not cases:
        raise InputError(f"{folder} holds no cases", remedy="make some with `excite blind make`")
    return cases
