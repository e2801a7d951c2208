"""Who does the work: processes of this machine, or an executor that somebody else set up, such as a Dask cluster's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias, runtime_checkable

from excite.errors import InputError

# More than the hardware threads of any machine that one process of Python can fork on; a typing error, not a wish.
MOST_JOBS = 10_000


# Time for a scheduler to answer [s]: longer than one takes that is busy, shorter than patience with a wrong address.
TIMEOUT_S = 15.0


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
    wrong = ""
    if isinstance(number, bool) or not isinstance(number, int | Executor):
        wrong, remedy = f"is {jobs!r}", "give a number of processes, or an executor with a submit()"
    elif isinstance(number, int) and number < 1:
        wrong, remedy = f"is {number}", "ask for at least one process"
    elif isinstance(number, int) and number > MOST_JOBS:
        wrong = f"{number} asks for more processes than any machine runs"
        remedy = f"ask for at most {MOST_JOBS}, or give an executor of several machines"
    if wrong:
        raise InputError(wrong, field="jobs", remedy=remedy)
    return jobs


@contextmanager
def executor(address: str) -> Iterator[Executor]:
    """The workers of a Dask cluster, for as long as the block lasts; the cluster stays.

    Its workers need the same version of excite and a ``TMPDIR`` that they share with this machine. One thread a
    worker is enough: models are used by one thread of a process at a time. Where a worker dies, the scheduler gives
    its tasks to another one.

    Args:
        address: of the scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises:
        InputError: the package ``distributed`` is not installed, or no scheduler answers there within
            :data:`TIMEOUT_S`.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "needs the package distributed", field="--cluster", remedy="pip install 'excite[cluster]'"
        ) from error
    try:
        client = Client(address, timeout=TIMEOUT_S, set_as_default=False, name="excite")
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(
            f"no scheduler answers at {address!r} within {TIMEOUT_S:g} s",
            field="--cluster",
            remedy="give the address that `dask scheduler` prints, such as tcp://10.0.0.1:8786",
        ) from error
    try:
        # A key of its own for each task: a task that is run again is not to find the failure of the first run.
        yield client.get_executor(pure=False)
    finally:
        client.close(timeout=2)
