"""The verdict on good motions, and on bad ones for the right reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import InputError, MotionError
from excite.motion.files import save_motion
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.check import CHECKS, check_motion
from excite.safety.checks.joints import drive_torques
from excite.safety.checks.motion import judge_sampling
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import MARGIN_FIELDS, CheckReport
from tests.safety.motions import (
    arm_motion,
    check_file,
    moved_base,
    moved_joint,
    smooth,
    squat,
    standing_motion,
)


def kinds(robot: Robot, motion: Motion) -> set[str]:
    """Kinds of what is violated; the motion must be unsafe."""
    verdict = check_motion(robot, motion)
    assert not verdict.safe
    return {violation.kind for violation in verdict.violations}


def hill(motion: Motion, height: float) -> np.ndarray:
    """An offset that rises to ``height`` and comes back over the motion."""
    s = (motion.time - motion.time[0]) / motion.duration
    return height * smooth(2.5 * s) * smooth(2.5 * (1.0 - s))


# --- Good motions


def test_squat_is_safe_with_every_margin(humanoid: Robot, squatting: Motion) -> None:
    verdict = check_motion(humanoid, squatting)
    assert verdict.safe, verdict.violations
    assert verdict.not_applicable == ()
    for name in MARGIN_FIELDS:
        assert getattr(verdict.margins, name) > 0.0


def test_arm_is_safe_and_has_no_zmp(arm: Robot, swinging: Motion) -> None:
    verdict = check_motion(arm, swinging)
    assert verdict.safe, verdict.violations
    assert verdict.margins.zmp_m is None
    assert verdict.to_json()["not_applicable"] == ["zmp_m"]


def test_rest_margins_are_those_of_the_samples(arm: Robot, swinging: Motion) -> None:
    margins = check_motion(arm, swinging).margins
    dense = swinging.resampled(arm, 5000.0)
    limits = arm.limits
    position = np.minimum(dense.q - limits.position_lower, limits.position_upper - dense.q).min()
    assert margins.joint_position_rad == pytest.approx(position, abs=1e-5)
    assert margins.joint_velocity_rad_s == pytest.approx((limits.velocity - np.abs(dense.v)).min(), abs=1e-4)
    acceleration = (limits.acceleration - np.abs(dense.a)).min()
    assert margins.joint_acceleration_rad_s2 == pytest.approx(acceleration, abs=0.01)
    # Bounds on every instant are never on the generous side.
    assert margins.joint_acceleration_rad_s2 <= acceleration + 1e-9


def test_document_follows_the_contract(arm: Robot, swinging: Motion) -> None:
    document = CheckReport((check_motion(arm, swinging),)).to_json()
    assert document["schema"] == "excite.check/1"
    assert document["safe"] is True
    assert list(document["motions"][0]["margins"]) == list(MARGIN_FIELDS)
    assert CheckReport(()).to_json()["safe"] is False


# --- Every check


@pytest.mark.parametrize("name", list(CHECKS))
def test_check_battery(name: str, humanoid: Robot, squatting: Motion, arm: Robot, swinging: Motion) -> None:
    check = CHECKS[name]
    assert check.name == name
    for robot, motion in ((humanoid, squatting), (arm, swinging)):
        arrays = [x.copy() for x in (motion.time, motion.q, motion.v, motion.a)]
        result = check().judge(Sweep(robot, motion))
        assert result == check().judge(Sweep(robot, motion)), "the same motion gives the same result"
        assert result.violations == ()
        assert result.readable
        if check.margin_field is not None and result.applicable:
            assert check.margin_field in MARGIN_FIELDS
            assert result.margin is not None
        same = zip(arrays, (motion.time, motion.q, motion.v, motion.a), strict=True)
        assert all(np.array_equal(before, after) for before, after in same), "the motion is left alone"


def test_sampling_runs_first_and_every_margin_has_one_check() -> None:
    assert next(iter(CHECKS)) == "sampling"
    filled = [check.margin_field for check in CHECKS.values() if check.margin_field is not None]
    assert sorted(filled) == sorted(MARGIN_FIELDS)


# --- Limits


@pytest.mark.parametrize(("share", "bad"), [(1.01, True), (0.99, False)])
def test_position_limit(share: float, bad: bool, arm: Robot, swinging: Motion) -> None:
    upper = arm.limits.position_upper[0]
    still = arm_motion(arm, amplitude=0.0, duration=12.0)
    motion = moved_joint(arm, still, arm.joint_names[0], hill(still, share * upper - arm.rest[0]))
    verdict = check_motion(arm, motion)
    found = [v for v in verdict.violations if v.kind == "joint_position"]
    assert bool(found) is bad
    assert verdict.margins.joint_position_rad == pytest.approx((1.0 - share) * upper, abs=1e-6)
    if bad:
        assert found[0].where == arm.joint_names[0]
        assert found[0].limit == pytest.approx(upper)


def oscillation(motion: Motion, amplitude: float, frequency: float) -> np.ndarray:
    """A sine with smooth ends."""
    s = (motion.time - motion.time[0]) / motion.duration
    window = smooth(4.0 * s) * smooth(4.0 * (1.0 - s))
    return amplitude * window * np.sin(frequency * (motion.time - motion.time[0]))


@pytest.mark.parametrize(("share", "bad"), [(1.01, True), (0.99, False)])
def test_velocity_limit(share: float, bad: bool, arm: Robot) -> None:
    still = arm_motion(arm, amplitude=0.0, duration=8.0)
    frequency, joint = 6.0, arm.joint_names[-1]
    amplitude = share * arm.limits.velocity[-1] / frequency
    verdict = check_motion(arm, moved_joint(arm, still, joint, oscillation(still, amplitude, frequency)))
    assert ("joint_velocity" in {v.kind for v in verdict.violations}) is bad


@pytest.mark.parametrize(("share", "bad"), [(1.01, True), (0.99, False)])
def test_acceleration_limit(share: float, bad: bool, humanoid: Robot) -> None:
    still = squat(humanoid, depth=0.0, sway=0.0)
    joint, frequency = "left_wrist_roll_joint", 30.0
    limit = humanoid.limits.acceleration[humanoid.joint_index(joint)]
    motion = moved_joint(humanoid, still, joint, oscillation(still, share * limit / frequency**2, frequency))
    found = {v.kind for v in check_motion(humanoid, motion).violations}
    assert ("joint_acceleration" in found) is bad
    # So fast an oscillation has a jerk of half as much again as its limit.
    assert found - {"joint_acceleration"} == {"joint_jerk"}


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_torque_peak(share: float, humanoid: Robot, squatting: Motion) -> None:
    peak = np.abs(drive_torques(Sweep(humanoid, squatting))).max(axis=0)
    torque = humanoid.limits.torque.copy()
    knee = humanoid.joint_index("left_knee_joint")
    torque[knee] = share * peak[knee]
    weak = replace(humanoid, limits=replace(humanoid.limits, torque=torque))
    verdict = check_motion(weak, squatting)
    assert verdict.safe is (share > 1.0)
    assert verdict.margins.joint_torque_nm == pytest.approx((share - 1.0) * peak[knee], abs=1e-9)
    assert all((v.kind, v.where) == ("joint_torque", "left_knee_joint") for v in verdict.violations)


# --- Balance and feet


def test_zmp_out_for_20_ms(humanoid: Robot) -> None:
    still = squat(humanoid, depth=0.0, sway=0.0)
    time = still.time
    # A pulse of acceleration of 25 ms at its foot, paid back slowly on both sides.
    pulse = np.maximum(0.0, 1.0 - ((time - 1.5) / 0.0125) ** 2) ** 2
    slow = np.maximum(0.0, 1.0 - ((time - 1.5) / 1.0) ** 2) ** 2
    slow *= pulse.sum() / slow.sum()
    path = np.cumsum(np.cumsum(pulse - slow)) * (time[1] - time[0]) ** 2
    pelvis = np.column_stack([8.0 * path, 0.0 * path, 0.0 * path])
    motion = standing_motion(humanoid, pelvis)
    verdict = check_motion(humanoid, motion)
    assert {v.kind for v in verdict.violations} <= {"zmp", "contact_wrench", "joint_jerk"}
    zmp = next(v for v in verdict.violations if v.kind == "zmp")
    assert abs(zmp.time_s - 1.5) < 0.0175
    assert verdict.margins.zmp_m < 0.0
    assert verdict.margins.joint_torque_nm is None, "contacts that cannot carry leave torques undefined"


def test_centre_of_mass_beside_the_only_foot(humanoid: Robot, squatting: Motion) -> None:
    alone = {
        "left_foot": np.ones(squatting.n_samples, bool),
        "right_foot": np.zeros(squatting.n_samples, bool),
    }
    assert {"com", "zmp", "contact_wrench"} <= kinds(humanoid, replace(squatting, contacts=alone))


def test_no_contact(humanoid: Robot, squatting: Motion) -> None:
    flags = {foot.name: np.ones(squatting.n_samples, bool) for foot in humanoid.feet}
    for values in flags.values():
        values[200:210] = False
    verdict = check_motion(humanoid, replace(squatting, contacts=flags))
    assert "no_contact" in {v.kind for v in verdict.violations}
    assert verdict.margins.zmp_m is None


def test_slippery_ground(humanoid: Robot) -> None:
    motion = squat(humanoid, depth=0.0, sway=0.04)
    assert check_motion(humanoid, motion).safe
    ice = replace(humanoid, feet=tuple(replace(foot, friction=0.005) for foot in humanoid.feet))
    assert kinds(ice, motion) == {"contact_wrench"}


def test_foot_slip(humanoid: Robot, squatting: Motion) -> None:
    slide = np.zeros((squatting.n_samples, 3))
    slide[:, 0] = hill(squatting, 0.008)
    assert kinds(humanoid, moved_base(squatting, slide)) == {"foot_slip"}


def test_foot_lifted(humanoid: Robot, squatting: Motion) -> None:
    rise = np.zeros((squatting.n_samples, 3))
    rise[:, 2] = hill(squatting, 0.01)
    assert kinds(humanoid, moved_base(squatting, rise)) == {"foot_lifted"}
    assert kinds(humanoid, moved_base(squatting, -rise)) == {"foot_below_ground"}


def test_swing_foot_below_ground(humanoid: Robot, squatting: Motion) -> None:
    offset = hill(squatting, 0.03)
    flags = dict(squatting.contacts) | {"left_foot": np.zeros(squatting.n_samples, bool)}
    motion = replace(moved_joint(humanoid, squatting, "left_knee_joint", -offset), contacts=flags)
    assert ("foot_below_ground", "left_foot") in {
        (v.kind, v.where) for v in check_motion(humanoid, motion).violations
    }


# --- Samples


def with_value(motion: Motion, field: str, index: object, value: object) -> Motion:
    """The motion with one entry of an array replaced."""
    values = getattr(motion, field).copy()
    values[index] = value
    return replace(motion, **{field: values})


def only_samples(motion: Motion, keep: np.ndarray) -> Motion:
    """The motion with some of its samples."""
    contacts = {name: flags[keep] for name, flags in motion.contacts.items()}
    arrays = {name: getattr(motion, name)[keep] for name in ("time", "q", "v", "a")}
    return replace(motion, contacts=contacts, **arrays)


FAULTS = {
    "nan": lambda m: with_value(m, "q", (50, -1), np.nan),
    "infinite acceleration": lambda m: with_value(m, "a", (50, -1), np.inf),
    "unsorted": lambda m: with_value(m, "time", [50, 51], m.time[[51, 50]]),
    "gap": lambda m: only_samples(m, np.r_[0:100, 160 : m.n_samples]),
    "joint order": lambda m: replace(m, joint_names=(*m.joint_names[:-2], *m.joint_names[:-3:-1])),
    "width": lambda m: replace(m, q=m.q[:, :-1]),
    "missing contact": lambda m: replace(m, contacts={"right_foot": m.contacts["right_foot"]}),
    "quaternion": lambda m: with_value(m, "q", (50, slice(3, 7)), 1.01 * m.q[50, 3:7]),
    "two samples": lambda m: only_samples(m, np.arange(2)),
    "velocity scaled": lambda m: replace(m, v=1.1 * m.v),
    "velocity late": lambda m: replace(m, v=np.roll(m.v, 5, axis=0)),
    "acceleration zero": lambda m: replace(m, a=0.0 * m.a),
}


@pytest.mark.parametrize(
    ("fault", "kind", "readable"),
    [
        ("nan", "not_finite", False),
        ("infinite acceleration", "not_finite", False),
        ("unsorted", "time_not_increasing", False),
        ("gap", "time_gap", False),
        ("joint order", "joint_order", False),
        ("width", "shape", False),
        ("missing contact", "contact_missing", False),
        ("quaternion", "quaternion_norm", False),
        ("two samples", "too_few_samples", False),
        ("velocity scaled", "velocity_not_derivative", True),
        ("velocity late", "velocity_not_derivative", True),
        ("acceleration zero", "acceleration_not_derivative", True),
    ],
)
def test_broken_samples(fault: str, kind: str, readable: bool, humanoid: Robot, squatting: Motion) -> None:
    verdict = check_motion(humanoid, FAULTS[fault](squatting))
    assert not verdict.safe
    assert kind in {v.kind for v in verdict.violations}
    if not readable:
        assert {v.kind for v in verdict.violations} == {kind}
        assert verdict.not_computed == MARGIN_FIELDS


def test_jumping_acceleration_is_no_inconsistency(arm: Robot) -> None:
    """A motion at piecewise constant acceleration that jumps between samples is consistent."""
    time = np.linspace(0.0, 1.0, 201)
    switch, alpha = 0.5013, 4.0
    after = np.maximum(time - switch, 0.0)
    path, speed = 0.5 * alpha * time**2 - alpha * after**2, alpha * time - 2.0 * alpha * after
    column = np.eye(arm.n_joints)[0]
    motion = Motion(
        "bang",
        arm.name,
        arm.joint_names,
        time,
        arm.rest + path[:, None] * column,
        speed[:, None] * column,
        np.where(time < switch, alpha, -alpha)[:, None] * column,
    )
    assert judge_sampling(Sweep(arm, motion)).violations == ()


# --- Files


def test_file_gets_the_motion_s_verdict(tmp_path, arm: Robot, swinging: Motion) -> None:
    path = save_motion(swinging, tmp_path / "swing.parquet")
    verdict = check_file(arm, path)
    assert verdict.motion == str(path)
    assert verdict.margins == check_motion(arm, swinging).margins


@pytest.mark.parametrize("fault", ["nan", "unsorted"])
def test_unreadable_file_is_an_input_error(fault: str, tmp_path, arm: Robot, swinging: Motion) -> None:
    path = save_motion(FAULTS[fault](swinging), tmp_path / "bad.csv")
    with pytest.raises(MotionError) as caught:
        check_file(arm, path)
    assert caught.value.exit_code == 4
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan])
def test_rate_must_be_positive(rate: float, arm: Robot, swinging: Motion) -> None:
    with pytest.raises(InputError, match="rate"):
        check_motion(arm, swinging, rate_hz=rate)


def test_a_coarse_grid_does_not_hide_anything(arm: Robot) -> None:
    still = arm_motion(arm, amplitude=0.0, duration=2.0)
    offset = oscillation(still, 1.01 * arm.limits.acceleration[-1] / 30.0**2, 30.0)
    motion = moved_joint(arm, still, arm.joint_names[-1], offset)
    assert not check_motion(arm, motion, rate_hz=5.0).safe
