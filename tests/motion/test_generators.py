"""Generators: one battery over the registry, and what each of them promises."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from excite.errors import RobotError, UnknownNameError
from excite.motion.generators.curves import FourierCurve, SplineCurve
from excite.motion.generators.generator import (
    Candidate,
    central_range,
    leg_joints,
    sole_half_width,
    upper_body,
)
from excite.motion.generators.joint_motions import amplitude_scale, start_conditions
from excite.motion.generators.mixture import plan_candidates
from excite.motion.generators.registry import GENERATORS, make_generator
from excite.motion.generators.walking import resting_soles, rocking_period
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.robot.test_scaffold import biped, written


@pytest.fixture(scope="module")
def go2() -> Robot:
    return load_robot("go2")


@pytest.fixture(params=sorted(GENERATORS))
def drawn(request: pytest.FixtureRequest, robot: Robot) -> list[Candidate]:
    return make_generator(request.param).candidates(robot, 3, np.random.SeedSequence(3))


@pytest.fixture(scope="module")
def celled(g1: Robot, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A robot on two feet whose space is stated."""
    content = yaml.safe_load(g1.source.read_text())
    content["collision"]["cell"] = [[-0.6, -0.7, -0.1], [0.7, 0.7, 1.6]]
    path = tmp_path_factory.mktemp("cell") / "robot.yaml"
    path.write_text(yaml.safe_dump(content))
    return load_robot(path)


@pytest.fixture
def robot(request: pytest.FixtureRequest, g1: Robot, go2: Robot, celled: Robot) -> Robot:
    """On two feet, or on four or in a cell where the generator needs it."""
    generator = make_generator(request.node.callspec.params["drawn"])
    return next(one for one in (g1, go2, celled) if generator.applies(one))


def _curves(candidate: Candidate) -> list:
    return [
        curve
        for curve in (candidate.posture, candidate.pelvis, candidate.com, *candidate.feet.values())
        if curve is not None
    ]


def test_every_generator_repeats_itself(drawn: list[Candidate], robot: Robot) -> None:
    generator = make_generator(drawn[0].generator)
    seed = np.random.SeedSequence(3)
    seed.spawn(5)
    again = generator.candidates(robot, 3, seed)
    s = np.linspace(0.0, drawn[2].length, 50)
    assert np.array_equal(drawn[2].posture.evaluate(s), again[2].posture.evaluate(s))
    alone = generator.draw(robot, drawn[1].seed, drawn[1].targets, drawn[1].name)
    s = np.linspace(0.0, alone.length, 50)
    for one, other in zip(_curves(drawn[1]), _curves(alone), strict=True):
        assert np.array_equal(one.evaluate(s), other.evaluate(s))


def test_every_generator_starts_and_ends_at_rest(drawn: list[Candidate]) -> None:
    for candidate in drawn:
        ends = np.array([0.0, candidate.length])
        for curve in _curves(candidate):
            assert curve.length == pytest.approx(candidate.length)
            assert np.allclose(curve.evaluate(ends)[0], curve.evaluate(ends)[1], atol=1e-12)
            assert np.allclose(curve.evaluate(ends, 1), 0.0, atol=1e-12)
            assert np.allclose(curve.evaluate(ends, 2), 0.0, atol=1e-12)


def test_every_generator_keeps_the_joints_in_range(drawn: list[Candidate], robot: Robot) -> None:
    upper = upper_body(robot)
    lower, higher = central_range(robot)
    rest = robot.rest[7:]
    for candidate in drawn:
        q = candidate.posture.evaluate(np.linspace(0.0, candidate.length, 500))
        assert (q >= np.minimum(lower, rest) - 1e-9)[:, upper].all()
        assert (q <= np.maximum(higher, rest) + 1e-9)[:, upper].all()
        if upper.any():
            assert np.ptp(q, axis=0)[upper].max() > 0.1


def test_every_generator_has_unbroken_phases(drawn: list[Candidate]) -> None:
    for candidate in drawn:
        ends = [0.0]
        for phase in candidate.phases:
            assert phase.start == ends[-1]
            assert phase.feet
            ends.append(phase.end)
        assert ends[-1] == pytest.approx(candidate.length)


