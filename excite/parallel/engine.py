"""All work in one process or several: results in order, and who does the work."""

from __future__ import annotations

import atexit
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sized
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import chain, islice
from typing import TYPE_CHECKING, Any, TypeVar, cast

from excite.errors import ExciteError, in_one_line
from excite.formats.child import processor_s
from excite.parallel.jobs import AtMost, Executor, Jobs, at_once, check_jobs
from excite.parallel.worker import Answer, Shared, begin_worker, perform_task
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

    def run_elsewhere(some: Iterable[Task], left: int | None) -> Iterator[Result]:
        file = None if common.value is None else common.file()
        yield from _Round(processes, left, (function, file), stage).results(some)

    if isinstance(processes, int) and (processes == 1 or (total is not None and total < 2)):
        results = _run_here(function, tasks, common.value)
    elif isinstance(jobs, AtMost):
        results = _begin_here(function, tasks, common.value, jobs.processes, total, run_elsewhere)
    else:
        results = run_elsewhere(tasks, total)
    return _report_progress(results, total, stage, progress)


def _report_progress(
    results: Iterator[Result], total: int | None, stage: str, progress: Progress
) -> Iterator[Result]:
    for done, result in enumerate(results, start=1):
        progress(stage, done, done if total is None else total)
        yield result


def _run_here(
    function: Callable[[Any, Task], Result], tasks: Iterable[Task], shared: Any
) -> Iterator[Result]:
    call = one_blas_thread(function)
    for task in tasks:
        yield call(shared, task)


def _begin_here(
    function: Callable[[Any, Task], Result],
    tasks: Iterable[Task],
    shared: Any,
    processes: int,
    total: int | None,
    run_elsewhere: Callable[[Iterable[Task], int | None], Iterator[Result]],
) -> Iterator[Result]:
    """Do tasks in this process until it is plain that others pay, which then do the rest."""
    source, seconds = iter(tasks), list[float]()
    for task in source:
        left = None if total is None else total - len(seconds)
        if _are_ready(processes, left) or _is_worth_starting(seconds, left, processes):
            yield from run_elsewhere(chain([task], source), left)
            return
        begun = processor_s()
        result = next(_run_here(function, [task], shared))
        seconds.append(processor_s() - begun)
        yield result


def _is_worth_starting(seconds: list[float], left: int | None, processes: int) -> bool:
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


# Tasks in flight of an executor: they keep a thousand cores busy; what waits is small, since tasks carry seeds and
# names of files. Of each worker here: what waits behind a slow task keeps the others busy. Candidates' times differ
# by a factor of ten at most, since those that fail early cost little.
_IN_FLIGHT, _IN_FLIGHT_A_WORKER = 2048, 8
# More workers than this share of the cores only wait for each other; no result depends on their number.
_WORKERS_A_CORE = 4
# How long idle workers wait for more work [s]; as joblib has it.
_IDLE_S = 300.0
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


@dataclass(frozen=True, eq=False)
class _Workers:
    """Processes of this machine.

    Attributes:
        executor: hands tasks to them.
        folder: that they were started in, from which they read relative paths.
    """

    executor: ProcessPoolExecutor
    folder: str


# By process, its workers that wait for more work.
_IDLE: dict[int, _Workers] = {}


def _find_folder() -> str:
    """The working directory; empty where it is gone."""
    try:
        return os.getcwd()
    except OSError:
        return ""


def _worker_numbers(jobs: int, total: int | None) -> tuple[int, int]:
    """Workers for so many tasks, and how many there may be at most."""
    jobs = min(jobs, _WORKERS_A_CORE * (os.cpu_count() or 1))
    return jobs if total is None else max(1, min(jobs, total)), jobs


def _are_ready(jobs: int, total: int | None) -> bool:
    """Whether workers wait that such a round of work would take."""
    least, most = _worker_numbers(jobs, total)
    waiting = _IDLE.get(os.getpid())
    if waiting is None or waiting.folder != _find_folder():
        return False
    return bool(least <= waiting.executor._max_workers <= most)


def _take_workers(jobs: int, total: int | None) -> _Workers:
    """Workers that wait already in this folder, or new ones.

    Loky's, which need no ``if __name__ == "__main__"`` in scripts and serve notebooks. They end with this process,
    whichever way that ends.
    """
    fit = _are_ready(jobs, total)
    waiting = _IDLE.pop(os.getpid(), None)
    if waiting is not None and fit:
        return waiting
    _kill_workers(waiting)
    from joblib.externals.loky import ProcessPoolExecutor
    from joblib.externals.loky.backend import resource_tracker

    # It removes the semaphores of a process that was killed; let it do so silently.
    said = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = "ignore:resource_tracker"
    try:
        resource_tracker.ensure_running()
    finally:
        os.environ.pop("PYTHONWARNINGS")
        os.environ.update({} if said is None else {"PYTHONWARNINGS": said})
    # What is registered last runs first: after the import of loky it is before multiprocessing waits for workers.
    _end_at_exit(os.getpid())
    executor = ProcessPoolExecutor(
        max_workers=_worker_numbers(jobs, total)[0],
        timeout=_IDLE_S,
        initializer=begin_worker,
        initargs=(os.getpid(),),
        env=_ENVIRONMENT,
    )
    return _Workers(executor, _find_folder())


