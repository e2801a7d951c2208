"""``excite blind``: cases with withheld answers, and the score of their diagnoses."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from excite.claim import claimed
from excite.cli.session.command_help import HelpfulCommand
from excite.cli.session.options import ClusterOption, JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.session.output import command_line, emit, progress_bars
from excite.cli.session.workers import workers
from excite.errors import ExciteError, InputError
from excite.json_document import write_json
from excite.parallel.engine import in_order
from excite.temporary_folder import TemporaryFolder

NAME = "blind"

app = typer.Typer(
    name=NAME,
    help="Make simulated logs whose hidden effects are written elsewhere, and score their diagnoses.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("make", cls=HelpfulCommand)
def make(
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
    cluster: ClusterOption = None,
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
            help="ordinary: one effect, two or none; everything: arms with three to eight effects of any size, the true "
            "share of each in the answers; both by turns.",
        ),
    ] = "ordinary",
) -> None:
    """Write cases into a folder, and what is hidden in them into a file beside it."""
    from excite.blind.make import make_cases  # lazy: pinocchio

    with (
        claimed(out or Path("blind")) as folder,
        workers(jobs, cluster) as crew,
        progress_bars() as progress,
    ):
        answers = make_cases(
            folder,
            seed=seed,
            cases=cases,
            base=base,
            robots=tuple(robot or ()),
            torque=torque,
            kind=kind,
            jobs=crew,
            progress=progress,
        )
    document = {"schema": "excite.blind/1", "cases": cases, "folder": str(folder), "answers": str(answers)}
    count = f"{cases} case{'s' if cases > 1 else ''}"
    then = command_line("blind", "score", folder)
    emit(f"{count} in {folder}, answers in {answers}", document, as_json=as_json, then=then)


@app.command("score", cls=HelpfulCommand)
def score(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of cases that `make` wrote.")],
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = None,
    cluster: ClusterOption = None,
) -> None:
    """Diagnose every case in a process of its own that sees nothing but a copy of the log, then compare."""
    from excite.blind.make import answers_file, load_answers  # lazy: pinocchio
    from excite.blind.score import score as compare  # lazy: pinocchio

    cases = sorted(path for path in folder.glob("case_*") if path.is_dir())
    if not cases:
        raise InputError(f"{folder} holds no cases", remedy="make some with `excite blind make`")
    answers = load_answers(folder)
    for case in cases:
        if case.name not in answers:
            remedy = "make the cases again, or take this one away"
            raise InputError(
                f"has no answer to {case.name}", source=answers_file(folder), field="cases", remedy=remedy
            )
    tasks = [case.absolute() for case in cases]
    with workers(jobs, cluster) as crew, progress_bars() as progress:
        found = list(in_order(_diagnosed, tasks, jobs=crew, shared=seed, stage="diagnose", progress=progress))
    documents = {case.name: document for case, (document, _) in zip(cases, found, strict=True)}
    seconds = {case.name: taken for case, (_, taken) in zip(cases, found, strict=True)}
    result = compare(answers, documents, seconds)
    if out is not None:
        write_json(result.to_json(), out / "blind_score.json")
    emit(result.summary(), result.to_json(), as_json=as_json)


# The child ends with the process that waits for it, however that ends.
_DIAGNOSE = """
import os, sys
from excite.lifetime import die_with_parent
die_with_parent(int(sys.argv.pop(1)))
from excite.cli.main import main
main()
"""


def _diagnosed(seed: int, case: Path) -> tuple[dict[str, Any], float]:
    """One diagnosis, from a copy of the log that does not say where it came from, and its seconds."""
    from excite.documents.diagnosis import Diagnosis  # lazy: pydantic
    from excite.reading.json_document import checked, parse_json  # lazy: pydantic

    folder = TemporaryFolder()
    copy = Path(shutil.copytree(case, folder.path / "private" / "log"))
    started = time.perf_counter()
    options = ("diagnose", str(copy), "--json", "--seed", str(seed))
    child = subprocess.run(
        [sys.executable, "-c", _DIAGNOSE, str(os.getpid()), *options],
        capture_output=True,
        text=True,
        cwd=copy.parent,
        check=False,
    )
    taken = time.perf_counter() - started
    if child.returncode != 0:
        last = (child.stderr.strip().splitlines() or ["no message"])[-1]
        raise ExciteError(f"the diagnosis of {case.name} failed: {last}")
    try:
        document = parse_json(child.stdout)
    except ValueError as error:
        raise ExciteError(
            f"the diagnosis of {case.name} is no JSON ({' '.join(str(error).split())})"
        ) from error
    return checked(Diagnosis, document, case, remedy="diagnose it alone").content(), taken
