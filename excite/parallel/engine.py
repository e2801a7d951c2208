"""All work in one process or several: results in order, and who does the work."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sized
from itertools import chain
from typing import Any, TypeVar

from excite.parallel.foreign import ForeignCrew
from excite.parallel.jobs import AtMost, Jobs, at_once, check_jobs
from excite.parallel.local import LocalCrew, ready_for
from excite.parallel.round import Round
from excite.parallel.shared import Shared
from excite.progress import Progress, silent
from excite.threads import one_blas_thread

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
