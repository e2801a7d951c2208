"""Workers that somebody else set up, and who ends them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import WeakSet

from excite.parallel.jobs import Executor

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
