"""Walking: footprints, the pattern's zero-moment point, what the candidate promises."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from excite.errors import NoSolutionError, RobotError
from excite.motion.generators.curves import hermite_curve, polyline_curve
from excite.motion.generators.generator import Candidate
from excite.motion.generators.registry import make_generator
from excite.motion.generators.walking import (
    Print,
    Sole,
    Swing,
    Timing,
    plan_pattern,
    resting_soles,
    rocking_period,
    sole_curve,
    there_and_back,
)
from excite.robot.loading import load_robot
from excite.robot.robot import Robot


@pytest.fixture(scope="module")
def soles(g1: Robot) -> tuple[Sole, ...]:
    return resting_soles(g1)


@pytest.fixture(scope="module")
def walks(g1: Robot) -> list[Candidate]:
    return make_generator("walking").candidates(g1, 4, np.random.SeedSequence(2))


def _pose(where: Print) -> np.ndarray:
    return np.r_[where.position, where.yaw]


def test_walks_lead_out_and_home(soles: tuple[Sole, ...]) -> None:
    ways = np.array([[0.1, 0.0, 0.0], [0.1, 0.0, 0.3]])
    steps = there_and_back(soles, 1, ways, 0.8)
    assert [step.foot for step in steps] == [1, 0, 1, 0, 1, 0]
    for index, sole in enumerate(soles):
        last = [step.print for step in steps if step.foot == index][-1]
        assert np.allclose(_pose(last), _pose(sole.print))
    # At the far end both soles stand side by side, narrower than at rest, where the ways lead.
    far = [steps[1].print, steps[2].print]
    rest = np.linalg.norm(soles[0].print.position - soles[1].print.position)
    assert np.linalg.norm(far[0].position - far[1].position) == pytest.approx(0.8 * rest)
    middle = np.mean([sole.print.position for sole in soles], axis=0)
    assert np.allclose(np.mean([p.position for p in far], axis=0) - middle, [0.2, 0.0])
    assert [p.yaw for p in far] == pytest.approx([0.3, 0.3])


def test_a_sole_stands_still_between_swings(soles: tuple[Sole, ...]) -> None:
    target = Print(soles[0].print.position + np.array([0.1, 0.02]), soles[0].print.yaw + 0.2)
    swing = Swing(1.0, 2.0, 0.05, np.array([0.1, -0.2, 0.3]), np.array([0.0, 0.01]))
    curve = sole_curve(soles[0], [target], [swing], 3.0)
    assert np.allclose(curve.evaluate(np.linspace(0.0, 1.0, 20)), 0.0, atol=1e-15)
    assert np.allclose(curve.evaluate(np.linspace(2.0, 3.0, 20)), [0.1, 0.02, 0.0, 0.0, 0.0, 0.2], atol=1e-12)
    assert np.allclose(curve.evaluate(np.array([1.5])), [[0.05, 0.02, 0.05, 0.1, -0.2, 0.4]])
    height = curve.evaluate(np.linspace(1.0, 2.0, 200))[:, 2]
    assert height.max() == pytest.approx(0.05, rel=1e-3)
    assert (height >= -1e-12).all()
    for order in (0, 1, 2):
        knots = np.array([1.0, 1.5, 2.0])
        jump = curve.evaluate(knots + 1e-9, order) - curve.evaluate(knots - 1e-9, order)
        assert np.allclose(jump, 0.0, atol=1e-6)


def test_pattern_keeps_its_zero_moment_point_in_the_soles(soles: tuple[Sole, ...]) -> None:
    """Independent of placo: the pendulum's equation, and the rectangle of the sole that carries."""
    com = np.array([0.04, 0.0, 0.67])
    steps = there_and_back(soles, 0, np.array([[0.08, 0.01, 0.1]] * 2), 0.8)
    pattern = plan_pattern(soles, steps, Timing(0.6, 3, 2), com)
    zmp = pattern.com - pattern.acceleration * com[2] / 9.81
    assert np.allclose(pattern.com[0], com[:2], atol=1e-9)
    assert np.allclose(pattern.velocity[[0, -1]], 0.0)
    assert len(pattern.swings) == len(steps)
    standing = {index: sole.print for index, sole in enumerate(soles)}
    for step, (start, end) in zip(steps, pattern.swings, strict=True):
        where = standing[1 - step.foot]
        inside = (pattern.time > start - 1e-9) & (pattern.time < end + 1e-9)
        assert inside.sum() == 3
        turned = np.array([[np.cos(where.yaw), np.sin(where.yaw)], [-np.sin(where.yaw), np.cos(where.yaw)]])
        away = np.abs((zmp[inside] - where.position) @ turned.T)
        sole = soles[1 - step.foot]
        assert (away <= [0.5 * sole.length - 0.015, 0.5 * sole.width - 0.015]).all()
        standing[step.foot] = step.print


