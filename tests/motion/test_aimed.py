"""Motion aimed at a joint: much of it there and next to it, hardly any elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from excite.motion.generators.generator import central_range, leg_joints
from excite.motion.generators.registry import make_generator
from excite.robot.loading import load_robot
from excite.robot.robot import Robot

_SEED = np.random.SeedSequence(5)


def _ways(robot: Robot, joint: str) -> np.ndarray:
    """Way that each joint makes in a motion, in ranges from end to end, the mean of a few."""
    lower, upper = central_range(robot)
    drawn = make_generator("aimed").candidates(robot, 4, _SEED, [joint])
    positions = [c.posture.evaluate(np.linspace(0.0, c.length, 400)) for c in drawn]
    return np.mean([np.abs(np.diff(q, axis=0)).sum(axis=0) for q in positions], axis=0) / (upper - lower)


@pytest.mark.parametrize(("robot", "joint"), [("panda", "panda_joint4"), ("g1", "left_elbow_joint")])
def test_targets_move_far_and_often_and_others_slowly(robot: str, joint: str) -> None:
    loaded = load_robot(robot)
    ways = _ways(loaded, joint)
    at = loaded.joint_index(joint)
    assert ways[at] > 3.0
    assert ways[at] == ways.max()
    assert (ways[[at - 1, at + 1]] > 0.5).all()
    far = [i for i in range(loaded.n_joints) if abs(i - at) > 1]
    assert ways[far].max() < 0.35 * ways[at]


def test_neighbours_are_those_of_the_tree_not_of_the_list(g1: Robot) -> None:
    """The left shoulder hangs on the waist, though columns lie between."""
    ways = _ways(g1, "left_shoulder_pitch_joint")
    near = [g1.joint_index(name) for name in ("waist_pitch_joint", "left_shoulder_roll_joint")]
    right = [i for i, name in enumerate(g1.joint_names) if name.startswith("right_") and "hip" not in name]
    assert ways[near].min() > ways[right].max()


def test_a_leg_is_aimed_at_on_the_other_foot(g1: Robot) -> None:
    left, right = g1.feet
    knee = g1.joint_names[leg_joints(g1, right)[3]]
    (candidate,) = make_generator("aimed").candidates(g1, 1, _SEED, [knee])
    assert candidate.generator == "aimed"
    assert candidate.targets == (knee,)
    assert {phase.feet for phase in candidate.phases if len(phase.feet) == 1} == {(left.name,)}
