"""Robots on points: sways and foot swings that are safe, and what cannot stand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import RobotError
from excite.motion.generators.generator import support_centre, support_corners
from excite.motion.generators.mixture import plan_candidates, usual_mix
from excite.motion.generators.registry import make_generator
from excite.robot.robot import Robot
from excite.safety.filter import filter_candidate
from excite.safety.ground_forces import polygon_margin
from excite.safety.repairs.rows import corner_shares
from tests.quadruped import quadruped, quadruped_description


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return quadruped(tmp_path_factory.mktemp("toy"))


@pytest.mark.parametrize("generator", ["sway", "foot_swing"])
def test_motions_on_points_are_safe(toy: Robot, generator: str) -> None:
    outcomes = [
        filter_candidate(toy, candidate)
        for candidate in make_generator(generator).candidates(toy, 4, np.random.SeedSequence(2))
    ]
    assert sum(outcome.rejection is None for outcome in outcomes) >= 3
    motions = [outcome.motion for outcome in outcomes if outcome.motion is not None]
    assert all(np.ptp(motion.joint_positions(), axis=0).max() > 0.2 for motion in motions)
    lifted = [not all(flags.all() for flags in motion.contacts.values()) for motion in motions]
    assert all(lifted) if generator == "foot_swing" else not any(lifted)


@pytest.mark.parametrize("base", ["held", "suspended"])
def test_legs_in_the_air_move_as_arms_do(tmp_path: Path, base: str) -> None:
    robot = quadruped(tmp_path, base)
    candidates = plan_candidates(robot, 4, np.random.SeedSequence(1))
    outcomes = [filter_candidate(robot, candidate) for candidate in candidates]
    assert {candidate.generator for candidate in candidates} == {"random_joint", "fourier"}
    assert sum(outcome.rejection is None for outcome in outcomes) >= 2
    for outcome in outcomes:
        if outcome.motion is not None and base == "suspended":
            assert np.allclose(outcome.motion.q[:, :7], robot.rest[:7])


def test_a_plan_leaves_out_what_does_not_apply(toy: Robot, g1: Robot) -> None:
    assert set(usual_mix(toy, aimed=False)) == {"sway", "foot_swing"}
    assert set(usual_mix(toy, aimed=True)) == {"sway", "foot_swing"}
    assert set(usual_mix(g1, aimed=False)) == {"random_joint", "leg_swing", "squat"}


def test_two_points_are_no_support_and_it_is_said(tmp_path: Path) -> None:
    robot = quadruped(tmp_path, feet=quadruped_description()["feet"][:2])
    with pytest.raises(RobotError, match=r"feet: its feet have no area.*suspended or held"):
        plan_candidates(robot, 2, np.random.SeedSequence(0), targets=["FL_knee"])


def test_load_shares_make_up_the_wrench(toy: Robot) -> None:
    data = toy.model.createData()
    pin.forwardKinematics(toy.model, data, toy.rest)
    soles = {f.name: np.array([data.oMi[f.joint].act(c) for c in f.sole]) for f in toy.feet}
    for lifted in range(4):
        carried = np.arange(4) != lifted
        shares = corner_shares(toy, soles, carried)
        assert np.allclose(shares.sum(axis=0), np.eye(6), atol=1e-9)
        assert not shares[lifted].any()
        # A point transmits no moment about itself.
        for foot, share in zip(toy.feet, shares, strict=True):
            assert np.allclose(share[3:], pin.skew(soles[foot.name][0]) @ share[:3], atol=1e-12)


def test_the_centre_of_mass_goes_well_inside_the_feet_that_stay(toy: Robot) -> None:
    stance = list(toy.feet[1:])
    corners = support_corners(toy, stance)
    point = support_centre(toy, stance, np.zeros(2))
    margin = polygon_margin(corners[None], point[None])[0]
    assert margin > 0.05
    # No further from where it rests than that takes.
    assert np.linalg.norm(point) < 0.1