def test_steps_that_no_one_can_take_are_refused(soles: tuple[Sole, ...]) -> None:
    steps = there_and_back(soles, 0, np.array([[3.0, 0.0, 0.0]] * 2), 1.0)
    with pytest.raises(NoSolutionError, match="footprints"):
        plan_pattern(soles, steps, Timing(0.05, 3, 2), np.array([0.04, 0.0, 0.67]))


def test_walks_alternate_and_say_where_the_zero_moment_point_is(walks: list[Candidate], g1: Robot) -> None:
    for walk in walks:
        single = [phase.feet[0] for phase in walk.phases if len(phase.feet) == 1]
        assert len(single) >= 4
        assert all(one != other for one, other in pairwise(single))
        assert walk.zmp is not None
        assert walk.zmp.length == pytest.approx(walk.length)
        for foot in g1.feet:
            s = np.linspace(0.0, walk.length, 2000)
            carried = walk.supports(s, foot.name)
            speed = np.abs(walk.feet[foot.name].evaluate(s, 1)).max(axis=1)
            assert speed[carried].max() < 1e-9
            assert speed.max() > 0.01


def test_walks_differ(walks: list[Candidate]) -> None:
    assert len({walk.length / walk.speed for walk in walks if walk.speed}) == len(walks)


def test_heavier_and_narrower_robots_rock_more_slowly(g1: Robot) -> None:
    """A rigid body on a torsion spring by hand, for the HRP-2-like robot: hip and ankle in series, broad sole."""
    robot = load_robot("hrp2like")
    stiffness = 1.0 / (2.0 / 20000.0 + 1e-4 / (robot.mass * 9.81 * 0.07**2))
    slack = 0.15
    inertia = robot.mass * 0.783**2
    by_hand = 2.0 * np.pi * np.sqrt(inertia / (stiffness - robot.mass * 9.81 * 0.783))
    assert by_hand * (1.0 - slack) < rocking_period(robot) < by_hand * (1.0 + 2.0 * slack)
    assert rocking_period(g1) > rocking_period(robot)


def test_people_do_not_walk_off_their_force_plates() -> None:
    human = load_robot("human")
    assert human.feet
    with pytest.raises(RobotError, match="force plates"):
        make_generator("walking").candidates(human, 1, np.random.SeedSequence(0))


def test_polynomials_go_through_their_knots() -> None:
    rng = np.random.default_rng(0)
    s = np.array([0.0, 0.7, 1.5])
    values, first, second = rng.normal(size=(3, 3, 2))
    curve = hermite_curve(s, values, first, second)
    for order, expected in enumerate((values, first, second)):
        assert np.allclose(curve.evaluate(s, order), expected)
    assert np.allclose(curve.shrunk(0.5).evaluate(s), values[0] + 0.5 * (values - values[0]))
    assert np.allclose(curve.shrunk(np.array([1.0, 0.0])).evaluate(s)[:, 1], values[0, 1])
    line = polyline_curve(s, values)
    assert np.allclose(line.evaluate(s), values)
    assert np.allclose(line.evaluate(np.array([0.35])), values[:2].mean(axis=0))
