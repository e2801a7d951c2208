"""All work in several processes: results in order, few tasks in flight, dead workers replaced."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sized
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

from excite.errors import ExciteError
from excite.parallel.foreign import ForeignCrew
from excite.parallel.jobs import Jobs, check_jobs
from excite.parallel.local import LocalCrew
from excite.parallel.shared import Shared, SharedFile
from excite.parallel.worker import Answer, perform
from excite.progress import Progress, silent

Task = TypeVar("Task")
Result = TypeVar("Result")

# A task whose worker died may have been beside the one that killed it, or the machine short of memory. After two
# deaths it is run with nothing beside it; a third one is its own.
_SUSPECT, _GUILTY = 2, 3


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
        jobs: number of processes, 1 for this one alone; or an executor, whose workers may be on other machines: they
            need the same version of excite, and a ``TMPDIR`` that they share with this one.
        shared: what all calls need. It goes to a file of the temporary folder once, and once from there into each
            worker. A :class:`~excite.parallel.shared.Shared` serves several rounds.
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
    if isinstance(jobs, int) and (jobs == 1 or (total is not None and total < 2)):
        results = _here(function, tasks, common.value)
    else:
        crew = LocalCrew(jobs, total) if isinstance(jobs, int) else ForeignCrew(jobs)
        results = _Round(crew, function, common, stage).results(tasks)
    return _told(results, total, stage, progress)


def _told(results: Iterator[Result], total: int | None, stage: str, progress: Progress) -> Iterator[Result]:
    done = 0
    for result in results:
        done += 1
        progress(stage, done, done if total is None else total)
        yield result


def _here(function: Callable[[Any, Task], Result], tasks: Iterable[Task], shared: Any) -> Iterator[Result]:
    from excite.threads import one_blas_thread  # lazy: scipy

    call = one_blas_thread(function)
    for task in tasks:
        yield call(shared, task)


@dataclass(eq=False)
class _Entry:
    """A task in flight, or one that is to be handed over again."""

    number: int
    task: Any
    future: Any = None
    answer: Answer | None = None
    deaths: int = 0


class _Round:
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
