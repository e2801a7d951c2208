"""Programs that answer cases: what each says of every one, in processes that see nothing but the log."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.blind.entry.registry import PROGRAMS
from excite.documents.diagnosis import Diagnosis
from excite.errors import ExciteError
from excite.formats.documents import check_content, parse_json
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs, at_once
from excite.progress import Progress
from excite.temporary_folder import TemporaryFolder


def answer_cases(
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
    return check_content(Diagnosis, document, case, remedy="diagnose it alone").content(), taken
