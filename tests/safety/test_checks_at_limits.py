"""Checks at their very limits, on sweeps made by hand: what passes just within, what is said just beyond."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from excite.robot.robot import Robot
from excite.safety.checks.base import CheckResult, first_violations
from excite.safety.checks.ground import (
    judge_centre_of_mass,
    judge_contact_wrench,
    judge_feet,
    judge_zero_moment_point,
)
from excite.safety.checks.joints import (
    judge_positions,
    judge_rates,
    judge_torques,
)
from excite.safety.checks.sweep import Sweep
from excite.safety.ground_forces import ContactForces
from excite.safety.verdict import Nearest, Violation
from tests.safety.control_points import ControlPoints

TIME = np.arange(11) * 0.1
SOLE = np.array([[0.1, 0.05, 0.0], [-0.1, 0.05, 0.0], [-0.1, -0.05, 0.0], [0.1, -0.05, 0.0]])
MASS, GRAVITY = 10.0, 9.81


def standing(**changes: object) -> SimpleNamespace:
    """A sweep of ten kilograms over one foot, the zero-moment point in its middle."""
    n = len(TIME)
    wrench = np.tile([0.0, 0.0, MASS * GRAVITY, 0.0, 0.0, 0.0], (n, 1))
    values = {
        "contacts": np.ones((n, 1), bool),
        "sole_corners": (np.tile(SOLE, (n, 1, 1)),),
        "wrench": wrench,
        "zmp": np.zeros((n, 2)),
        "dynamics": SimpleNamespace(com=np.zeros((n, 3))),
        "fine": SimpleNamespace(time=TIME),
        "robot": SimpleNamespace(
            feet=(SimpleNamespace(name="left", sole=SOLE, friction=0.5),),
            mass=MASS,
            model=SimpleNamespace(gravity=SimpleNamespace(linear=np.array([0.0, 0.0, -GRAVITY]))),
        ),
        **changes,
    }
    sweep = SimpleNamespace(**values)
    sweep.on_feet = lambda samples: Sweep.on_feet(sweep, samples)  # type: ignore[arg-type]
    return sweep


def only(result: CheckResult) -> Violation:
    (violation,) = result.violations
    return violation


# --- What checks share


def test_each_column_is_reported_once_at_its_first_bad_row() -> None:
    values = np.array([[1.0, 5.0, np.nan], [4.0, 6.0, 1.0], [9.0, 0.0, 1.0]])
    bad = np.array([[False, True, True], [True, True, False], [True, False, False]])
    time = np.array([0.0, 0.1, 0.2])
    assert first_violations("kind", ("a", "b", "c"), time, values, np.array([3.0, 4.0, 5.0]), bad) == (
        Violation("kind", 0.1, "a", 4.0, 3.0),
        Violation("kind", 0.0, "b", 5.0, 4.0),
        Violation("kind", 0.0, "c", None, 5.0),
    )
    limits = np.arange(9.0).reshape(3, 3)
    assert [v.limit for v in first_violations("kind", ("a", "b", "c"), time, values, limits, bad)] == [
        3,
        1,
        2,
    ]
    assert first_violations("kind", ("a", "b", "c"), time, values, limits, bad & False) == ()


# --- Joints


def limited(robot: Robot, **points: np.ndarray) -> SimpleNamespace:
    """A sweep of two intervals with control points at rest but for some."""
    shape = {"position": 6, "velocity": 5, "acceleration": 4}
    values = {name: np.zeros((count, 2, robot.n_joints)) for name, count in shape.items()}
    values["position"] += robot.rest
    for name, change in points.items():
        values[name] = change
    return SimpleNamespace(
        robot=robot,
        fine=SimpleNamespace(time=np.array([0.0, 0.1, 0.2])),
        bounds=ControlPoints(**values).bounds(),
    )


def test_positions_keep_to_both_ends_of_their_range(arm: Robot) -> None:
    lower, upper = arm.limits.position_lower, arm.limits.position_upper
    for limit, outwards in ((lower, -1.0), (upper, 1.0)):
        for excess, bad in ((0.9e-6, False), (1.1e-6, True), (0.1, True)):
            points = np.tile(arm.rest, (6, 2, 1))
            points[3, 1, 2] = limit[2] + outwards * excess * (upper - lower)[2]
            result = judge_positions(limited(arm, position=points))
            assert result.margin == pytest.approx(-excess * (upper - lower)[2], abs=1e-12)
            assert bool(result.violations) is bad
            if bad:
                assert only(result) == Violation(
                    "joint_position", 0.1, arm.joint_names[2], points[3, 1, 2], limit[2]
                )
    rest = judge_positions(limited(arm))
    assert rest.margin == pytest.approx(np.minimum(arm.rest - lower, upper - arm.rest).min())


@pytest.mark.parametrize("name", ["velocity", "acceleration"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_speeds_and_accelerations_keep_below_their_limits(name: str, sign: float, arm: Robot) -> None:
    limit = getattr(arm.limits, name)
    for excess, bad in ((-0.5, False), (0.9e-6, False), (1.1e-6, True)):
        points = np.zeros((5 if name == "velocity" else 4, 2, arm.n_joints))
        points[2, 1, 3] = sign * limit[3] * (1.0 + excess)
        result = judge_rates(name, limited(arm, **{name: points}))
        others = np.delete(limit, 3).min()
        assert result.margin == pytest.approx(min(others, -excess * limit[3]), abs=1e-12)
        assert [(v.kind, v.time_s, v.where) for v in result.violations] == (
            [(f"joint_{name}", 0.1, arm.joint_names[3])] if bad else []
        )
        if bad:
            assert (only(result).value, only(result).limit) == (abs(points[2, 1, 3]), limit[3])


def torques(robot: Robot, tau: np.ndarray, residual: float = 0.0) -> SimpleNamespace:
    """A sweep with given torques of an arm."""
    n = len(tau)
    still = SimpleNamespace(
        time=0.1 * np.arange(n),
        q=np.tile(robot.rest, (n, 1)),
        joint_velocities=lambda: np.zeros_like(tau),
        joint_accelerations=lambda: np.zeros_like(tau),
    )
    return SimpleNamespace(
        robot=robot,
        fine=still,
        torque_samples=np.arange(n),
        dynamics=SimpleNamespace(tau=tau),
        contact_forces=(ContactForces(np.zeros((n, 4, 3)), np.full(n, residual)),),
    )


def test_torques_keep_below_their_limits(arm: Robot) -> None:
    limit = arm.limits.torque
    for value in (1.0, -1.0):
        tau = np.zeros((3, arm.n_joints))
        tau[1, 2] = value * limit[2]
        nearest = (Nearest("elbow_joint", 0.0, "N·m"),)
        assert judge_torques(torques(arm, tau)) == CheckResult(0.0, nearest=nearest)
        tau[1:, 2] *= 1.001
        result = judge_torques(torques(arm, tau))
        assert result.margin == pytest.approx(-0.001 * limit[2])
        assert only(result) == Violation("joint_torque", 0.1, arm.joint_names[2], abs(tau[1, 2]), limit[2])


def test_torques_that_are_no_numbers_leave_no_margin(arm: Robot) -> None:
    tau = np.zeros((3, arm.n_joints))
    tau[1, 2] = np.nan
    assert judge_torques(torques(arm, tau)) == CheckResult(None)
    tau[2, 2] = 2.0 * arm.limits.torque[2]
    assert only(judge_torques(torques(arm, tau))).time_s == pytest.approx(0.2)


# --- Balance


@pytest.mark.parametrize(("margin", "bad"), [(0.0151, False), (0.0149, True), (-0.02, True)])
def test_the_zero_moment_point_keeps_15_mm_from_the_edge(margin: float, bad: bool) -> None:
    zmp = np.zeros((11, 2))
    zmp[4:6, 1] = 0.05 - margin
    result = judge_zero_moment_point(standing(zmp=zmp))
    assert result.margin == pytest.approx(margin)
    assert bool(result.violations) is bad
    if bad:
        violation = only(result)
        assert (violation.kind, violation.time_s, violation.where) == ("zmp", TIME[4], "left")
        assert (violation.value, violation.limit) == (pytest.approx(margin), 0.015)


@pytest.mark.parametrize(("share", "bad"), [(0.201, False), (0.199, True)])
def test_the_ground_carries_a_fifth_of_the_weight(share: float, bad: bool) -> None:
    sweep = standing()
    sweep.wrench[7, 2] *= share
    result = judge_zero_moment_point(sweep)
    assert bool(result.violations) is bad
    if bad:
        violation = only(result)
        assert (violation.kind, violation.time_s, violation.where) == ("weight_share", TIME[7], "feet")
        assert (violation.value, violation.limit) == (pytest.approx(share), 0.2)
    assert result.margin == pytest.approx(0.05)


def test_a_weight_that_is_no_number_is_too_light() -> None:
    sweep = standing()
    sweep.wrench[7, 2] = np.nan
    assert only(judge_zero_moment_point(sweep)).kind == "weight_share"


def test_a_flight_has_no_margin() -> None:
    sweep = standing()
    sweep.contacts[3:5] = False
    result = judge_zero_moment_point(sweep)
    assert result.margin is None
    assert only(result) == Violation("no_contact", TIME[3], "feet", None, None)


def test_an_arm_has_no_balance() -> None:
    sweep = standing(robot=SimpleNamespace(feet=()))
    for check in (judge_zero_moment_point, judge_centre_of_mass, judge_contact_wrench, judge_feet):
        assert check(sweep) == CheckResult(applicable=False)


def lean(sweep: SimpleNamespace, samples: slice | list[int], margin: float) -> CheckResult:
    sweep.dynamics.com[samples, 1] = 0.05 - margin
    return judge_centre_of_mass(sweep)


@pytest.mark.parametrize(("margin", "bad"), [(0.0151, False), (0.0149, True)])
@pytest.mark.parametrize("at", [0, 10])
def test_the_centre_of_mass_starts_and_ends_above_the_feet(margin: float, bad: bool, at: int) -> None:
    result = lean(standing(), [at], margin)
    assert bool(result.violations) is bad
    if bad:
        violation = only(result)
        assert (violation.kind, violation.time_s, violation.where) == ("com", TIME[at], "left")
        assert (violation.value, violation.limit) == (pytest.approx(margin), 0.015)


@pytest.mark.parametrize(("step", "bad"), [(0.149, False), (0.151, True)])
def test_a_phase_of_a_second_and_a_half_is_a_stance(step: float, bad: bool) -> None:
    """In between it may lean out if the phase is a step, from 1.5 s on it may not."""
    sweep = standing(fine=SimpleNamespace(time=np.arange(11) * step))
    result = lean(sweep, [5], -0.01)
    assert bool(result.violations) is bad
    if bad:
        assert only(result).time_s == pytest.approx(5 * step)


def test_phases_are_told_apart_by_their_feet() -> None:
    """Two feet; the phases last 0.5, 0.2 and 1.6 s: only the last is a stance between its ends."""
    n = 24
    contacts = np.ones((n, 2), bool)
    contacts[6:8, 1] = False
    other = SOLE + np.array([0.0, 0.2, 0.0])
    sweep = standing(
        contacts=contacts,
        sole_corners=(np.tile(SOLE, (n, 1, 1)), np.tile(other, (n, 1, 1))),
        dynamics=SimpleNamespace(com=np.zeros((n, 3))),
        fine=SimpleNamespace(time=np.arange(n) * 0.1),
    )
    sweep.robot.feet = tuple(
        SimpleNamespace(name=side, sole=SOLE, friction=0.5) for side in ("left", "right")
    )
    sweep.dynamics.com[:] = [0.0, 0.1, 0.0]
    assert judge_centre_of_mass(sweep).violations == ()
    sweep.dynamics.com[[3, 6], 1] = -0.1
    assert judge_centre_of_mass(sweep).violations == ()
    for at in (8, 15, 23):
        sweep.dynamics.com[:] = [0.0, 0.1, 0.0]
        sweep.dynamics.com[at, 1] = -0.1
        violation = only(judge_centre_of_mass(sweep))
        assert (violation.time_s, violation.where) == (pytest.approx(0.1 * at), "left+right")
        assert violation.value == pytest.approx(-0.05)


def test_a_centre_of_mass_without_support_has_no_value() -> None:
    sweep = standing()
    sweep.contacts[-1] = False
    assert only(judge_centre_of_mass(sweep)) == Violation("com", TIME[-1], "feet", None, 0.015)


@pytest.mark.parametrize(
    ("residual", "value"), [(0.99e-3, 0.0), (1.01e-3, 1.01e-3), (np.inf, None), (np.nan, None)]
)
def test_a_thousandth_of_the_wrench_may_be_missing(residual: float, value: float | None) -> None:
    residuals = np.zeros(6)
    residuals[2:] = residual
    sweep = standing(
        torque_samples=np.arange(0, 11, 2), contact_forces=(ContactForces(np.zeros(0), residuals),)
    )
    result = judge_contact_wrench(sweep)
    if value == 0.0:
        assert result == CheckResult()
    else:
        assert only(result) == Violation("contact_wrench", TIME[4], "feet", value, 1e-3)


# --- Feet


def judge_foot(corners: np.ndarray, loaded: np.ndarray | None = None) -> tuple[Violation, ...]:
    loaded = np.ones(len(corners), bool) if loaded is None else loaded
    sweep = standing(contacts=loaded[:, None], sole_corners=(corners,))
    return judge_feet(sweep).violations


def still_foot() -> np.ndarray:
    return np.tile(SOLE, (11, 1, 1))


@pytest.mark.parametrize(("size", "bad"), [(0.0029, False), (0.0031, True)])
def test_loaded_corners_stay_within_3_mm_of_the_ground(size: float, bad: bool) -> None:
    for sign, kind in ((1.0, "foot_lifted"), (-1.0, "foot_below_ground")):
        corners = still_foot()
        corners[6:8, 2, 2] = sign * size
        expected = (Violation(kind, TIME[6], "left", sign * size, sign * 0.003),) if bad else ()
        assert judge_foot(corners) == expected


def test_a_free_foot_is_anywhere_above_the_ground() -> None:
    free = np.zeros(11, bool)
    corners = still_foot() + np.linspace(0.0, 1.0, 11)[:, None, None] * [1.0, 0.0, 0.2]
    assert judge_foot(corners, free) == ()
    corners[4, 1, 2] = -0.0031
    assert judge_foot(corners, free) == (Violation("foot_below_ground", TIME[4], "left", -0.0031, -0.003),)


@pytest.mark.parametrize(("way", "bad"), [(0.0029, False), (0.0031, True)])
def test_a_loaded_foot_stays_within_3_mm_of_where_it_was_put_down(way: float, bad: bool) -> None:
    corners = still_foot()
    corners[:, :, 0] += np.linspace(0.0, way, 11)[:, None]
    violations = judge_foot(corners)
    assert violations == (
        (Violation("foot_slip", TIME[10], "left", pytest.approx(way), 0.003),) if bad else ()
    )


def test_where_it_was_put_down_is_new_for_each_phase() -> None:
    loaded = np.ones(11, bool)
    loaded[4:6] = False
    corners = still_foot()
    corners[4:, :, 0] += 0.5
    assert judge_foot(corners, loaded) == ()
    corners[9:, :, 1] += np.array([0.002, 0.004])[:, None]
    (violation,) = judge_foot(corners, loaded)
    assert (violation.kind, violation.time_s, violation.value) == (
        "foot_slip",
        TIME[10],
        pytest.approx(0.004),
    )
    # A flag that rises for one sample alone has nowhere to slip to.
    alone = np.zeros(11, bool)
    alone[3] = True
    assert judge_foot(still_foot() + np.linspace(0.0, 1.0, 11)[:, None, None] * [1.0, 0.0, 0.0], alone) == ()


@pytest.mark.parametrize(("speed", "bad"), [(0.0295, False), (0.0305, True)])
def test_a_loaded_foot_slips_no_faster_than_3_cm_a_second(speed: float, bad: bool) -> None:
    corners = still_foot()
    corners[5:, 1, :2] += 0.06 * speed * np.array([0.6, 0.8])
    time = TIME.copy()
    time[5:] -= 0.04
    sweep = standing(sole_corners=(corners,), fine=SimpleNamespace(time=time))
    expected = (Violation("foot_slip_speed", TIME[4], "left", pytest.approx(speed), 0.03),) if bad else ()
    assert judge_feet(sweep).violations == expected