@cache
def _end_at_exit(process: int) -> None:
    atexit.register(lambda: _kill_workers(_IDLE.pop(os.getpid(), None)))


@cache
def _starter_thread(process: int) -> ThreadPoolExecutor:
    """A thread that lasts as long as the process: Linux ends workers with the thread that started them."""
    return ThreadPoolExecutor(1, thread_name_prefix=f"excite-starter-{process}")


def _kill_workers(workers: _Workers | None) -> None:
    """End workers at once, whatever they do.

    From outside, as if the system had done it: of ``shutdown(kill_workers=True)`` the thread that manages them ends
    in a KeyError where tasks wait, on stderr and without tidying up.
    """
    if workers is not None:
        for number in tuple(workers.executor._processes):
            with suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        workers.executor.shutdown(wait=True)


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


class _Round:
    """One round of tasks in other processes: few in flight, dead workers replaced.

    Args:
        jobs: how many processes of this machine at most; or somebody's executor, which stays as it is.
        total: number of tasks, where it is known.
        call: function, and where what its tasks share is.
        stage: what errors call the work.
    """

    def __init__(
        self, jobs: int | Executor, total: int | None, call: tuple[Callable[..., Any], Any], stage: str
    ) -> None:
        self._jobs, self._total, self._call, self._stage = jobs, total, call, stage
        self._workers: _Workers | None = None
        self._window: deque[_Entry] = deque()
        self._local = isinstance(jobs, int)
        self._in_flight = (
            _IN_FLIGHT_A_WORKER * _worker_numbers(jobs, total)[0] if isinstance(jobs, int) else _IN_FLIGHT
        )

    def results(self, tasks: Iterable[Any]) -> Iterator[Any]:
        """What the tasks return, in order."""
        source = enumerate(tasks)
        try:
            self._fill_window(source)
            while self._window:
                answer = self._await_answer(self._window[0])
                self._window.popleft()
                self._fill_window(source)
                yield answer.given()
            if self._workers is not None:
                _kill_workers(_IDLE.pop(os.getpid(), None))
                _IDLE[os.getpid()], self._workers = self._workers, None
        finally:
            self._end_workers()

    def _end_workers(self) -> None:
        """End the workers; of an executor take back what has not begun."""
        if self._local:
            workers, self._workers = self._workers, None
            _kill_workers(workers)
        else:
            for entry in self._window:
                entry.future.cancel()

    def _fill_window(self, source: Iterator[tuple[int, Any]]) -> None:
        for following in islice(source, self._in_flight - len(self._window)):
            entry = _Entry(*following)
            self._window.append(entry)
            self._hand_over(entry)

    def _hand_over(self, entry: _Entry) -> None:
        try:
            entry.future = self._submit_task(perform_task, *self._call, entry.task)
        except (RuntimeError, OSError) as error:
            # Workers that died while they waited: what executors raise then is a RuntimeError.
            entry.future = Future()
            entry.future.set_exception(error)

    def _submit_task(self, *call: Any) -> Any:
        if not isinstance(self._jobs, int):
            return self._jobs.submit(*call)
        if self._workers is None:
            self._workers = _take_workers(self._jobs, self._total)
        # Workers start with a task.
        return _starter_thread(os.getpid()).submit(self._workers.executor.submit, *call).result()

    def _await_answer(self, entry: _Entry) -> Answer:
        """The answer of the first task of the window, whatever it takes."""
        while (trouble := self._ask_future(entry)) is not None:
            self._recover_workers(entry, trouble)
        return cast(Answer, entry.answer)

    def _ask_future(self, entry: _Entry) -> Exception | None:
        """Wait for an answer; returns the executor's trouble if there is none."""
        try:
            entry.answer = entry.answer or entry.future.result()
        except Exception as error:  # noqa: BLE001  (what tasks raise is an answer; executors raise what they like)
            return error
        return None

    def _recover_workers(self, first: _Entry, trouble: Exception) -> None:
        """Replace broken workers and hand over again what they had."""
        lost = [first]
        if self._local:
            if not isinstance(trouble, BrokenExecutor):
                # A task or a result that cannot be sent.
                raise trouble
            lost = [entry for entry in self._window if self._ask_future(entry) is not None]
            self._end_workers()
        for entry in lost:
            self._count_death(entry, trouble)
        for entry in lost:
            if entry.deaths >= _SUSPECT and self._local:
                # With nothing beside it.
                self._hand_over(entry)
                if (again := self._ask_future(entry)) is not None:
                    self._end_workers()
                    self._count_death(entry, again)
        for entry in lost:
            if entry.answer is None:
                self._hand_over(entry)

    def _count_death(self, entry: _Entry, trouble: Exception) -> None:
        entry.deaths += 1
        if entry.deaths < _GUILTY:
            return
        name = entry.task if isinstance(entry.task, str) else getattr(entry.task, "name", None)
        raise ExciteError(
            f"{self._stage}: task {entry.number}{f' ({name})' if name else ''} ended its process, or got no answer, "
            f"{entry.deaths} times ({type(trouble).__name__}: {in_one_line(trouble)[:300]}); give it more "
            "memory, or leave it out"
        ) from trouble
