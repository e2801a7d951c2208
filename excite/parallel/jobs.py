"""How many processes of this machine do the work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from excite.errors import InputError

# More than the hardware threads of any machine that one process of Python can fork on; a typing error, not a wish.
MOST_JOBS = 10_000


@dataclass(frozen=True)
class AtMost:
    """Processes of this machine that are started once the work has turned out to be worth it.

    Attributes:
        processes: how many at most.
    """

    processes: int


Jobs: TypeAlias = int | AtMost
"""A number of processes, or a largest number of them; no result depends on which."""


def at_once(jobs: Jobs) -> int:
    """The same processes from the first task on, for work of which one task is worth their start."""
    return jobs.processes if isinstance(jobs, AtMost) else jobs


def check_jobs(jobs: Jobs) -> Jobs:
    """Return what was given.

    Raises:
        InputError: a number below 1 or above :data:`MOST_JOBS`.
    """
    number = jobs.processes if isinstance(jobs, AtMost) else jobs
    wrong = ""
    if isinstance(number, bool) or not isinstance(number, int):
        wrong, remedy = f"is {jobs!r}", "give a number of processes"
    elif number < 1:
        wrong, remedy = f"is {number}", "ask for at least one process"
    elif number > MOST_JOBS:
        wrong = f"{number} asks for more processes than any machine runs"
        remedy = f"ask for at most {MOST_JOBS}"
    if wrong:
        raise InputError(wrong, field="jobs", remedy=remedy)
    return jobs
