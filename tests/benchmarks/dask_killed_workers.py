"""Screenings on a Dask cluster of which one worker is killed at a random moment: all complete, all the same bytes."""

from __future__ import annotations

import hashlib
import os
import signal
import sys
import threading
import time
from typing import Any

import numpy as np

from excite.motion.generators.registry import plan_proposals
from excite.parallel.cluster import executor
from excite.parallel.jobs import Jobs
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
    from distributed import LocalCluster

    rng, robot = np.random.default_rng(seed), load_robot(_ROBOT)
    expected = _screened(robot, 1)
    complete = equal = 0
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        with executor(cluster.scheduler_address) as crew:
            started = time.perf_counter()
            _screened(robot, crew)
            seconds = time.perf_counter() - started
        for _ in range(runs):
            killer = threading.Timer(
                float(rng.uniform(0.0, seconds)), _kill, (cluster, int(rng.integers(1 << 30)))
            )
            with executor(cluster.scheduler_address) as crew:
                killer.start()
                found = _screened(robot, crew)
            killer.join()
            complete += 1
            equal += found == expected
    return complete, equal


def _kill(cluster: Any, number: int) -> None:
    """Kill one of the worker processes; the cluster starts another one in its place."""
    workers = [nanny.process.pid for nanny in cluster.workers.values() if nanny.process is not None]
    workers = [pid for pid in workers if pid is not None]
    if workers:
        os.kill(workers[number % len(workers)], signal.SIGKILL)


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
