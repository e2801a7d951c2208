"""The engine: order, equal bytes everywhere, bounds, errors, and workers that die."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from excite import errors
from excite.errors import ExciteError, InputError
from excite.parallel.engine import in_order
from excite.parallel.jobs import MOST_JOBS, AtMost
from excite.parallel.worker import Shared, SharedFile, load_shared
from tests.parallel import work


def test_results_come_in_order_and_are_the_same_bytes_in_one_process_or_two() -> None:
    alone = list(in_order(work.draw, range(20), shared=7))
    assert [seed for seed, _ in alone] == list(range(20))
    assert list(in_order(work.draw, range(20), jobs=2, shared=7)) == alone
    assert list(in_order(work.draw, range(20), jobs=AtMost(2), shared=7)) == alone


def test_several_jobs_are_several_processes_and_one_is_this_one() -> None:
    assert set(in_order(work.process, range(5))) == {os.getpid()}
    assert os.getpid() not in set(in_order(work.process, range(5), jobs=2))


@pytest.fixture
def cheap_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """None of them waits, as in a command that has just begun, and their start is taken to cost 0.1 s of a core."""
    results = in_order(work.identity, range(1000), jobs=2)
    next(results)
    results.close()  # type: ignore[attr-defined]
    monkeypatch.setattr("excite.parallel.engine._START_S", 0.1)


@pytest.mark.usefixtures("cheap_workers")
def test_short_work_is_done_here_and_long_work_by_others_from_where_it_shows() -> None:
    assert set(in_order(work.process, range(40), jobs=AtMost(2))) == {os.getpid()}
    assert set(in_order(work.process, iter(range(40)), jobs=AtMost(2))) == {os.getpid()}
    done = list(in_order(work.busy, range(20), jobs=AtMost(2), shared=0.02))
    assert [number for number, _ in done] == list(range(20))
    # The first task tells little; the second that 18 of 0.02 s are left, 0.18 s for two.
    assert [process == os.getpid() for _, process in done] == [True] * 2 + [False] * 18
    assert os.getpid() not in set(in_order(work.process, range(5), jobs=AtMost(2))), "workers wait already"


@pytest.mark.usefixtures("cheap_workers")
@pytest.mark.parametrize(("tasks", "seconds", "here"), [(3, 0.25, 1), (3, 0.02, 3)])
def test_one_long_task_is_enough_to_start_others(tasks: int, seconds: float, here: int) -> None:
    done = list(in_order(work.busy, range(tasks), jobs=AtMost(2), shared=seconds))
    assert [process == os.getpid() for _, process in done] == [True] * here + [False] * (tasks - here)


@pytest.mark.usefixtures("cheap_workers")
def test_where_nobody_knows_how_much_is_left_others_begin_when_it_has_lasted() -> None:
    done = list(in_order(work.busy, iter(range(30)), jobs=AtMost(2), shared=0.02))
    assert [number for number, _ in done] == list(range(30))
    here = [process == os.getpid() for _, process in done]
    assert 8 < sum(here) < 15 and here == sorted(here, reverse=True)


def test_workers_are_kept_for_the_next_round() -> None:
    first = set(in_order(work.process, range(40), jobs=2))
    assert first & set(in_order(work.process, range(40), jobs=2))


def test_workers_read_relative_paths_from_where_their_work_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    list(in_order(work.process, range(40), jobs=2))
    monkeypatch.chdir(tmp_path)
    assert set(in_order(work.folder, range(4), jobs=2)) == {str(tmp_path)}


@pytest.mark.parametrize("jobs", [1, 2])
def test_tasks_are_not_taken_ahead_of_what_is_in_flight(jobs: int) -> None:
    taken: list[int] = []
    results = in_order(work.identity, work.counted(100_000, taken), jobs=jobs)
    assert taken == []
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    assert len(taken) <= {1: 3, 2: 20}[jobs]
    results.close()  # type: ignore[attr-defined]
    after = len(taken)
    time.sleep(0.1)
    assert len(taken) == after


def test_progress_is_told_of_each_result() -> None:
    told: list[tuple[str, int, int]] = []
    list(in_order(work.identity, range(3), jobs=2, stage="try", progress=lambda *news: told.append(news)))
    assert told == [("try", 1, 3), ("try", 2, 3), ("try", 3, 3)]


@pytest.mark.parametrize("jobs", [1, 2])
def test_errors_come_as_they_are_after_the_results_before_them(jobs: int) -> None:
    results = in_order(work.refuse_three, range(9), jobs=jobs)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(InputError, match=r"^tasks: number: is 3; give less$") as caught:
        next(results)
    assert (caught.value.what, caught.value.field) == ("is 3", "number")


def test_an_error_that_nobody_foresaw_says_where_it_was_raised() -> None:
    with pytest.raises(ZeroDivisionError) as caught:
        list(in_order(work.unforeseen, range(4), jobs=2))
    assert "return number // 0" in "".join(caught.value.__notes__)


def test_a_task_that_cannot_be_sent_says_so() -> None:
    with pytest.raises(Exception, match="pickle"):
        list(in_order(work.identity, [threading.Lock(), threading.Lock()], jobs=2))


@pytest.mark.parametrize(
    ("jobs", "what"),
    [
        (0, "at least one"),
        (AtMost(0), "at least one"),
        (AtMost(10**9), "more processes than any machine"),
        (AtMost(True), "number of processes"),
        (-1, "at least one"),
        (10**9, "more processes than any machine"),
        (MOST_JOBS + 1, "more processes"),
        (True, "number of processes"),
        (2.0, "number of processes"),
        ("2", "number of processes"),
    ],
)
def test_jobs_that_nobody_can_mean_are_refused_before_any_work(jobs: object, what: str) -> None:
    with pytest.raises(InputError, match=what):
        in_order(work.identity, range(3), jobs=jobs)  # type: ignore[arg-type]


def test_many_jobs_start_no_more_workers_than_tasks_or_cores_bear() -> None:
    found = set(in_order(work.process, range(3), jobs=MOST_JOBS))
    assert len(found) <= 3


def test_a_killed_worker_costs_time_and_no_result(tmp_path: Path) -> None:
    marker = tmp_path / "died"
    assert list(in_order(work.die_once, range(40), jobs=2, shared=marker)) == list(range(40))
    assert marker.exists()


def test_a_task_that_kills_every_worker_is_named_and_only_that() -> None:
    with pytest.raises(ExciteError, match=r"screen: task 5 .*3 times") as caught:
        list(in_order(work.poison, range(40), jobs=2, stage="screen"))
    assert "\n" not in str(caught.value)


def test_a_shared_value_is_read_once_and_checked(tmp_path: Path) -> None:
    shared = Shared({"robot": 1})
    file = shared.file()
    assert shared.file() is file
    assert load_shared(file) is load_shared(SharedFile(tmp_path / "elsewhere", file.digest))
    (tmp_path / "other").write_bytes(pickle.dumps(2))
    with pytest.raises(InputError, match="another content"):
        load_shared(SharedFile(tmp_path / "other", "0" * 64))
    with pytest.raises(InputError, match=r"cannot be read .*all machines share"):
        load_shared(SharedFile(tmp_path / "missing", "1" * 64))


def _every_error() -> list[ExciteError]:
    """One of each class of errors, of excite's rooms too, with all that it can carry."""
    known = {
        "InputError": errors.InputError("is 1", source="a.yaml", field="mass", remedy="give 2"),
        "RobotError": errors.RobotError("is 1", source=Path("a.yaml"), field="mass", remedy="give 2"),
        "MotionError": errors.MotionError("is 1", field="q"),
        "OtherRobotError": errors.OtherRobotError("g1", "ur10", "a.parquet"),
        "LogError": errors.LogError("is 1", source="log"),
        "NothingThereError": errors.NothingThereError("no columns of numbers", source="notes.txt"),
        "PlugInError": errors.PlugInError("returned 1", source="effect mine", remedy="mend it"),
        "UnknownNameError": errors.UnknownNameError("joint", "elbow", ["knee", "hip"]),
        "IllLogError": errors.IllLogError("no torques", source="log.yaml", findings=["bad"]),
        "NothingSafeError": errors.NothingSafeError("none is safe", best={"refused": 3}, remedy="more room"),
        "UnsafeMotionError": errors.UnsafeMotionError("falls", verdicts=["bad"], remedy="no"),
        "NoSolutionError": errors.NoSolutionError("none", best=[1, 2], remedy="more"),
        "ExciteError": errors.ExciteError("plain"),
    }
    defined = {
        name
        for name, kind in vars(errors).items()
        if isinstance(kind, type) and issubclass(kind, ExciteError)
    }
    assert defined == set(known)
    return list(known.values())


@pytest.mark.parametrize("error", _every_error(), ids=lambda error: type(error).__name__)
def test_errors_reach_another_process_with_all_that_they_carry(error: ExciteError) -> None:
    found = pickle.loads(pickle.dumps(error))  # noqa: S301
    assert type(found) is type(error)
    assert str(found) == str(error)
    assert vars(found) == vars(error)


def test_the_engine_loads_nothing_heavy() -> None:
    code = "import sys, excite.parallel.engine; print([m for m in ('numpy', 'joblib', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's settings")
def test_workers_keep_memory_that_arrays_have_freed() -> None:
    assert max(in_order(work.pages_fetched, [10, 10], jobs=2)) < 4096, "all of them: nine times 4096 pages"
