"""Limits that depend on a position: judged between samples, kept by plans, refused where they say nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

import excite
from excite.errors import RobotError
from excite.motion.motion import Motion
from excite.robot.catalogue import find_robot
from excite.robot.robot import Robot

NODES, FASTEST = [-2.0, 0.0, 2.0], [0.3, 3.0, 0.3]
ELBOW = "elbow_joint"


def described(folder: Path, *tables: dict[str, object]) -> Robot:
    """A UR10 whose description has these tables."""
    folder.mkdir(exist_ok=True)
    description = yaml.safe_load(find_robot("ur10").read_text())
    description["limits"]["by_position"] = [{**table, "source": "measured"} for table in tables]
    file = folder / "robot.yaml"
    file.write_text(yaml.safe_dump(description))
    return excite.load_robot(file)


def swing(robot: Robot, start: float, end: float, seconds: float) -> Motion:
    """The elbow alone from one angle to another as the quintic does, at 100 Hz."""
    time = np.linspace(0.0, seconds, round(100 * seconds) + 1)
    s = time / seconds
    shape = np.stack(
        [s**3 * (10 - 15 * s + 6 * s**2), 30 * (s * (1 - s)) ** 2, 60 * s * (1 - 3 * s + 2 * s**2)]
    )
    q, v, a = np.tile(robot.rest, (len(time), 1)), *np.zeros((2, len(time), robot.n_joints))
    elbow = robot.joint_index(ELBOW)
    q[:, elbow] = start + (end - start) * shape[0]
    v[:, elbow], a[:, elbow] = (end - start) * shape[1] / seconds, (end - start) * shape[2] / seconds**2
    return Motion("swing", robot.name, robot.joint_names, time, q, v, a)


def kinds(robot: Robot, motion: Motion) -> set[str]:
    return {violation.kind for violation in excite.check(robot, [motion]).verdicts[0].violations}


@pytest.fixture(scope="module")
def slower(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return described(
        tmp_path_factory.mktemp("slower"),
        {"joint": ELBOW, "quantity": "velocity", "at": NODES, "limit": FASTEST},
    )


@pytest.mark.parametrize(
    ("start", "end", "seconds", "safe"),
    [
        # 1.875 times the mean speed in the middle, where 2.3 rad/s and more hold.
        (-0.5, 0.5, 1.0, True),
        # The same from 1 to 2, where .3 to 1.65 rad/s do.
        (1.0, 2.0, 1.0, False),
        (1.0, 2.0, 8.0, True),
    ],
)
def test_a_velocity_limit_holds_where_the_joint_is(
    slower: Robot, start: float, end: float, seconds: float, safe: bool
) -> None:
    motion = swing(slower, start, end, seconds)
    fastest = np.interp(motion.q[:, 2], NODES, FASTEST)
    assert (np.abs(motion.v[:, 2]) <= fastest).all() == safe
    assert ("joint_velocity" not in kinds(slower, motion)) == safe


def test_a_violation_states_the_limit_at_its_place(slower: Robot) -> None:
    motion = swing(slower, 1.0, 2.0, 1.0)
    (violation,) = [
        one for one in excite.check(slower, [motion]).verdicts[0].violations if one.kind == "joint_velocity"
    ]
    angle = float(np.interp(violation.time_s, motion.time, motion.q[:, 2]))
    assert violation.where == ELBOW
    assert violation.limit == pytest.approx(np.interp(angle, NODES, FASTEST), abs=0.03)


def test_a_node_between_two_samples_counts(tmp_path: Path) -> None:
    """A dip of a tenth of a degree that no sample meets."""
    robot = described(
        tmp_path,
        {"joint": ELBOW, "quantity": "velocity", "at": [0.0003, 0.001, 0.0017], "limit": [2.0, 0.1, 2.0]},
    )
    motion = swing(robot, -1.0, 1.0, 2.0)
    assert (np.abs(motion.q[:, 2] - 0.001) > 5e-4).all()
    assert "joint_velocity" in kinds(robot, motion)
    assert "joint_velocity" not in kinds(robot, swing(robot, 0.5, 1.5, 2.0))


def test_torques_and_ranges_may_depend_on_another_joint(tmp_path: Path) -> None:
    lift = "shoulder_lift_joint"
    weak = {"joint": lift, "quantity": "torque", "over": ELBOW, "at": [0.0, 1.0], "limit": [330.0, 1.0]}
    robot = described(tmp_path / "weak", weak)
    assert "joint_torque" not in kinds(robot, swing(robot, -1.0, 0.0, 3.0))
    assert "joint_torque" in kinds(robot, swing(robot, 0.0, 1.0, 3.0))
    at_rest = float(robot.rest[robot.joint_index(lift)])
    narrow = {
        "joint": lift,
        "quantity": "position",
        "over": ELBOW,
        "at": [0.0, 1.0],
        "lower": [-6.0, at_rest + 0.2],
        "upper": [6.0, at_rest + 0.5],
    }
    robot = described(tmp_path / "narrow", narrow)
    assert "joint_position" not in kinds(robot, swing(robot, -1.0, 0.0, 3.0))
    assert "joint_position" in kinds(robot, swing(robot, 0.0, 1.0, 3.0))


def test_plans_keep_them(slower: Robot) -> None:
    plan = excite.plan(slower, n_candidates=6, seed=1)
    assert len(plan.motions) >= 2
    for motion in plan.motions:
        assert (np.abs(motion.v[:, 2]) <= np.interp(motion.q[:, 2], NODES, FASTEST)).all()
    assert excite.check(slower, plan.motions).safe


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"at": [0.0, 0.0, 1.0]}, "the positions have to increase"),
        ({"limit": [1.0, 2.0]}, "limit has to have 3 values"),
        ({"limit": [1.0, 0.0, 1.0]}, "greater than 0"),
        ({"quantity": "position"}, "limit has to have 0 values"),
        ({"joint": "knee"}, "no joint 'knee'"),
        ({"over": "knee"}, "no joint 'knee'"),
    ],
)
def test_tables_that_say_nothing_are_refused(changes: dict[str, object], said: str, tmp_path: Path) -> None:
    table = {"joint": ELBOW, "quantity": "velocity", "at": NODES, "limit": FASTEST, **changes}
    with pytest.raises(RobotError, match=said):
        described(tmp_path, table)
