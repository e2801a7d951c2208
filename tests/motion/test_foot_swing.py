"""Swings of one foot of several: where the feet stand decides whether the legs reach."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

import excite
from excite.errors import NothingSafeError
from excite.motion.generators.registry import make_generator
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.repairs.whole_body import Balancer, path_grid
from tests.robot.test_scaffold import quadruped, written

_BEND = 0.6


def _standing(folder: Path, apart: float) -> Robot:
    """A quadruped with its feet below its hips, or each leg turned outwards from there by ``apart`` [rad]."""
    written(quadruped(), folder)
    content = yaml.safe_load((folder / "robot.yaml").read_text())
    joints = {}
    for end, side in (("front", 1.0), ("hind", -1.0)):
        for hand in ("left", "right"):
            joints[f"{end}_{hand}_pitch"] = -side * (_BEND + apart)
            joints[f"{end}_{hand}_knee"] = side * 2.0 * _BEND
    content["posture"]["joints"] = joints
    path = folder / "standing.yaml"
    path.write_text(yaml.safe_dump(content))
    return load_robot(path)


@pytest.mark.parametrize(("apart", "reached"), [(0.0, True), (0.5, False)])
def test_legs_as_bent_reach_where_the_feet_are_below_the_hips(
    apart: float, reached: bool, tmp_path: Path
) -> None:
    robot = _standing(tmp_path, apart)
    candidates = make_generator("foot_swing").candidates(robot, 4, np.random.SeedSequence(0))
    for candidate in candidates:
        s = path_grid(candidate)
        q = np.tile(robot.rest, (len(s), 1))
        q[:, robot.n_base_q :] = candidate.posture.evaluate(s)
        assert (Balancer(robot).solve(candidate, s, q) == len(s)) is reached


def test_the_advice_is_to_put_the_feet_below_the_hips(tmp_path: Path) -> None:
    robot = _standing(tmp_path, 0.5)
    with pytest.raises(
        NothingSafeError, match=r"unreachable of legs; .*feet are nearer to one another and below the hips"
    ):
        excite.plan(robot, generator="foot_swing", n_candidates=4, seed=0)
