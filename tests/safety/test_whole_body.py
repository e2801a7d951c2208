"""Base and legs that follow pelvis, centre of mass and feet as a candidate asks; walks that follow the ZMP."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.spatial.transform import Rotation

from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.generator import Candidate, pelvis_joint
from excite.motion.generators.registry import make_generator
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.repairs.collisions import CollisionProbe
from excite.safety.repairs.draft import Draft, Rejection
from excite.safety.repairs.whole_body import Balancer, WholeBody, path_grid
from tests.robot.test_scaffold import biped, written


@pytest.fixture(scope="module")
def repair(g1: Robot) -> WholeBody:
    return WholeBody(g1, CollisionProbe(g1))


@pytest.fixture(scope="module")
def swing(g1: Robot) -> Candidate:
    return make_generator("leg_swing").candidates(g1, 1, np.random.SeedSequence(4))[0]


def standing(robot: Robot, candidate: Candidate, **changes: object) -> Candidate:
    """The candidate with the upper body at rest and some curves replaced."""
    control = np.tile(robot.rest[robot.n_base_q :], (len(candidate.posture.control), 1))
    return replace(candidate, posture=SplineCurve(control), **changes)


def test_feet_pelvis_and_centre_of_mass_are_where_they_are_asked_for(
    g1: Robot, repair: WholeBody, swing: Candidate
) -> None:
    """Feet are moved and turned about their sole's middle, the pelvis about fixed axes x, y, z."""
    (free,) = (foot for foot in g1.feet if foot.name in swing.feet)
    feet = {free.name: SplineCurve(0.5 * swing.feet[free.name].control)}
    wish = standing(g1, swing, feet=feet)
    outcome = repair.repair(Draft(wish))
    assert isinstance(outcome, Draft) and outcome.path is not None
    assert outcome.candidate is wish, "what can be reached is not made milder"
    data = g1.model.createData()
    pelvis = pelvis_joint(g1)
    pin.forwardKinematics(g1.model, data, g1.rest)
    foot_rest, pelvis_rest = data.oMi[free.joint].copy(), data.oMi[pelvis].copy()
    com_rest = pin.centerOfMass(g1.model, data, g1.rest).copy()
    middle = free.placement.translation
    turned = 0.0
    knots = outcome.path.knots
    for k in range(0, len(knots.s), 12):
        s = knots.s[k : k + 1]
        pin.forwardKinematics(g1.model, data, knots.q[k])
        asked = feet[free.name].evaluate(s)[0]
        pose = data.oMi[free.joint]
        assert np.allclose(pose.act(middle), foot_rest.act(middle) + asked[:3], atol=1e-6)
        rotation = Rotation.from_rotvec(asked[3:]).as_matrix() @ foot_rest.rotation
        assert np.allclose(pose.rotation, rotation, atol=1e-6)
        turned = max(turned, float(np.linalg.norm(asked[3:])))
        height, *angles = wish.pelvis.evaluate(s)[0]
        assert data.oMi[pelvis].translation[2] == pytest.approx(pelvis_rest.translation[2] + height, abs=1e-6)
        rotation = pin.rpy.rpyToMatrix(*angles) @ pelvis_rest.rotation
        assert np.allclose(data.oMi[pelvis].rotation, rotation, atol=1e-6)
        com = pin.centerOfMass(g1.model, data, knots.q[k])
        assert np.allclose(com[:2], com_rest[:2] + wish.com.evaluate(s)[0], atol=1e-6)
    assert turned > 0.05


def test_a_free_foot_below_the_ground_is_refused(g1: Robot, repair: WholeBody, swing: Candidate) -> None:
    (name,) = swing.feet
    for depth, refused in ((0.0008, False), (0.004, True)):
        control = np.zeros_like(swing.feet[name].control)
        control[5:-5, 2] = -depth
        outcome = repair.repair(Draft(standing(g1, swing, feet={name: SplineCurve(control)})))
        assert isinstance(outcome, Rejection) is refused
        if refused:
            assert (outcome.reason, outcome.where) == ("foot_ground", name)


def test_a_joint_beyond_its_range_is_named(g1: Robot, repair: WholeBody, swing: Candidate) -> None:
    elbow, upper = g1.joint_index("left_elbow_joint"), g1.limits.position_upper
    wish = standing(g1, swing, feet={}, pelvis=None, com=None, phases=())
    wish = replace(
        wish, phases=make_generator("squat").candidates(g1, 1, np.random.SeedSequence(1))[0].phases
    )
    for beyond, refused in ((-2e-3, False), (-0.5e-3, True)):
        control = wish.posture.control.copy()
        control[4:-4, elbow] = upper[elbow] + beyond
        outcome = repair.repair(Draft(replace(wish, posture=SplineCurve(control))))
        if refused:
            assert isinstance(outcome, Rejection)
            assert (outcome.reason, outcome.where) == ("joint_position", "left_elbow_joint")
        else:
            assert not (isinstance(outcome, Rejection) and outcome.reason == "joint_position")


def test_the_grid_of_a_path_is_as_fine_as_its_curves(swing: Candidate) -> None:
    grid = path_grid(swing)
    assert len(grid) == 12 * round(swing.length) + 1
    assert (grid[0], grid[-1]) == (0.0, swing.length)
    panda = load_robot("panda")
    series = make_generator("fourier").candidates(panda, 1, np.random.SeedSequence(0))[0]
    assert len(path_grid(series)) == max(60, int(np.ceil(series.length * 40.0))) + 1


def test_an_arm_s_path_is_its_posture() -> None:
    panda = load_robot("panda")
    candidate = make_generator("fourier").candidates(panda, 1, np.random.SeedSequence(0))[0]
    outcome = WholeBody(panda, CollisionProbe(panda)).repair(Draft(candidate))
    assert isinstance(outcome, Draft) and outcome.path is not None
    assert np.allclose(outcome.path.knots.q, candidate.posture.evaluate(outcome.path.s))


@pytest.mark.parametrize("spread", [0.0, 0.1, 0.2])
def test_legs_that_stand_apart_reach_their_feet_while_the_weight_shifts(
    spread: float, tmp_path: Path
) -> None:
    """The pelvis goes down as far as the leg needs that is left behind, by 3 % of its height where feet are near."""
    written(biped(), tmp_path)
    content = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    joints = content["posture"]["joints"]
    for side, out in (("left", 1.0), ("right", -1.0)):
        angles = {"hip_roll": out * spread, "hip_pitch": 0.35, "knee": -0.7, "ankle_pitch": 0.35}
        angles["ankle_roll"] = -out * spread
        joints.update({f"{side}_{name}_joint": angle for name, angle in angles.items()})
    (tmp_path / "apart.yaml").write_text(yaml.safe_dump(content))
    robot = load_robot(tmp_path / "apart.yaml")
    candidate = make_generator("leg_swing").candidates(robot, 1, np.random.SeedSequence(0))[0]
    s = path_grid(candidate)
    q = np.tile(robot.rest, (len(s), 1))
    q[:, robot.n_base_q :] = candidate.posture.evaluate(s)
    both_down = s <= candidate.phases[0].end
    assert Balancer(robot).solve(candidate, s[both_down], q[both_down]) == both_down.sum()
