"""What the check of the samples says of broken ones: which, when, where, how much, and from what size on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.checks.motion import judge_sampling
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import Violation


def still(robot: Robot, n: int = 21, rate_hz: float = 100.0) -> Motion:
    """A robot at rest."""
    nothing = np.zeros((n, robot.model.nv))
    contacts = {foot.name: np.ones(n, bool) for foot in robot.feet}
    time = np.arange(n) / rate_hz
    return Motion(
        "still", robot.name, robot.joint_names, time, np.tile(robot.rest, (n, 1)), nothing, nothing, contacts
    )


def changed(motion: Motion, field: str, index: object, value: float) -> Motion:
    """The motion with entries of an array set."""
    values = getattr(motion, field).copy()
    values[index] = value
    return replace(motion, **{field: values})


def found(robot: Robot, motion: Motion) -> tuple[Violation, ...]:
    return judge_sampling(Sweep(robot, motion)).violations


def only(robot: Robot, motion: Motion) -> Violation:
    (violation,) = found(robot, motion)
    return violation


# --- Structure


def test_joints_in_another_order_are_named(arm: Robot) -> None:
    names = list(arm.joint_names)
    names[2], names[4] = names[4], names[2]
    motion = replace(still(arm), joint_names=tuple(names))
    assert only(arm, motion) == Violation("joint_order", None, names[2], None, None)
    fewer = replace(still(arm), joint_names=arm.joint_names[:-1])
    assert only(arm, fewer).where == "number of joints"


@pytest.mark.parametrize("field", ["q", "v", "a"])
def test_every_array_has_its_shape(field: str, humanoid: Robot) -> None:
    motion = still(humanoid)
    values = getattr(motion, field)
    for wrong in (values[:, :-1], values[:-1]):
        assert only(humanoid, replace(motion, **{field: wrong})) == Violation(
            "shape", None, field, None, None
        )


# --- Values


def test_what_is_not_finite_is_named_by_its_column(humanoid: Robot, arm: Robot) -> None:
    motion, last = still(humanoid), humanoid.joint_names[-1]
    first = humanoid.joint_names[0]
    for field, column, where in (
        ("q", 0, "base (q)"),
        ("q", 6, "base (q)"),
        ("q", 7, f"q.{first}"),
        ("v", 5, "base (v)"),
        ("v", 6, f"v.{first}"),
        ("a", 6, f"a.{first}"),
        ("a", -1, f"a.{last}"),
    ):
        assert only(humanoid, changed(motion, field, (7, column), np.inf)) == Violation(
            "not_finite", 0.07, where, None, None
        )
    assert only(arm, changed(still(arm), "v", (3, 0), np.nan)).where == f"v.{arm.joint_names[0]}"
    assert only(arm, changed(still(arm), "time", 3, np.nan)) == Violation(
        "not_finite", None, "time", None, None
    )


@pytest.mark.parametrize(("factor", "bad"), [(1.0 + 0.9e-6, False), (1.0 + 1.1e-6, True), (0.99, True)])
def test_quaternions_have_length_one(factor: float, bad: bool, humanoid: Robot) -> None:
    motion = still(humanoid)
    q = motion.q.copy()
    q[5:8, 3:7] *= factor
    violations = found(humanoid, replace(motion, q=q))
    assert bool(violations) is bad
    if bad:
        assert (violations[0].kind, violations[0].time_s, violations[0].limit) == (
            "quaternion_norm",
            0.05,
            1.0,
        )
        assert violations[0].value == pytest.approx(1.0 + abs(factor - 1.0))


# --- Time


def test_three_samples_are_enough(arm: Robot) -> None:
    assert found(arm, still(arm, 3)) == ()
    assert only(arm, still(arm, 2)) == Violation("too_few_samples", None, "time", 2.0, 3.0)


@pytest.mark.parametrize("step", [0.0, -0.005])
def test_time_increases(step: float, arm: Robot) -> None:
    motion = still(arm)
    time = motion.time.copy()
    time[11] = time[10] + step
    violation = only(arm, replace(motion, time=time))
    assert (violation.kind, violation.time_s, violation.limit) == ("time_not_increasing", 0.1, 0.0)
    assert violation.value == pytest.approx(step)


@pytest.mark.parametrize(("ratio", "bad"), [(1.49, False), (1.51, True)])
def test_a_step_is_at_most_half_as_long_again_as_the_others(ratio: float, bad: bool, arm: Robot) -> None:
    motion = still(arm)
    time = motion.time.copy()
    time[11:] += (ratio - 1.0) * 0.01
    violations = found(arm, replace(motion, time=time))
    assert bool(violations) is bad
    if bad:
        assert (violations[0].kind, violations[0].time_s) == ("time_gap", 0.1)
        assert (violations[0].value, violations[0].limit) == (pytest.approx(0.0151), pytest.approx(0.015))


@pytest.mark.parametrize(("rate", "bad"), [(20.0, False), (19.9, True)])
def test_twenty_samples_a_second_are_enough(rate: float, bad: bool, arm: Robot) -> None:
    violations = found(arm, replace(still(arm, rate_hz=rate), curve="spline"))
    assert bool(violations) is bad
    if bad:
        (violation,) = violations
        assert (violation.kind, violation.time_s, violation.limit) == ("rate_too_low", None, 20.0)
        assert violation.value == pytest.approx(19.9)


def test_a_single_step_is_never_longer_than_a_twentieth_of_a_second(arm: Robot) -> None:
    motion = still(arm, rate_hz=25.0)
    for step, bad in ((0.0499, False), (0.0501, True)):
        time = motion.time.copy()
        time[11:] += step - 0.04
        violations = found(arm, replace(motion, time=time))
        assert [v.kind for v in violations] == (["time_gap"] if bad else [])
        assert [v.limit for v in violations] == ([0.05] if bad else [])


# --- Contacts


def test_every_foot_has_a_flag_for_each_sample(humanoid: Robot) -> None:
    motion = still(humanoid)
    left, right = (foot.name for foot in humanoid.feet)
    flags = motion.contacts[left]
    for wrong in (
        {},
        {left: flags[:-1]},
        {left: flags.astype(float)},
        {left: np.column_stack([flags, flags])},
    ):
        violation = only(humanoid, replace(motion, contacts={right: flags, **wrong}))
        assert violation == Violation("contact_missing", None, left, None, None)
    assert [v.where for v in found(humanoid, replace(motion, contacts={}))] == [left, right]


# --- Derivatives


def tolerances(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """What is documented: 0.5 % and 1 % of the joints' limits; of a base 1 cm/s, 0.02 rad/s, 0.2 m/s², 0.3 rad/s²."""
    velocity, acceleration = 0.005 * robot.limits.velocity, 0.01 * robot.limits.acceleration
    if robot.floating:
        velocity = np.r_[[0.01] * 3, [0.02] * 3, velocity]
        acceleration = np.r_[[0.2] * 3, [0.3] * 3, acceleration]
    return velocity, acceleration


