"""A round of work in other processes: few tasks in flight, dead workers replaced."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass
from typing import Any

from excite.errors import ExciteError
from excite.parallel.foreign import ForeignCrew
from excite.parallel.local import LocalCrew
from excite.parallel.shared import Shared, SharedFile
from excite.parallel.worker import Answer, perform

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
