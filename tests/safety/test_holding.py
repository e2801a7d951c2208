"""Postures that the drives cannot hold are neither rested in nor passed through."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.motion.generators.generator import leg_joints
from excite.motion.generators.registry import make_generator
from excite.robot.legs import _carrying_velocities, holding_torques
from excite.robot.loading import build_robot
from excite.robot.quantities import Torques
from excite.robot.robot import Robot
from excite.safety.filter import filter_candidate


@pytest.fixture(scope="module")
def weak_arm(arm: Robot) -> Robot:
    """The UR10 with a shoulder that cannot carry it stretched out, but carries it at rest."""
    weak = Torques(joints={"shoulder_lift_joint": 75.0}, source="weaker for a test")
    limits = arm.description.limits.model_copy(update={"torque": weak})
    return build_robot(arm.description.model_copy(update={"limits": limits}), Path(arm.source))


def test_which_joints_carry_is_looked_up_once_a_robot(humanoid: Robot) -> None:
    for _ in range(3):
        holding_torques(humanoid, humanoid.rest[None, humanoid.n_base_q :])
    before = _carrying_velocities.cache_info()
    holding_torques(humanoid, humanoid.rest[None, humanoid.n_base_q :])
    assert _carrying_velocities.cache_info().misses == before.misses


def test_holding_torques_are_those_of_inverse_dynamics_at_rest(arm: Robot, humanoid: Robot) -> None:
    rng = np.random.default_rng(3)
    for robot in (arm, humanoid):
        low, high = robot.limits.position_lower, robot.limits.position_upper
        joints = rng.uniform(low, high, size=(4, robot.n_joints))
        found = holding_torques(robot, joints)
        legs = sorted({i for foot in robot.feet for i in leg_joints(robot, foot)})
        others = np.setdiff1d(np.arange(robot.n_joints), legs)
        data, still = robot.model.createData(), np.zeros(robot.model.nv)
        for row, tau in zip(joints, found, strict=True):
            q = np.r_[robot.rest[: robot.n_base_q], row]
            true = pin.rnea(robot.model, data, q, still, still)[robot.n_base_v :]
            np.testing.assert_allclose(tau[others], true[others], atol=1e-9)
        assert not found[:, legs].any()


def test_candidates_of_a_weak_arm_stay_where_it_can_hold_itself(weak_arm: Robot) -> None:
    candidates = make_generator("random_joint").candidates(weak_arm, 6, np.random.SeedSequence(2))
    limit = weak_arm.limits.torque
    drawn = [
        np.abs(holding_torques(weak_arm, c.posture.evaluate(np.linspace(0.0, c.posture.length, 200))))
        for c in candidates
    ]
    assert sum(bool((tau > limit).any()) for tau in drawn) >= 5
    outcomes = [filter_candidate(weak_arm, candidate) for candidate in candidates]
    safe = [one.motion for one in outcomes if one.motion is not None]
    assert len(safe) >= 5
    for motion in safe:
        assert (np.abs(holding_torques(weak_arm, motion.q)) < limit).all()