def test_velocity_and_acceleration_may_be_off_by_their_tolerance(humanoid: Robot, arm: Robot) -> None:
    base = ("base.x", "base.y", "base.z", "base.wx", "base.wy", "base.wz")
    for robot, names in ((humanoid, base + humanoid.joint_names), (arm, arm.joint_names)):
        motion = still(robot)
        for field, kind, tolerance in zip(
            ("v", "a"), ("velocity", "acceleration"), tolerances(robot), strict=True
        ):
            for sign in (1.0, -1.0):
                within = replace(motion, **{field: np.tile(sign * 0.99 * tolerance, (21, 1))})
                beyond = replace(motion, **{field: np.tile(sign * 1.01 * tolerance, (21, 1))})
                assert found(robot, within) == ()
                violations = found(robot, beyond)
                assert tuple(v.where for v in violations) == names
                assert {(v.kind, v.time_s) for v in violations} == {(f"{kind}_not_derivative", 0.0)}
                assert [v.value for v in violations] == pytest.approx(1.01 * tolerance)
                assert [v.limit for v in violations] == pytest.approx(tolerance)


def test_an_acceleration_may_jump_but_not_stay_wrong(arm: Robot) -> None:
    """Wrong at one sample it may be a jump between two; wrong at two the interval between them shows it."""
    motion, tolerance = still(arm), tolerances(arm)[1][1]
    for at in (5, 0, 19):
        assert found(arm, changed(motion, "a", (at, 1), 5.0 * tolerance)) == ()
        violation = only(arm, changed(motion, "a", (slice(at, at + 2), 1), 5.0 * tolerance))
        assert (violation.kind, violation.where) == ("acceleration_not_derivative", arm.joint_names[1])
        assert violation.time_s == pytest.approx(0.01 * at)
        assert violation.value == pytest.approx(5.0 * tolerance)
        # Curvature of a over four samples is let be; at the ends that of the nearest four.
        bend = {5: 2.0, 0: 0.0, 19: 0.0}[at] * 5.0 * tolerance
        assert violation.limit == pytest.approx(tolerance + bend / 12.0)


def test_a_steady_jerk_is_consistent_at_any_rate(arm: Robot) -> None:
    """A cubic: the corrected trapezoidal rule is exact, and with the wrong sign it would be far off."""
    motion, jerk = still(arm, rate_hz=20.0), 150.0
    t = motion.time[:, None]
    cubic = replace(
        motion,
        q=motion.q + jerk * t**3 / 6.0,
        v=jerk * t**2 / 2.0 + 0.0 * motion.v,
        a=jerk * t + 0.0 * motion.a,
    )
    assert found(arm, cubic) == ()
    tolerance = tolerances(arm)[0] + 0.05 * jerk * 0.05 / 12.0
    for share, bad in ((0.99, False), (1.01, True)):
        violations = found(arm, replace(cubic, v=cubic.v + share * tolerance))
        assert bool(violations) is bad
        assert [v.limit for v in violations] == pytest.approx(list(tolerance) if bad else [])


def test_a_turning_base_is_compared_in_its_own_frame(humanoid: Robot) -> None:
    """A base that turns about z and moves along its own x: twist in the base frame, not in the world's."""
    motion = still(humanoid, 51)
    rate, speed = 1.2, 0.3
    angle = rate * motion.time
    q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
    q[:, 0] += speed / rate * np.sin(angle)
    q[:, 1] += speed / rate * (1.0 - np.cos(angle))
    q[:, 3:7] = np.column_stack([0.0 * angle, 0.0 * angle, np.sin(angle / 2), np.cos(angle / 2)])
    v[:, 0], v[:, 5] = speed, rate
    turning = replace(motion, q=q, v=v, a=a)
    assert found(humanoid, turning) == ()
    world = v.copy()
    world[:, 0], world[:, 1] = speed * np.cos(angle), speed * np.sin(angle)
    assert "base.y" in {violation.where for violation in found(humanoid, replace(turning, v=world))}