@pytest.mark.parametrize("name", ["walking", "leg_swing", "squat"])
def test_generators_that_need_feet_say_so(name: str, panda: Robot) -> None:
    with pytest.raises(RobotError, match=f"{name}.*needs .*two feet"):
        make_generator(name).candidates(panda, 1, np.random.SeedSequence(0))


def test_generators_refuse_what_they_cannot_do(panda: Robot, g1: Robot) -> None:
    with pytest.raises(RobotError, match="leg_swing"):
        make_generator("leg_swing").candidates(panda, 1, np.random.SeedSequence(0))
    with pytest.raises(UnknownNameError, match="no_such_joint"):
        make_generator("random_joint").candidates(g1, 1, np.random.SeedSequence(0), ["no_such_joint"])
    with pytest.raises(UnknownNameError, match="jumping"):
        make_generator("jumping")


@pytest.mark.parametrize("order", [1, 2])
def test_curve_derivatives_against_finite_differences(order: int) -> None:
    rng = np.random.default_rng(0)
    fourier = FourierCurve(rng.normal(size=3), rng.normal(size=(3, 4)), rng.normal(size=(3, 4)), 1.3)
    spline = SplineCurve(rng.normal(size=(9, 3)))
    for curve in (fourier, spline):
        s = np.linspace(0.31, curve.length - 0.33, 7)
        h = 1e-6
        numeric = (curve.evaluate(s + h, order - 1) - curve.evaluate(s - h, order - 1)) / (2 * h)
        assert np.allclose(curve.evaluate(s, order), numeric, atol=1e-7)


def test_fourier_conditions_and_amplitudes() -> None:
    """Ni et al. 2024, eq. (10): zero start, sums of amplitudes inside the limits."""
    rng = np.random.default_rng(1)
    omega, harmonics = 1.7, 5
    c_a, c_b = start_conditions(omega, harmonics)
    a, b = rng.normal(size=(2, 3, harmonics))
    a = a - a @ np.linalg.pinv(c_a) @ c_a
    b = b - b @ np.linalg.pinv(c_b) @ c_b
    reach, speed = np.array([0.5, 1.0, 0.1]), np.array([1.0, 0.6, 2.0])
    scale = amplitude_scale(a, b, omega, reach, speed)[:, None]
    curve = FourierCurve(np.zeros(3), scale * a, scale * b, omega)
    s = np.linspace(0.0, curve.length, 2000)
    assert np.allclose(curve.evaluate(np.zeros(1)), 0.0, atol=1e-12)
    assert np.allclose(curve.evaluate(np.zeros(1), 1), 0.0, atol=1e-12)
    assert np.allclose(curve.evaluate(np.zeros(1), 2), 0.0, atol=1e-12)
    assert (np.abs(curve.evaluate(s)).max(axis=0) <= reach).all()
    assert (np.abs(curve.evaluate(s, 1)).max(axis=0) <= speed).all()


def test_printed_conditions_leave_a_velocity() -> None:
    """The sums as printed in eq. (10) do not start eq. (8) at rest, which is why they are not used."""
    number = np.arange(1, 5)
    printed = np.vstack([1.0 / number, number])
    a = np.ones((1, 4)) - np.ones((1, 4)) @ np.linalg.pinv(printed) @ printed
    assert np.allclose(printed @ a.T, 0.0)
    curve = FourierCurve(np.zeros(1), a, np.zeros((1, 4)), 1.0)
    assert abs(curve.evaluate(np.zeros(1), 1)[0, 0]) > 0.01


def test_target_moves_most_of_its_range(g1: Robot) -> None:
    joint = g1.joint_index("waist_yaw_joint")
    lower, upper = central_range(g1)
    for candidate in make_generator("random_joint").candidates(
        g1, 4, np.random.SeedSequence(0), ["waist_yaw_joint"]
    ):
        drawn = candidate.posture.control[3:-3, joint]
        assert np.ptp(drawn) > 0.5 * (upper - lower)[joint]


