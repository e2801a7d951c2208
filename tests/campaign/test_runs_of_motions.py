"""Which motions a virtual robot runs: those of its own that time makes a motion, of another version with a word."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import excite
from excite.errors import MotionError, RobotError
from excite.motion.motion import Motion
from excite.robot.robot import Robot


@pytest.fixture(scope="module")
def motion(ur10: Robot) -> Motion:
    return excite.load_motions("ur10")[0]


def stretched(time: np.ndarray, kind: str) -> np.ndarray:
    if kind == "a gap of an hour":
        return time + np.where(np.arange(len(time)) > len(time) // 2, 3600.0, 0.0)
    if kind == "thirty thousand years":
        return time * 1e12 / time[-1]
    if kind == "a billionth of a second":
        return time * 1e-9
    if kind == "backwards":
        return time[::-1].copy()
    return np.where(np.arange(len(time)) == 5, time[4], time)


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("a gap of an hour", "time_gap"),
        ("thirty thousand years", "time_gap"),
        ("a billionth of a second", "time_step"),
        ("backwards", "time_not_increasing"),
        ("a time that stands still", "time_not_increasing"),
    ],
)
def test_what_time_makes_no_motion_is_refused_in_a_line(
    kind: str, said: str, ur10: Robot, motion: Motion
) -> None:
    changed = [replace(motion, time=stretched(motion.time, kind))]
    for verb in (excite.simulate, excite.rank):
        with pytest.raises(MotionError, match=said) as refused:
            verb(ur10, changed)
        assert motion.name in str(refused.value)


def test_a_motion_of_another_robot_is_refused(ur10: Robot, motion: Motion) -> None:
    with pytest.raises(MotionError, match="is a motion of 'ur5', not of 'ur10'"):
        excite.simulate(ur10, [replace(motion, robot="ur5")])


def test_a_motion_of_another_version_is_run_and_said(ur10: Robot, motion: Motion) -> None:
    own = excite.simulate(ur10, [motion])
    assert own.other_version == ()
    assert "version" not in own.summary()
    other = replace(motion, metadata=replace(motion.metadata, robot_hash="0" * 64))
    run = excite.simulate(ur10, [other])
    assert run.to_json()["other_version"] == [motion.name]
    assert "another version of this robot" in run.summary()


def test_a_model_that_is_a_loop_of_links_is_refused_in_a_line(motion: Motion, tmp_path: Path) -> None:
    loop = tmp_path / "arm.urdf"
    loop.symlink_to(loop.name)
    with pytest.raises(RobotError, match=r"arm\.urdf: cannot be read .*; check"):
        excite.check(loop, [motion])
