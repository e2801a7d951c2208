"""Worker processes of this machine: kept ready between rounds of work, killed where one is broken off."""

from __future__ import annotations

import atexit
import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from excite.parallel.worker import begin, ready

if TYPE_CHECKING:
    from joblib.externals.loky import ProcessPoolExecutor

# Workers use one BLAS thread each: there are as many of them as cores. They keep up to 64 MB that arrays have freed:
# glibc would give each megabyte back to the system and fetch it again, page by page, for the next array, which was a
# thirteenth of the processor time of a G1's candidates (60 of them: 10.9 s; 10.0 s without), with no less memory used.
_ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "MALLOC_MMAP_THRESHOLD_": str(32 << 20),
    "MALLOC_TRIM_THRESHOLD_": str(64 << 20),
}
# More workers than this share of the cores only wait for each other; no result depends on their number.
_WORKERS_A_CORE = 4
# Tasks in flight for each worker: what waits behind a slow task keeps the others busy. Candidates' times differ by a
# factor of ten at most, since those that fail early cost little.
_IN_FLIGHT_A_WORKER = 8
# How long idle workers wait for more work [s]; as joblib has it.
_IDLE_S = 300.0
# Where Linux keeps semaphores, and how old they are when nobody opens them by name any more [s]: workers do so when
# they start, and containers that share memory do not see each other's processes.
_SEMAPHORES, _LEFT_S = Path("/dev/shm"), 60.0


@dataclass(frozen=True, eq=False)
class _Pool:
    """Workers, for how many jobs at most, and the process that they belong to."""

    executor: ProcessPoolExecutor
    workers: int
    jobs: int
    owner: int

    def serves(self, workers: int, jobs: int) -> bool:
        return self.owner == os.getpid() and workers <= self.workers <= jobs


class LocalCrew:
    """Processes of this machine.

    Loky's, which need no ``if __name__ == "__main__"`` in scripts and serve notebooks. They end with this process,
    whichever way that ends.

    Attributes:
        in_flight: tasks that are handed over before results are taken.
        loses_all: what breaks breaks all that is in flight.
    """

    loses_all = True

    def __init__(self, jobs: int, total: int | None) -> None:
        self._workers, self._jobs = _numbers(jobs, total)
        self.in_flight = _IN_FLIGHT_A_WORKER * self._workers
        self._pool: _Pool | None = None

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Hand a task over; starts the workers, if need be."""
        if self._pool is None:
            self._pool = _taken(self._workers, self._jobs)
        task: Future[Any] = self._pool.executor.submit(function, *arguments)
        return task

    def renew(self) -> None:
        """Put new workers in the place of broken ones."""
        self.kill()

    def release(self) -> None:
        """All work is done: the workers wait for more."""
        if self._pool is not None:
            _give_back(self._pool)
            self._pool = None

    def kill(self) -> None:
        """End the workers at once, whatever they do."""
        if self._pool is not None:
            pool, self._pool = self._pool, None
            _kill(pool.executor)


def _numbers(jobs: int, total: int | None) -> tuple[int, int]:
    """Workers for so many tasks, and how many there may be at most."""
    jobs = min(jobs, _WORKERS_A_CORE * (os.cpu_count() or 1))
    return jobs if total is None else max(1, min(jobs, total)), jobs


class _Idle:
    """The workers that wait for work; at most one pool of them.

    They are ended with the process, before multiprocessing waits for them to end by themselves.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.pool: _Pool | None = None
        self.timer: threading.Timer | None = None

    def end(self) -> None:
        """End the workers that wait, if there are any."""
        with self.lock:
            pool, self.pool = self.pool, None
        if pool is not None and pool.owner == os.getpid():
            _kill(pool.executor)


_IDLE = _Idle()


def ready_for(jobs: int, total: int | None) -> bool:
    """Whether workers wait that such a round of work would take."""
    return _IDLE.pool is not None and _IDLE.pool.serves(*_numbers(jobs, total))


def _taken(workers: int, jobs: int) -> _Pool:
    """Workers that wait already, or new ones."""
    with _IDLE.lock:
        waiting, _IDLE.pool = _IDLE.pool, None
        if _IDLE.timer is not None:
            _IDLE.timer.cancel()
    if waiting is not None and waiting.serves(workers, jobs):
        return waiting
    if waiting is not None and waiting.owner == os.getpid():
        _kill(waiting.executor)
    return _started(workers, jobs)


def _give_back(pool: _Pool) -> None:
    timer = threading.Timer(_IDLE_S, _end_idle, (pool,))
    timer.daemon = True
    with _IDLE.lock:
        too_many, _IDLE.pool, _IDLE.timer = _IDLE.pool, pool, timer
        timer.start()
    if too_many is not None:
        _kill(too_many.executor)


def _end_idle(pool: _Pool) -> None:
    with _IDLE.lock:
        if _IDLE.pool is not pool:
            return
        _IDLE.pool = None
    _kill(pool.executor)


def _started(workers: int, jobs: int) -> _Pool:
    from joblib.externals.loky import ProcessPoolExecutor

    _end_at_exit(os.getpid())
    _start_tracker()
    executor = ProcessPoolExecutor(
        max_workers=workers, initializer=begin, initargs=(os.getpid(),), env=_ENVIRONMENT
    )
    try:
        # All workers start with the first task, in the thread that submits it.
        _starter(os.getpid()).submit(executor.submit, ready).result()
    except BaseException:
        _kill(executor)
        raise
    return _Pool(executor, workers, jobs, os.getpid())


def _kill(executor: ProcessPoolExecutor) -> None:
    """End workers at once.

    From outside, as if the system had done it: of ``shutdown(kill_workers=True)`` the thread that manages the pool
    ends in a KeyError where tasks wait, on stderr and without tidying up.
    """
    for number in tuple(executor._processes):
        with suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
    executor.shutdown(wait=True)


@cache
def _end_at_exit(process: int) -> None:
    """What is registered last runs first: only after the import of loky it is before the exit of multiprocessing."""
    atexit.register(_IDLE.end)


@cache
def _starter(process: int) -> ThreadPoolExecutor:
    """A thread that lasts as long as the process: Linux ends workers with the thread that started them."""
    return ThreadPoolExecutor(1, thread_name_prefix=f"excite-starter-{process}")


def _start_tracker() -> None:
    """Start loky's tracker, which removes the semaphores of a process that was killed; let it do so silently."""
    from joblib.externals.loky.backend import resource_tracker

    _sweep_semaphores()
    before = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = "ignore:resource_tracker"
    try:
        resource_tracker.ensure_running()
    finally:
        os.environ.pop("PYTHONWARNINGS")
        if before is not None:
            os.environ["PYTHONWARNINGS"] = before


def _sweep_semaphores() -> None:
    """Remove semaphores that a run left whose tracker was killed too, as all processes of a cluster's job are."""
    for path in _SEMAPHORES.glob("sem.loky-*"):
        with suppress(OSError, ValueError):
            found, owner = path.stat(), int(path.name.split("-")[1])
            if found.st_uid == os.geteuid() and time.time() - found.st_mtime > _LEFT_S and not _alive(owner):
                path.unlink()


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True
