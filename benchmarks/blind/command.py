"""``python -m benchmarks.blind``: cases with withheld answers, and the score of their diagnoses."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from benchmarks.blind.answers import from_diagnosis, read_entry
from benchmarks.blind.board import score_board
from benchmarks.blind.entry.registry import PROGRAMS
from benchmarks.blind.make import answers_file, load_answers, make_cases
from benchmarks.blind.score import score_entry
from excite.cli.options import Call, with_shared_options
from excite.cli.output import command_line, progress_bars
from excite.diagnosis.answer.answer import Diagnosis
from excite.display import count
from excite.documents.document import model_of
from excite.errors import ExciteError, InputError
from excite.formats.documents import check_content, parse_json
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs, at_once
from excite.progress import Progress
from excite.results import write_json
from excite.temporary_folder import TemporaryFolder

app = typer.Typer(
    help="Make simulated logs whose hidden effects are written elsewhere, answer them, and score answers.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


FolderArgument = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of cases that `make` wrote.")]


@app.command("make")
@with_shared_options(cluster=True)
def make(
    cases: Annotated[int, typer.Option("--cases", min=1, help="Number of cases.")] = 20,
    robot: Annotated[
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
    call: Call,
) -> None:
    """Write cases into a folder, and what is hidden in them into a file beside it."""
    with call.working_in("blind") as (folder, crew, progress):
        answers = make_cases(
            folder,
            seed=call.seed,
            cases=cases,
            base=base,
            robots=tuple(robot or ()),
            torque=torque,
            kind=kind,
            jobs=crew,
            progress=progress,
        )
    document = {"schema": "excite.blind/1", "cases": cases, "folder": str(folder), "answers": str(answers)}
    then = _command_line("score", folder)
    call.emit_result(f"{count(cases, 'case')} in {folder}, answers in {answers}", document, then=then)


@app.command("enter")
@with_shared_options(cluster=True)
def enter(
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
    call: Call,
) -> None:
    """Let a program answer every case, one file a case; it sees nothing but the log."""
    cases = _case_folders(folder)
    with call.working_in(f"{folder.name}-{method}") as (entry, crew, progress):
        for case, (document, _) in zip(
            cases, _answer_cases(cases, method, call.seed, crew, progress), strict=True
        ):
            write_json(document, entry / f"{case.name}.json")
    document = {"schema": "excite.blind_entry/1", "cases": len(cases), "method": method, "folder": str(entry)}
    then = _command_line("score", folder, "--entry", entry)
    call.emit_result(f"{len(cases)} answers in {entry}", document, then=then)


@app.command("score")
@with_shared_options(cluster=True)
def score(
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
    call: Call,
) -> None:
    """Compare answers with what is hidden: those of entries, or diagnoses by processes that see nothing but the log."""
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
        with call.requested_workers() as crew, progress_bars() as progress:
            found = _answer_cases(cases, "diagnose", call.seed, crew, progress)
        said = {case.name: from_diagnosis(*item) for case, item in zip(cases, found, strict=True)}
        scores = {"excite diagnose": score_entry(answers, said)}
    documents = {name: result.to_json() for name, result in scores.items()}
    (document, *others) = documents.values()
    if others:
        document = {"schema": "excite.blind_board/1", "entries": documents}
    call.write_document(document, "blind_score.json")
    text = next(iter(scores.values())).summary() if not others else score_board(scores)
    call.emit_result(text, document)


def _command_line(*words: object) -> str:
    return command_line(*words).replace("excite", "python -m benchmarks.blind", 1)


def _case_folders(folder: Path) -> list[Path]:
    cases = sorted(path for path in folder.glob("case_*") if path.is_dir())
    if not cases:
        raise InputError(
            f"{folder} holds no cases", remedy="make some with `python -m benchmarks.blind make`"
        )
    return cases


def _answer_cases(
    cases: list[Path], method: str, seed: int, crew: Jobs, progress: Progress
) -> list[tuple[dict[str, Any], float]]:
    """What a program says of every case, and its seconds of processor time."""
    tasks = [case.absolute() for case in cases]
    work, shared = (_run_diagnosis, seed) if method == "diagnose" else (_run_entry, method)
    return list(in_order(work, tasks, jobs=at_once(crew), shared=shared, stage=method, progress=progress))


def _run_entry(method: str, case: Path) -> tuple[dict[str, Any], float]:
    """The answer of one of the plain programs."""
    started = time.process_time()
    document = PROGRAMS[method](case)
    taken = round(time.process_time() - started, 2)
    return {**document, "seconds": taken}, taken


# The child ends with the process that waits for it, however that ends.
_DIAGNOSE = """
import os, sys
from excite.kill_with_parent import die_with_parent
die_with_parent(int(sys.argv.pop(1)))
from excite.cli.main import main
main()
"""


def _children_s() -> float:
    """Processor time of the children that have ended [s]."""
    times = os.times()
    return times.children_user + times.children_system


def _run_diagnosis(seed: int, case: Path) -> tuple[dict[str, Any], float]:
    """One diagnosis, from a copy of the log that does not say where it came from, and its seconds."""
    folder = TemporaryFolder()
    copy = Path(shutil.copytree(case, folder.path / "private" / "log"))
    started = _children_s()
    options = ("diagnose", str(copy), "--json", "--seed", str(seed))
    child = subprocess.run(
        [sys.executable, "-c", _DIAGNOSE, str(os.getpid()), *options],
        capture_output=True,
        text=True,
        cwd=copy.parent,
        check=False,
    )
    taken = _children_s() - started
    if child.returncode != 0:
        last = (child.stderr.strip().splitlines() or ["no message"])[-1]
        raise ExciteError(f"the diagnosis of {case.name} failed: {last}")
    try:
        document = parse_json(child.stdout)
    except ValueError as error:
        raise ExciteError(
            f"the diagnosis of {case.name} is no JSON ({' '.join(str(error).split())})"
        ) from error
    return check_content(model_of(Diagnosis), document, case, remedy="diagnose it alone").content(), taken
