"""All work in one process or several: results in order, and who does the work."""

from __future__ import annotations

import atexit
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sized
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from weakref import WeakSet

from excite.errors import ExciteError
from excite.parallel.jobs import AtMost, Executor, Jobs, at_once, check_jobs
from excite.parallel.worker import Answer, Shared, SharedFile, begin, perform, ready
from excite.progress import Progress, silent
from excite.threads import one_blas_thread

if TYPE_CHECKING:
    from joblib.externals.loky import ProcessPoolExecutor

Task = TypeVar("Task")
Result = TypeVar("Result")

# What a worker costs before its first result [s of a core]: libraries, the robot, its shapes. To judge 2 to 32
# candidates took longer with two workers than without by 1.0 to 1.4 s a worker for a UR10, 0.9 to 1.7 for a Panda and
# 1.5 to 2.2 for a G1.
_START_S = 1.3


def in_order(
    function: Callable[[Any, Task], Result],
    tasks: Iterable[Task],
    *,
    jobs: Jobs = 1,
    shared: Any = None,
    total: int | None = None,
    stage: str = "work",
    progress: Progress = silent,
) -> Iterator[Result]:
    """Call ``function(shared, task)`` for each task and yield the results in the tasks' order.

    Results are the same for every ``jobs``, where the function depends on nothing but its arguments: tasks carry
    their own seeds. Of the tasks only a bounded number is in flight, so that there may be millions of small ones; give
    them names of files rather than arrays. Workers keep to one BLAS thread. A worker that is killed costs time, no
    result. Whoever stops early or is interrupted (any exception, within the loop over the results too once that has
    let go of them) finds the workers of this machine gone, and of an executor the tasks cancelled.

    Args:
        function: of a module that workers can import, or picklable by value.
        tasks: one argument a call, read as work proceeds.
        jobs: number of processes, 1 for this one alone; or :class:`~excite.parallel.jobs.AtMost`, with which this one
            begins and starts others where what is left outweighs their start; or an executor, whose workers may be on
            other machines: they need the same version of excite, and a ``TMPDIR`` that they share with this one.
        shared: what all calls need. It goes to a file of the temporary folder once, and once from there into each
            worker. A :class:`~excite.parallel.worker.Shared` serves several rounds.
        total: number of tasks, where ``tasks`` does not say.
        stage: what ``progress`` and errors call the work.
        progress: told after each result.

    Raises:
        InputError: ``jobs`` is none of what it may be; or a worker cannot read what is shared.
        ExciteError: a task has ended its worker three times; what the function itself raises, comes as it is.
    """
    check_jobs(jobs)
    if total is None and isinstance(tasks, Sized):
        total = len(tasks)
    common = shared if isinstance(shared, Shared) else Shared(shared)
    processes = at_once(jobs)
    if isinstance(processes, int) and (processes == 1 or (total is not None and total < 2)):
        results = _here(function, tasks, common.value)
    elif isinstance(jobs, AtMost):
        results = _begun_here(function, tasks, common, jobs, total, stage)
    else:
        crew = LocalCrew(processes, total) if isinstance(processes, int) else ForeignCrew(processes)
        results = Round(crew, function, common, stage).results(tasks)
    return _told(results, total, stage, progress)


def _told(results: Iterator[Result], total: int | None, stage: str, progress: Progress) -> Iterator[Result]:
    done = 0
    for result in results:
        done += 1
        progress(stage, done, done if total is None else total)
        yield result


def _here(function: Callable[[Any, Task], Result], tasks: Iterable[Task], shared: Any) -> Iterator[Result]:
    call = one_blas_thread(function)
    for task in tasks:
        yield call(shared, task)


def _begun_here(
    function: Callable[[Any, Task], Result],
    tasks: Iterable[Task],
    shared: Shared[Any],
    jobs: AtMost,
    total: int | None,
    stage: str,
) -> Iterator[Result]:
    """Do tasks in this process until it is plain that others pay, which then do the rest."""
    source, seconds = iter(tasks), list[float]()
    for task in source:
        left = None if total is None else total - len(seconds)
        if ready_for(jobs.processes, left) or _pays(seconds, left, jobs.processes):
            crew = LocalCrew(jobs.processes, left)
            yield from Round(crew, function, shared, stage).results(chain([task], source))
            return
        begun = time.process_time()
        result = next(_here(function, [task], shared.value))
        seconds.append(time.process_time() - begun)
        yield result


def _pays(seconds: list[float], left: int | None, processes: int) -> bool:
    """Whether tasks that are left would be done sooner by others that have yet to be started.

    Where nobody knows how many are left, there are as many as there were, the best guess of somebody who does not know.

    Args:
        seconds: that each task took so far. The first one loads what all need, and tells little of the others.
        left: tasks that are left, None where nobody knows.
        processes: how many there may be.
    """
    if len(seconds) < 2:
        return sum(seconds) > 2.0 * _START_S
    each = sum(seconds[1:]) / (len(seconds) - 1)
    left = len(seconds) if left is None else left
    return each * left * (1.0 - 1.0 / min(processes, left)) > _START_S


