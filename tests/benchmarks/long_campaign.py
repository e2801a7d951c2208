"""Memory of a campaign that goes on for two hours: it screens candidates, more of them than there is time for."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.benchmarks.table import Row
from tests.benchmarks.tree_memory import tree_memory

_SECONDS = 7200.0
_EVERY_S = 10.0
# More candidates than the time allows: a campaign ends by itself once more motion would not help, and what takes the
# hours is the screening. It is interrupted in the end.
_CAMPAIGN = ("campaign", "g1", "--candidates", "40000", "--seed", "5", "--jobs", "2")
# The first tenth imports, builds caches and forks; a leak shows in what comes after it.
_SETTLED = 0.1
# What the allocator and shared pages wander by.
_FLAT = 1.05


@dataclass(frozen=True)
class Course:
    """Memory of a campaign by time.

    Attributes:
        seconds: (n,) since the start [s].
        parent_mb: (n,) that the campaign itself took, without libraries that others use too [MB].
        workers_mb: (n,) of all its workers together [MB].
    """

    seconds: np.ndarray
    parent_mb: np.ndarray
    workers_mb: np.ndarray


def rows() -> list[Row]:
    """Memory in the second tenth of the time and in the last one."""
    course = watch(_SECONDS, Path(tempfile.gettempdir()) / "long_campaign.csv")
    begin = (course.seconds > _SETTLED * _SECONDS) & (course.seconds < 2 * _SETTLED * _SECONDS)
    end = course.seconds > (1 - _SETTLED) * _SECONDS
    found = []
    for name, sizes in (("the campaign itself", course.parent_mb), ("its two workers", course.workers_mb)):
        first, last = float(np.median(sizes[begin])), float(np.median(sizes[end]))
        what = f"two hours of a campaign, memory of {name}: last tenth / second tenth"
        found.append(Row.at_most(what, last / first, _FLAT))
        found.append(Row("… second tenth, last tenth", "", f"{first:.0f}, {last:.0f} MB", None))
    return found


def watch(seconds: float, table: Path) -> Course:
    """Run the campaign for some time and write down its memory as it goes.

    Args:
        seconds: after which it is interrupted.
        table: a row is added at every look, so that nothing is lost when this is killed.
    """
    looks: list[tuple[float, ...]] = []
    with tempfile.TemporaryDirectory(prefix="long_campaign_") as name:
        folder = Path(name) / "campaign"
        command = [sys.executable, "-m", "excite", *_CAMPAIGN, "--out", str(folder)]
        quiet = subprocess.DEVNULL
        run = subprocess.Popen(command, env=os.environ, stdout=quiet, stderr=quiet, text=True)
        started = time.perf_counter()
        while run.poll() is None and (now := time.perf_counter() - started) < seconds:
            parent, workers = tree_memory(run.pid)
            looks.append((now, parent, workers))
            with table.open("a") as file:
                file.write(",".join(f"{value:.1f}" for value in looks[-1]) + "\n")
            time.sleep(_EVERY_S)
        if run.poll() is not None:
            raise RuntimeError(f"the campaign ended by itself with {run.returncode}")
        run.terminate()
        run.wait()
    return Course(*np.array(looks).T)


if __name__ == "__main__":
    watch(float(sys.argv[1]), Path(sys.argv[2]))
