"""Screening of candidates by more workers, and what a task costs beside its work."""

from __future__ import annotations

import os
import pickle
import time
from dataclasses import dataclass

import numpy as np

from excite.campaign.pool import Keeper
from excite.motion.generators.mixture import plan_proposals
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs, executor
from excite.parallel.worker import Answer
from excite.robot.loading import load_robot
from excite.safety.filter import FilterReport, filter_candidates
from excite.temporary_folder import TemporaryFolder
from tests.benchmarks.table import Row
from tests.parallel import work

_ROBOT, _COUNT = "g1", 40
_WORKERS = (1, 2, 4)
_EMPTY = 2000
# Share of the ideal speed-up that as many workers as cores have to reach: what is left is the memory's bandwidth.
_EFFICIENCY = 0.8


@dataclass(frozen=True)
class _Screening:
    """Seconds on the clock with workers that wait already, what came out, and bytes on disk."""

    seconds: float
    report: FilterReport
    disk: int


def rows() -> list[Row]:
    """Speed-up, what a task costs, and the figures that ``docs/scaling.md`` reckons with."""
    found = {count: _screen(count) for count in _WORKERS}
    cores = len(os.sched_getaffinity(0))
    one = found[1]
    speed = {count: one.seconds / item.seconds for count, item in found.items()}
    wanted = _EFFICIENCY * min(2, cores)
    busy = one.report.seconds / _COUNT
    sent = len(pickle.dumps(next(iter(_proposals(1)))))
    back = float(np.mean([len(pickle.dumps(Answer(kept))) for kept in one.report.kept]))
    kept = one.disk / max(1, len(one.report.kept))
    local, dask = _overhead(2), _overhead_of_dask()
    return [
        Row.at_least(f"{_COUNT} candidates of {_ROBOT}: one worker's time / two workers'", speed[2], wanted),
        Row(f"… one worker's time / four workers', on {cores} cores", "", f"{speed[4]:.2f}", None),
        Row("… processor time of one", "", f"{1e3 * busy:.0f} ms", None),
        Row("… sent of one, and returned", "", f"{sent} and {back:.0f} bytes", None),
        Row("… on disk of an accepted one", "", f"{kept / 1e6:.2f} MB", None),
        Row.at_most("an empty task, two workers of this machine", 1e3 * local, 0.05 * 1e3 * busy, "ms"),
        Row.at_most("an empty task, two workers of a Dask cluster", 1e3 * dask, 0.05 * 1e3 * busy, "ms"),
    ]


def _proposals(count: int):
    return plan_proposals(load_robot(_ROBOT), count, np.random.SeedSequence(1))


def _screen(jobs: int) -> _Screening:
    robot, folder = load_robot(_ROBOT), TemporaryFolder()
    # Imports, the robot and its caches are not what grows with the number of candidates.
    filter_candidates(
        robot, _proposals(4 * jobs), total=4 * jobs, jobs=jobs, keep=Keeper(folder.path, "warm_")
    )
    before = _size(folder)
    started = time.perf_counter()
    report = filter_candidates(
        robot, _proposals(_COUNT), total=_COUNT, jobs=jobs, keep=Keeper(folder.path, "")
    )
    return _Screening(time.perf_counter() - started, report, _size(folder) - before)


def _size(folder: TemporaryFolder) -> int:
    return sum(path.stat().st_size for path in folder.path.iterdir())


def _overhead(jobs: Jobs) -> float:
    """Seconds of an empty task, once the workers are there."""
    list(in_order(work.identity, range(10), jobs=jobs))
    started = time.perf_counter()
    list(in_order(work.identity, range(_EMPTY), jobs=jobs))
    return (time.perf_counter() - started) / _EMPTY


def _overhead_of_dask() -> float:
    from distributed import LocalCluster

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        executor(cluster.scheduler_address) as crew,
    ):
        return _overhead(crew)
