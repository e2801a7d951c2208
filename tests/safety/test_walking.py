"""Walks through the filter: the zero-moment point where it was asked for, and upright in simulation."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain, islice

import numpy as np
import pinocchio as pin
import pytest

from excite.motion.generators.generator import Candidate
from excite.motion.generators.registry import make_generator
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.checks.sweep import Sweep
from excite.safety.filter import SafetyFilter
from tests.simulation.motions import replay_motion


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("hrp2like")


@pytest.fixture(scope="module")
def candidate(robot: Robot) -> Candidate:
    return make_generator("walking").candidates(robot, 1, np.random.SeedSequence(7))[0]


@pytest.fixture(scope="module")
def walk(robot: Robot, candidate: Candidate) -> Motion:
    outcome = SafetyFilter(robot).filter(candidate)
    assert outcome.rejection is None, outcome.rejection
    assert outcome.motion is not None
    return outcome.motion


def test_zero_moment_point_is_where_it_was_asked_for(
    robot: Robot, candidate: Candidate, walk: Motion
) -> None:
    """From the motion file's own columns, by inverse dynamics; the pendulum alone is off by centimetres."""
    assert candidate.zmp is not None and candidate.speed is not None
    sweep = Sweep(robot, walk)
    rest = pin.centerOfMass(robot.model, robot.model.createData(), robot.rest)[:2]
    s = np.clip(sweep.fine.time / walk.duration, 0.0, 1.0) * candidate.length
    error = np.linalg.norm(sweep.zmp - rest - candidate.zmp.evaluate(s), axis=1)
    assert np.median(error) < 1e-3
    assert error.max() < 0.015
    assert check_motion(robot, walk).margins.zmp_m > 0.03


def test_walk_is_the_same_again(robot: Robot, candidate: Candidate, walk: Motion) -> None:
    again = SafetyFilter(robot).filter(candidate).motion
    assert again is not None
    for name in ("time", "q", "v", "a"):
        assert getattr(again, name).tobytes() == getattr(walk, name).tobytes()


def test_walk_comes_home(robot: Robot, walk: Motion) -> None:
    assert np.allclose(walk.q[[0, -1]], robot.rest, atol=1e-6)
    assert np.allclose(walk.v[[0, -1]], 0.0, atol=1e-6)
    single = sum(~walk.contacts[foot.name] for foot in robot.feet)
    assert single.max() == 1
    assert 0.3 < single.mean() < 0.9


def test_slower_the_same_walk_is_refused(robot: Robot, walk: Motion) -> None:
    slow = replace(walk, time=walk.time / 0.7, v=0.7 * walk.v, a=0.49 * walk.a)
    assert {violation.kind for violation in check_motion(robot, slow).violations} & {"zmp", "com"}


def test_walk_stands_in_simulation(robot: Robot, walk: Motion) -> None:
    run = replay_motion(robot, walk, mass_error=0.05, friction_error=-0.05)
    assert run.on_its_feet, run
    assert run.max_slip_m < 5e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["g1", pytest.param("talos", marks=pytest.mark.battery)])
def test_walks_of_the_other_humanoids_stand(name: str) -> None:
    robot = load_robot(name)
    candidates = make_generator("walking").candidates(robot, 6, np.random.SeedSequence(7))
    safety = SafetyFilter(robot)
    accepted = (outcome.motion for outcome in map(safety.filter, candidates) if outcome.motion is not None)
    first = list(islice(accepted, 2))
    assert len(first) == 2
    assert any(replay_motion(robot, motion).on_its_feet for motion in chain(first, islice(accepted, 1)))
