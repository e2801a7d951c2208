"""``excite blind``: cases with withheld answers, and the score of their diagnoses."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from excite.claim import claimed
from excite.cli.options import DEFAULT_JOBS, JobsOption, JsonOption, OutOption, SeedOption
from excite.cli.output import emit, progress_bars
from excite.errors import ExciteError, InputError

NAME = "blind"

app = typer.Typer(
    name=NAME,
    help="Make simulated logs whose hidden effects are written elsewhere, and score their diagnoses.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("make")
def make(
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = DEFAULT_JOBS,
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
) -> None:
    """Write cases into a folder, and what is hidden in them into a file beside it."""
    from excite.simulation.blind.make import make_cases

    with claimed(out or Path("blind")) as folder, progress_bars() as progress:
        answers = make_cases(
            folder,
            seed=seed,
            cases=cases,
            base=base,
            robots=tuple(robot or ()),
            torque=torque,
            jobs=jobs,
            progress=progress,
        )
    document = {"schema": "excite.blind/1", "cases": cases, "folder": str(folder), "answers": str(answers)}
    count = f"{cases} case{'s' if cases > 1 else ''}"
    emit(f"{count} in {folder}, answers in {answers}", document, as_json=as_json)


@app.command("score")
def score(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of cases that `make` wrote.")],
    out: OutOption = None,
    as_json: JsonOption = False,
    seed: SeedOption = 0,
    jobs: JobsOption = DEFAULT_JOBS,
) -> None:
    """Diagnose every case in a process of its own that sees nothing but a copy of the log, then compare."""
    from excite.json_document import write_json
    from excite.simulation.blind.make import answers_file, load_answers
    from excite.simulation.blind.score import score as compare

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
    documents: dict[str, dict[str, Any]] = {}
    seconds: dict[str, float] = {}
    with progress_bars() as progress, ThreadPoolExecutor(jobs) as pool:
        for done, (name, document, taken) in enumerate(pool.map(lambda c: _diagnosed(c, seed), cases)):
            documents[name], seconds[name] = document, taken
            progress("diagnose", done + 1, len(cases))
    result = compare(answers, documents, seconds)
    if out is not None:
        write_json(result.to_json(), out / "blind_score.json")
    emit(result.summary(), result.to_json(), as_json=as_json)


def _diagnosed(case: Path, seed: int) -> tuple[str, dict[str, Any], float]:
    """One diagnosis from a copy of the log that does not say where it came from."""
    from excite.documents.diagnosis import Diagnosis
    from excite.reading.json_document import checked, parse_json

    with tempfile.TemporaryDirectory() as private:
        copy = Path(shutil.copytree(case, Path(private) / "log"))
        started = time.perf_counter()
        command = [
            sys.executable,
            "-m",
            "excite.cli.main",
            "diagnose",
            str(copy),
            "--json",
            "--seed",
            str(seed),
        ]
        child = subprocess.run(command, capture_output=True, text=True, cwd=private, check=False)
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
    return case.name, checked(Diagnosis, document, case, remedy="diagnose it alone").content(), taken
