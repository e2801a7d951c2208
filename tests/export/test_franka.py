"""Rows for libfranka: read back by numpy, and held against limits that are computed here in another way."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.errors import MotionError, UnsafeMotionError
from excite.export.export import export_motion
from excite.export.makers import LIMITS, franka_violations
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from tests.safety.motions import check_file

ROBOT = "panda"


def test_numpy_reads_a_row_a_millisecond(arm: Robot, motion: Motion, tmp_path: Path) -> None:
    path = export_motion(motion, arm, "franka", tmp_path / "first")
    same = np.load(export_motion(motion, arm, "npz", tmp_path / "same", 1000.0))
    rows = np.loadtxt(path)
    np.testing.assert_array_equal(rows, np.hstack([same["q"], same["v"], same["a"]]))
    assert len(rows) == pytest.approx(1000 * motion.duration, abs=2)
    head = [line[2:] for line in path.read_text().splitlines() if line.startswith("#")]
    said = json.loads(head[-1])
    assert said["columns"][::7] == [f"{x}.panda_joint1" for x in "qva"] and said["verdict"]["safe"]
    verdict = check_file(arm, path)
    assert verdict.safe


def jolt(arm: Robot, motion: Motion, size: float) -> Motion:
    """A bend of the last joint whose acceleration jumps by ``size`` [rad/s²] from one millisecond to the next."""
    time = np.arange(0.0, 1.0005, 0.001)
    a = np.select([time < 0.25, time < 0.75, time <= 1.0], [size, -size, size])
    a[[0, -1]] = 0.0
    v = np.cumsum(a) * 0.001
    joint = np.zeros((len(time), 7))
    q, rates, accelerations = np.tile(arm.rest, (len(time), 1)), joint.copy(), joint.copy()
    q[:, 6] += np.cumsum(v) * 0.001
    rates[:, 6], accelerations[:, 6] = v, a
    return replace(motion, time=time, q=q, v=rates, a=accelerations)


def test_jumps_of_acceleration_that_franka_would_stop_at_do_not_leave(
    arm: Robot, motion: Motion, tmp_path: Path
) -> None:
    # 10 000 rad/s³ is the limit of the last joint: 10 rad/s² a millisecond; the jump in the middle is twice as large.
    rough = jolt(arm, motion, 6.0)
    with pytest.raises(UnsafeMotionError) as caught:
        export_motion(rough, arm, "franka", tmp_path / "rough")
    kinds = {violation.kind for violation in caught.value.verdicts[0].violations}
    assert "franka_jerk" in kinds and not list(tmp_path.iterdir())
    path = export_motion(rough, arm, "franka", tmp_path / "rough", unsafe_anyway="a simulator")
    assert path.read_text().startswith("# UNSAFE: written all the same, a simulator\n")


@pytest.mark.parametrize("model", LIMITS)
def test_limits_hold_to_the_last_digit_and_no_farther(model: str) -> None:
    limits = LIMITS[model]
    names = tuple("abcdefg")
    middle = np.array([0.0, 0.0, 0.0, -1.6, 0.0, 2.5, 0.0])
    for share, beyond in ((0.99, False), (1.01, True)):
        for order, values in ((2, limits.acceleration), (3, limits.jerk)):
            # A polynomial whose difference of that order is a constant share of the limit.
            k = np.arange(20, dtype=float)
            falling = np.prod([k - i for i in range(order)], axis=0) * 1e-3**order
            q = middle + share * np.array(values) * falling[:, None] / np.prod(np.arange(1, order + 1))
            rates = {2: "franka_acceleration", 3: "franka_jerk"}[order]
            found = {
                v.where for v in franka_violations(limits, q, names) if v.kind == rates and v.time_s < 0.019
            }
            # The first difference of second order also jumps from standing still, which is jerk and not acceleration.
            assert (found == set(names)) if beyond else not found


def test_limits_are_those_of_the_makers_page(arm: Robot) -> None:
    """Franka Control Interface documentation, *Robot and interface specifications*, limits in joint space."""
    panda, research = LIMITS["panda"], LIMITS["fr3"]
    assert panda.velocity == (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
    assert panda.acceleration == (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
    assert panda.jerk == (7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0)
    assert research.velocity == (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26)
    assert research.acceleration == (10.0,) * 7
    assert research.jerk == (5000.0,) * 7
    # The bundled robot says the same, positions and torques of the same page in its URDF.
    ends = (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973)
    for found, said in (
        (arm.limits.acceleration, panda.acceleration),
        (arm.limits.jerk, panda.jerk),
        (arm.limits.torque, (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)),
        (arm.limits.position_upper + 0.05, ends),
    ):
        np.testing.assert_allclose(found, said, rtol=1e-6)


def test_a_research_3_slows_down_towards_its_ends() -> None:
    limits, names = LIMITS["fr3"], tuple("abcdefg")
    q = np.array([[2.6, 0.0, 0.0, -1.6, 0.0, 2.5, 0.0]])
    low, high = limits.velocity_bounds(q)
    assert high[0, 0] == pytest.approx(np.sqrt(12.0 * (2.7501 - 2.6)) - 0.3) and low[0, 0] == -2.62
    assert high[0, 1] == 2.62 and limits.velocity_bounds(-q)[0][0, 0] == pytest.approx(-high[0, 0])
    fast = np.tile(q, (30, 1))
    fast[:, 0] = 2.6 + 2.0e-3 * np.arange(30)
    found = [v for v in franka_violations(limits, fast, names) if v.kind == "franka_velocity"]
    assert [v.where for v in found] == ["a"] and found[0].limit < 2.0
    assert not [v for v in franka_violations(limits, fast[::-1], names) if v.kind == "franka_velocity"]


def test_damaged_rows_are_one_line(arm: Robot, motion: Motion, tmp_path: Path) -> None:
    path = export_motion(motion, arm, "franka", tmp_path / "first")
    text = path.read_text()
    for spoilt in (text.replace('"rate_hz": 1000.0', '"rate_hz": 0'), text + "1 2 3\n", text + "a b c\n"):
        path.write_text(spoilt)
        with pytest.raises(MotionError) as caught:
            load_motion(path, arm)
        assert "\n" not in str(caught.value)