def test_leg_swing_lifts_the_leg_that_is_aimed_at(g1: Robot) -> None:
    left, right = g1.feet
    for foot, stance in ((left, right), (right, left)):
        joint = g1.joint_names[leg_joints(g1, foot)[3]]
        candidate = make_generator("leg_swing").candidates(g1, 1, np.random.SeedSequence(0), [joint])[0]
        single = [phase for phase in candidate.phases if len(phase.feet) == 1]
        assert [phase.feet for phase in single] == [(stance.name,)]
        inside = np.linspace(single[0].start, single[0].end, 100)[1:-1]
        outside = np.r_[
            np.linspace(0.0, single[0].start, 20), np.linspace(single[0].end, candidate.length, 20)
        ]
        assert (candidate.feet[foot.name].evaluate(inside)[:, 2] > 0.0).all()
        assert np.allclose(candidate.feet[foot.name].evaluate(outside), 0.0)


def test_a_rounded_sole_is_as_wide_as_it_is(g1: Robot) -> None:
    """Its toe lies on its middle line: a width by the corner nearest to that is none."""
    corners = [(0.1, 0.04), (-0.1, 0.04), (-0.11, 0.0), (-0.1, -0.04), (0.1, -0.04), (0.11, 0.0)]

    def soled(kept: list[tuple[float, float]]) -> Robot:
        feet = []
        for foot in g1.feet:
            sole = np.array([foot.placement.act(np.array([*corner, 0.0])) for corner in kept])
            feet.append(replace(foot, sole=sole))
        return replace(g1, feet=tuple(feet))

    rounded, straight = soled(corners), soled([corners[k] for k in (0, 1, 3, 4)])
    for robot in (rounded, straight):
        assert sole_half_width(robot.feet[0]) == pytest.approx(0.04)
        assert resting_soles(robot)[0].width == pytest.approx(0.08)
    assert rocking_period(rounded) == pytest.approx(rocking_period(straight))


def test_legs_may_have_unlike_numbers_of_joints(tmp_path: Path) -> None:
    """Of ToddlerBot's knees one is held still."""
    text = biped().replace(
        'name="right_ankle_roll_joint" type="revolute"', 'name="right_ankle_roll_joint" type="fixed"'
    )
    robot = written(text, tmp_path)
    assert [len(leg_joints(robot, foot)) for foot in robot.feet] == [6, 5]
    aims = make_generator("leg_swing").aims(robot)
    assert len(aims) == len(set(aims)) == 11
    assert aims[:2] == ("left_hip_yaw_joint", "right_hip_yaw_joint")
    assert aims[-1] == "left_ankle_roll_joint"
    assert len(plan_candidates(robot, 10, np.random.SeedSequence(1))) == 10


def test_plan_shares_and_targets(g1: Robot, panda: Robot) -> None:
    plan = plan_candidates(g1, 20, np.random.SeedSequence(0))
    names = [candidate.name for candidate in plan]
    assert len(set(names)) == len(names) == 20
    assert {candidate.generator for candidate in plan} == {"random_joint", "leg_swing", "squat"}
    aimed = plan_candidates(g1, 6, np.random.SeedSequence(0), targets=["left_elbow_joint"])
    assert {candidate.targets for candidate in aimed} == {("left_elbow_joint",)}
    assert {candidate.generator for candidate in aimed} == {"aimed"}
    legs = plan_candidates(g1, 10, np.random.SeedSequence(0), targets=["left_knee_joint"])
    assert {candidate.generator for candidate in legs} == {"aimed", "squat"}
    arm = plan_candidates(panda, 5, np.random.SeedSequence(0), mix={"fourier": 1.0})
    assert {candidate.generator for candidate in arm} == {"fourier"}
    with pytest.raises(UnknownNameError):
        plan_candidates(g1, 3, np.random.SeedSequence(0), targets=["nowhere"])


def test_a_generator_without_a_joint_to_aim_at_is_refused() -> None:
    """All joints of a Go2 are in legs."""
    robot = load_robot("go2")
    assert not make_generator("fourier").applies(robot)
    with pytest.raises(RobotError, match="'fourier' does not apply to it: all its joints are in legs"):
        make_generator("fourier").candidates(robot, 1, np.random.SeedSequence(0))
