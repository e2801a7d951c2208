"""Who does the work: a number of processes of this machine, or an executor that somebody else set up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias, runtime_checkable

from excite.errors import InputError

# More than the hardware threads of any machine that one process of Python can fork on; a typing error, not a wish.
MOST_JOBS = 10_000


@runtime_checkable
class Executor(Protocol):
    """What takes work: :class:`concurrent.futures.Executor`, Dask's, submitit's.

    ``submit`` returns an object with ``result()`` and ``cancel()``.
    """

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any:
        """Have ``function(*arguments)`` called somewhere, some time."""


@dataclass(frozen=True)
class AtMost:
    """Processes of this machine that are started once the work has turned out to be worth it.

    Attributes:
        processes: how many at most.
    """

    processes: int


Jobs: TypeAlias = int | AtMost | Executor
"""A number of processes, a largest number of them, or an executor; no result depends on which."""


def at_once(jobs: Jobs) -> int | Executor:
    """The same processes from the first task on, for work of which one task is worth their start."""
    return jobs.processes if isinstance(jobs, AtMost) else jobs


def check_jobs(jobs: Jobs) -> Jobs:
    """Return what was given.

    Raises:
        InputError: a number below 1 or above :data:`MOST_JOBS`, or neither a number nor an executor.
    """
    number = jobs.processes if isinstance(jobs, AtMost) else jobs
    if isinstance(number, bool) or not isinstance(number, int | Executor):
        raise InputError(
            f"is {jobs!r}", field="jobs", remedy="give a number of processes, or an executor with a submit()"
        )
    if isinstance(number, int) and number < 1:
        raise InputError(f"is {number}", field="jobs", remedy="ask for at least one process")
    if isinstance(number, int) and number > MOST_JOBS:
        raise InputError(
            f"{number} asks for more processes than any machine runs",
            field="jobs",
            remedy=f"ask for at most {MOST_JOBS}, or give an executor of several machines",
        )
    return jobs
