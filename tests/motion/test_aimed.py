"""Motion aimed at a joint: much of it there and next to it, hardly any elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from excite.motion.generators.bodyparts import central_range, leg_joints
from excite.motion.generators.registry import make_generator
from excite.robot.loading import load_robot
from excite.robot.robot import Robot

_SEED = np.random.SeedSequence(5)


def _travel(robot: Robot, joint: str, count: int) -> np.ndarray:
    """Way from end to end of each joint in shares of its central range, the mean of ``count`` motions."""
    lower, upper = central_range(robot)
    drawn = make_generator("aimed").candidates(robot, count, _SEED, [joint])
    positions = [c.posture.evaluate(np.linspace(0.0, c.length, 400)) for c in drawn]
    return np.mean([np.ptp(q, axis=0) for q in positions], axis=0) / (upper - lower)


@pytest.mark.parametrize(("robot", "joint"), [("panda", "panda_joint4"), ("g1", "left_elbow_joint")])
def test_targets_move_far_and_others_hardly(robot: str, joint: str) -> None:
    loaded = load_robot(robot)
    travel = _travel(loaded, joint, 4)
    at = loaded.joint_index(joint)
    assert travel[at] > 0.6
    assert travel[at - 1] > 0.15
    assert travel[at + 1] > 0.15
    far = [i for i in range(loaded.n_joints) if abs(i - at) > 1]
    assert travel[far].max() < 0.06


def test_neighbours_are_those_of_the_tree_not_of_the_list(g1: Robot) -> None:
    """The left shoulder hangs on the waist; the wrist is farther away than the next column."""
    travel = _travel(g1, "left_shoulder_pitch_joint", 4)
    assert travel[g1.joint_index("waist_pitch_joint")] > 0.15
    assert travel[g1.joint_index("left_shoulder_roll_joint")] > 0.15
    assert travel[g1.joint_index("left_wrist_yaw_joint")] < 0.06


def test_a_leg_is_aimed_at_on_the_other_foot(g1: Robot) -> None:
    left, right = g1.feet
    knee = g1.joint_names[leg_joints(g1, right)[3]]
    (candidate,) = make_generator("aimed").candidates(g1, 1, _SEED, [knee])
    assert candidate.generator == "aimed"
    assert candidate.targets == (knee,)
    assert {phase.feet for phase in candidate.phases if len(phase.feet) == 1} == {(left.name,)}
