"""A space that no body leaves: random and designed motions stay in it, and what leaves it is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from excite.campaign.plan import Plan, plan
from excite.errors import RobotError
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.shapes.collision import SURROUNDINGS, collision_shapes
from excite.robot.shapes.shape import shape_points
from excite.safety.check import check_motion

CELL = [[-0.6, -0.4, -0.02], [0.95, 0.5, 1.15]]


def in_a_cell(robot: Robot, folder: Path, cell: list[list[float]]) -> Robot:
    content = yaml.safe_load(robot.source.read_text())
    content["collision"]["cell"] = cell
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(content))
    return load_robot(path)


@pytest.fixture(scope="module")
def celled(ur10: Robot, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return in_a_cell(ur10, tmp_path_factory.mktemp("cell"), CELL)


def extent(made: Plan) -> np.ndarray:
    """Lowest and highest corner of all that moves beyond the first joint, ``(2, 3)`` [m]."""
    model, found = made.robot.model, []
    data = model.createData()
    shapes = [one for one in collision_shapes(made.robot) if one.link not in SURROUNDINGS and one.joint > 1]
    for motion in made.motions:
        for q in motion.q[::5]:
            pin.forwardKinematics(model, data, q)
            points = [shape_points(one) @ data.oMi[one.joint].rotation.T + data.oMi[one.joint].translation
                      for one in shapes]  # fmt: skip
            found += [[part.min(axis=0), part.max(axis=0)] for part in points]
    ends = np.array(found)
    return np.array([ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)])


@pytest.mark.parametrize(("generator", "n_candidates"), [("reach", 3), ("gradient", 2)])
def test_motions_stay_in_the_cell_and_use_it(celled: Robot, generator: str, n_candidates: int) -> None:
    made = plan(celled, generator=generator, n_candidates=n_candidates, seed=0)
    assert {motion.metadata.generator for motion in made.motions} == {generator}
    (low, high), (lowest, highest) = extent(made), np.array(CELL)
    assert (low > lowest).all()
    assert (high < highest).all()
    assert ((high - low) > 0.6 * (highest - lowest)).all()


def test_a_plan_in_a_cell_draws_hands_too(celled: Robot) -> None:
    made = plan(celled, n_candidates=4, seed=0)
    assert "reach" in {entry.generator for entry in made.pool.entries}


def test_a_motion_that_leaves_the_cell_is_refused(celled: Robot, small_plan: Plan) -> None:
    verdict = check_motion(celled, small_plan.motions[0])
    where = {one.where.rpartition(" - ")[2] for one in verdict.violations if one.kind == "self_collision"}
    assert where
    assert all(name.startswith("cell_") for name in where)


def test_a_hand_without_a_stated_space_has_no_such_motions(ur10: Robot) -> None:
    with pytest.raises(RobotError, match=r"collision\.cell"):
        plan(ur10, generator="reach", n_candidates=1)


def test_corners_the_wrong_way_round_are_refused(ur10: Robot, tmp_path: Path) -> None:
    robot = in_a_cell(ur10, tmp_path, CELL[::-1])
    with pytest.raises(RobotError, match=r"collision\.cell.*lowest corner, then the highest"):
        plan(robot, n_candidates=1)
