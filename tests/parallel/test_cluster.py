"""A Dask cluster does the same work to the same bytes, and the errors on the way to one are one line."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from excite.campaign.assessment import check
from excite.cli.main import _run_command
from excite.errors import InputError
from excite.motion.generators.mixture import plan_candidates, plan_proposals
from excite.parallel.engine import in_order
from excite.parallel.jobs import executor
from excite.robot.loading import load_robot
from excite.safety.filter import FilterReport, filter_candidates
from tests.parallel import work

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two worker processes of one thread each."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as made:
        yield made


def test_dask_returns_the_same_bytes_in_order(cluster: Any) -> None:
    with executor(cluster.scheduler_address) as crew:
        found = list(in_order(work.draw, range(20), jobs=crew, shared=7))
        assert os.getpid() not in set(in_order(work.process, range(4), jobs=crew))
    assert found == list(in_order(work.draw, range(20), shared=7))


def test_errors_of_tasks_come_as_they_are(cluster: Any) -> None:
    with executor(cluster.scheduler_address) as crew, pytest.raises(InputError, match="is 3; give less"):
        list(in_order(work.refuse_three, range(9), jobs=crew))


def test_candidates_are_judged_to_the_same_bytes(cluster: Any) -> None:
    robot, seed = load_robot("ur10"), np.random.SeedSequence(5)
    here = filter_candidates(robot, plan_candidates(robot, 4, seed))
    two = filter_candidates(robot, plan_proposals(robot, 4, seed), jobs=2)
    with executor(cluster.scheduler_address) as crew:
        there = filter_candidates(robot, plan_proposals(robot, 4, seed), jobs=crew, total=4)
        verdicts = check(robot, here.motions, jobs=crew)
    assert _bytes(here) == _bytes(two) == _bytes(there)
    assert json.dumps(verdicts.to_json()) == json.dumps(check(robot, here.motions).to_json())


def _bytes(report: FilterReport) -> list[tuple[str, str | None, bytes]]:
    return [
        (
            outcome.candidate,
            None if outcome.rejection is None else outcome.rejection.reason,
            b"" if outcome.motion is None else outcome.motion.q.tobytes() + outcome.motion.time.tobytes(),
        )
        for outcome in report.outcomes
    ]


def test_a_killed_worker_costs_time_and_no_result(cluster: Any, tmp_path: Path) -> None:
    with executor(cluster.scheduler_address) as crew:
        found = list(in_order(work.die_once, range(40), jobs=crew, shared=tmp_path / "died"))
    assert found == list(range(40))
    assert (tmp_path / "died").exists()


def test_a_wrong_address_is_one_line_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("excite.parallel.jobs.TIMEOUT_S", 2.0)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    for wrong in (address, "nonsense", "ftp://x:1", ""):
        started = time.monotonic()
        with pytest.raises(InputError, match=r"no scheduler answers.*dask scheduler"), executor(wrong):
            pass
        assert time.monotonic() - started < 5.0


def test_a_missing_package_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'excite\[cluster\]'"), executor("tcp://127.0.0.1:1"):
        pass


@pytest.mark.slow
def test_a_command_plans_on_a_cluster_to_the_same_bytes(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ("plan", "ur10", "--candidates", "4", "--seed", "1")
    monkeypatch.chdir(tmp_path)
    assert _run_command([*arguments, "--cluster", cluster.scheduler_address, "--out", "there"]) == 0
    assert _run_command([*arguments, "--jobs", "1", "--out", "here"]) == 0
    names = sorted(path.name for path in (tmp_path / "here" / "motions").iterdir())
    assert names == sorted(path.name for path in (tmp_path / "there" / "motions").iterdir())
    for name in names:
        files = [tmp_path / place / "motions" / name for place in ("here", "there")]
        assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (("--jobs", "2", "--cluster", "tcp://127.0.0.1:1"), "not both"),
        (("--jobs", "1000000000"), "more processes than any machine runs"),
        (("--jobs", "0"), "at least one"),
        (("--jobs", "-3"), "at least one"),
    ],
)
def test_options_that_nobody_can_mean_are_refused_in_one_line(
    options: tuple[str, ...],
    what: str,
    tmp_path: Path,
    excite_here: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    done = excite_here("plan", "ur10", *options, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and what in done.stderr
    assert not list(tmp_path.iterdir())
