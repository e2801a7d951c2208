"""LowCmd sequences: read back by json, each motor where the vendor's SDK has it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from excite.errors import MotionError
from excite.export.export import export_motion
from excite.formats.unitree import G1, H1, QUADRUPED
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.export.conftest import ready
from tests.safety.motions import check_file

GAINS = {"kp": 60, "kd": 2}


def lines(path: Path) -> tuple[dict, list[dict]]:
    first, *rest = [json.loads(line) for line in path.read_text().splitlines()]
    return first["excite"], rest


def test_every_motor_of_a_g1_gets_its_joint_at_500_hz(tmp_path: Path) -> None:
    g1, squat = ready("g1")
    # As the vendor's example has them, by motor; and those of the description, by name.
    kp = [60, 60, 60, 100, 40, 40] * 2 + [60, 40, 40] + [40] * 14
    gains = {"kp": ",".join(map(str, kp)), "kd": "model"}
    path = export_motion(squat, g1, "unitree", tmp_path / "squat", settings=gains)
    same = np.load(export_motion(squat, g1, "npz", tmp_path / "same", 500.0))
    said, rows = lines(path)
    assert [row["t"] for row in rows] == list(same["time"])
    for field, values in (("q", same["q"]), ("dq", same["v"])):
        sent = np.array([[command[field] for command in row["motor_cmd"]] for row in rows])
        # The G1's model has its joints in the order of its motors.
        np.testing.assert_array_equal(sent, values)
    assert [command["index"] for command in rows[7]["motor_cmd"]] == list(range(29))
    assert [command["kp"] for command in rows[0]["motor_cmd"]] == kp
    kd = g1.description.controller.kd
    knee = rows[0]["motor_cmd"][3]
    assert said["motors"]["3"] == "left_knee_joint" and knee["mode"] == 1 and knee["tau"] == 0.0
    assert knee["kd"] == (kd.joints or {}).get("left_knee_joint", kd.default)
    assert said["verdict"]["safe"] and said["mode_pr"] == 0


def standing_still(robot: Robot) -> Motion:
    """0.6 s at 100 Hz in the robot's rest posture, on all feet."""
    time = np.arange(61) / 100.0
    zero = np.zeros((len(time), robot.model.nv))
    contacts = {foot.name: np.ones(len(time), dtype=bool) for foot in robot.feet}
    q = np.tile(robot.rest, (len(time), 1))
    return Motion("still", robot.name, robot.joint_names, time, q, zero, zero, contacts)


def test_a_quadrupeds_legs_are_in_the_sdks_order_not_the_models(tmp_path: Path) -> None:
    robot = load_robot("go2")
    path = export_motion(
        standing_still(robot), robot, "unitree", tmp_path / "still", settings={"kp": 40, "kd": "2"}
    )
    said, rows = lines(path)
    assert [said["motors"][str(k)] for k in (0, 3, 6, 9)] == [
        "FR_hip_joint",
        "FL_hip_joint",
        "RR_hip_joint",
        "RL_hip_joint",
    ]
    position = dict(zip(robot.joint_names, robot.rest[7:], strict=True))
    for command in rows[0]["motor_cmd"]:
        assert command["q"] == position[said["motors"][str(command["index"])]]
        assert (command["kp"], command["kd"]) == (40.0, 2.0)


def test_motors_are_where_the_vendors_sdk_has_them() -> None:
    """Places of the SDK's enumerations (``H1JointIndex``, ``G1JointIndex``) and of its Go2 example."""
    assert [QUADRUPED.index(name) for name in ("FR_hip", "FL_hip", "RR_calf", "RL_calf")] == [0, 3, 8, 11]
    assert [H1.index(f"left_{name}") for name in ("hip_yaw", "ankle", "shoulder_pitch")] == [7, 10, 16]
    assert (H1.index("right_hip_roll"), H1.index("torso"), H1[9], len(H1)) == (0, 6, "", 20)
    assert [G1.index(name) for name in ("left_hip_pitch", "waist_yaw", "right_wrist_yaw")] == [0, 12, 28]


def test_a_robot_that_nobody_knows_says_its_order(tmp_path: Path) -> None:
    robot, motion = ready("ur10")
    turned = [*reversed(robot.joint_names)]
    order = ",".join([turned[0], "-", *turned[1:]])
    path = export_motion(motion, robot, "unitree", tmp_path / "a", settings={"motors": order, **GAINS})
    said, rows = lines(path)
    assert [command["index"] for command in rows[0]["motor_cmd"]] == [0, 2, 3, 4, 5, 6]
    assert said["motors"]["0"] == "wrist_3_joint" and rows[0]["motor_cmd"][0]["q"] == motion.q[0, 5]
    verdict = check_file(robot, path)
    assert verdict.safe, verdict.violations
    own = export_motion(motion, robot, "unitree", tmp_path / "c", settings={"motors": "model", **GAINS})
    assert lines(own)[0]["motors"] == {str(k): joint for k, joint in enumerate(robot.joint_names)}
    text = path.read_text()
    for spoilt in (text.replace('"index": 6', '"index": 7', 1), text + "{}\n", text.splitlines()[0] + "\n"):
        path.write_text(spoilt)
        with pytest.raises(MotionError) as caught_again:
            load_motion(path, robot)
        assert "\n" not in str(caught_again.value)


def test_a_rate_other_than_500_hz_may_be_asked_for(tmp_path: Path) -> None:
    g1, squat = ready("g1")
    path = export_motion(squat, g1, "unitree", tmp_path / "squat", 250.0, settings=GAINS)
    _, rows = lines(path)
    assert rows[1]["t"] == 0.004