# Workers that somebody else set up, and who ends them.

# Keeps a thousand cores busy; what waits is small, since tasks carry seeds and names of files.
_IN_FLIGHT = 2048


class ForeignCrew:
    """An executor of the caller's; it stays as it is.

    Attributes:
        in_flight: tasks that are handed over before results are taken.
        loses_all: what breaks breaks all that is in flight.
    """

    loses_all = False

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._futures: WeakSet[Any] = WeakSet()
        self.in_flight = _IN_FLIGHT

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Hand a task over."""
        future = self._executor.submit(function, *arguments)
        self._futures.add(future)
        return future

    def renew(self) -> None:
        """Nothing to do: other tasks go on."""

    def release(self) -> None:
        """All work is done."""

    def kill(self) -> None:
        """Take back what has not begun."""
        for future in tuple(self._futures):
            future.cancel()


# Worker processes of this machine: kept ready between rounds of work, killed where one is broken off.

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


# A round of work in other processes: few tasks in flight, dead workers replaced.

# A task whose worker died may have been beside the one that killed it, or the machine short of memory. After two
# deaths it is run with nothing beside it; a third one is its own.
_SUSPECT, _GUILTY = 2, 3


@dataclass(eq=False)
class _Entry:
    """A task in flight, or one that is to be handed over again."""

    number: int
    task: Any
    future: Any = None
    answer: Answer | None = None
    deaths: int = 0


class Round:
    """One round of tasks in other processes."""

    def __init__(
        self,
        crew: LocalCrew | ForeignCrew,
        function: Callable[[Any, Any], Any],
        shared: Shared[Any],
        stage: str,
    ) -> None:
        self._crew, self._function, self._shared, self._stage = crew, function, shared, stage
        self._window: deque[_Entry] = deque()
        self._file: SharedFile | None = None

    def results(self, tasks: Iterable[Any]) -> Iterator[Any]:
        """What the tasks return, in order."""
        complete = False
        try:
            self._file = None if self._shared.value is None else self._shared.file()
            source = enumerate(tasks)
            self._fill(source)
            while self._window:
                answer = self._first()
                self._window.popleft()
                self._fill(source)
                yield answer.given()
            complete = True
        finally:
            if complete:
                self._crew.release()
            else:
                self._crew.kill()

    def _fill(self, source: Iterator[tuple[int, Any]]) -> None:
        while len(self._window) < self._crew.in_flight:
            following = next(source, None)
            if following is None:
                return
            entry = _Entry(*following)
            self._window.append(entry)
            self._hand_over(entry)

    def _hand_over(self, entry: _Entry) -> None:
        try:
            entry.future = self._crew.submit(perform, self._function, self._file, entry.task)
        except (RuntimeError, OSError) as error:
            # Workers that died while they waited: what executors raise then is a RuntimeError.
            entry.future = _Refused(error)

    def _first(self) -> Answer:
        """The answer of the first task of the window, whatever it takes."""
        entry = self._window[0]
        while entry.answer is None:
            trouble = self._ask(entry)
            if trouble is not None:
                self._recover(entry, trouble)
        return entry.answer

    def _ask(self, entry: _Entry) -> Exception | None:
        """Wait for an answer; returns the executor's trouble if there is none."""
        try:
            entry.answer = entry.future.result()
        except Exception as error:  # noqa: BLE001  (what tasks raise is an answer; executors raise what they like)
            return error
        return None

    def _recover(self, first: _Entry, trouble: Exception) -> None:
        """Replace broken workers and hand over again what they had."""
        lost = [first]
        if self._crew.loses_all:
            if not isinstance(trouble, BrokenExecutor):
                # A task or a result that cannot be sent.
                raise trouble
            lost = [entry for entry in self._window if entry.answer is None and self._ask(entry) is not None]
        self._crew.renew()
        for entry in lost:
            self._count_death(entry, trouble)
        for entry in lost:
            if entry.deaths >= _SUSPECT and self._crew.loses_all:
                self._alone(entry)
        for entry in lost:
            if entry.answer is None:
                self._hand_over(entry)

    def _alone(self, entry: _Entry) -> None:
        """Run a task with nothing beside it."""
        self._hand_over(entry)
        trouble = self._ask(entry)
        if trouble is not None:
            self._crew.renew()
            self._count_death(entry, trouble)

    def _count_death(self, entry: _Entry, trouble: Exception) -> None:
        entry.deaths += 1
        if entry.deaths >= _GUILTY:
            reason = " ".join(str(trouble).split())[:300]
            raise ExciteError(
                f"{self._stage}: {_name(entry)} ended its process, or got no answer, {entry.deaths} times "
                f"({type(trouble).__name__}: {reason}); give it more memory, or leave it out"
            ) from trouble


@dataclass(frozen=True, eq=False)
class _Refused:
    """A task that nobody took."""

    error: Exception

    def result(self) -> Answer:
        raise self.error


def _name(entry: _Entry) -> str:
    """A task's number, and its name where it has one."""
    name = entry.task if isinstance(entry.task, str) else getattr(entry.task, "name", None)
    return f"task {entry.number}" + (f" ({name})" if name else "")
