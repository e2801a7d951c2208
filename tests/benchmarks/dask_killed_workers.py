"""Screenings on a Dask cluster of which one worker is killed at a random moment: all complete, all the same bytes."""

from __future__ import annotations

import hashlib
import os
import signal
import sys
import threading
import time

import numpy as np

from excite.motion.generators.mixture import plan_proposals
from excite.parallel.jobs import Jobs, executor
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.filter import filter_candidates
from tests.benchmarks.table import Row

RUNS = 20
_ROBOT, _COUNT, _SEED = "ur10", 6, 7


def rows() -> list[Row]:
    """How many of :data:`RUNS` screenings survive the death of a worker."""
    complete, equal = measure(RUNS, _SEED)
    what = f"screening under Dask, one of two workers killed at a random moment, {RUNS} times"
    return [
        Row.holds(f"{what}: complete", "all", f"{complete} of {RUNS}", complete == RUNS),
        Row.holds("… with the same bytes", "all", f"{equal} of {RUNS}", equal == RUNS),
    ]


def measure(runs: int, seed: int) -> tuple[int, int]:
    """Complete screenings, and those equal to one that nobody disturbed."""

    rng, robot = np.random.default_rng(seed), load_robot(_ROBOT)
    expected = _screened(robot, 1)
    _, seconds = _disturbed(robot, None)
    complete = equal = 0
    for _ in range(runs):
        found, _ = _disturbed(robot, (float(rng.uniform(0.0, seconds)), int(rng.integers(2))))
        complete += 1
        equal += found == expected
    return complete, equal


def _disturbed(robot: Robot, kill: tuple[float, int] | None) -> tuple[str, float]:
    """What a cluster of its own finds, and its seconds; after some of them one of its workers is killed."""
    from distributed import LocalCluster

    # One cluster a run: a worker that is killed while it starts is not started again.
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        executor(cluster.scheduler_address) as crew,
    ):
        started = time.perf_counter()
        if kill is not None:
            after, number = kill
            pid = list(cluster.workers.values())[number].process.pid
            threading.Timer(after, os.kill, (pid, signal.SIGKILL)).start()
        return _screened(robot, crew), time.perf_counter() - started


def _screened(robot: Robot, jobs: Jobs) -> str:
    """SHA-256 of all outcomes."""
    proposals = plan_proposals(robot, _COUNT, np.random.SeedSequence(3))
    digest = hashlib.sha256()
    for outcome in filter_candidates(robot, proposals, total=_COUNT, jobs=jobs).outcomes:
        digest.update(outcome.candidate.encode())
        if outcome.rejection is not None:
            digest.update(outcome.rejection.reason.encode())
        if outcome.motion is not None:
            digest.update(outcome.motion.time.tobytes() + outcome.motion.q.tobytes())
    return digest.hexdigest()


if __name__ == "__main__":
    print(measure(int(sys.argv[1]), int(sys.argv[2])))
