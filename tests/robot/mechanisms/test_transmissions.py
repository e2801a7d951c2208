"""Motors that drive joints over rods and gears, against the geometry of a crank and the balance of power."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from excite.errors import LogError, RobotError
from excite.logs.header_blocks import TrialHeader
from excite.logs.robot import robot_in_log
from excite.regressor.contact_forces import motor_torques
from excite.regressor.kernels import inverse_dynamics
from excite.robot.init_robot.files import write_scaffold
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.simulation.sensing import log_header
from excite.simulation.true_parameters import nominal_drives

_INERTIA = '<inertia ixx=".003" ixy="0" ixz="0" iyy=".004" iyz="0" izz=".002"/>'


def _link(name: str, mass: float, centre: str) -> str:
    inertial = f'<inertial><origin xyz="{centre}"/><mass value="{mass}"/>{_INERTIA}</inertial>'
    shape = '<collision><geometry><box size=".04 .04 .04"/></geometry></collision>'
    return f'<link name="{name}">{inertial}{shape}</link>'


def _hinge(name: str, parent: str, child: str, origin: str, axis: str) -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{origin}"/><axis xyz="{axis}"/>'
    limit = '<limit lower="-.8" upper=".8" velocity="8" effort="60"/>'
    return f'<joint name="{name}" type="revolute">{ends}{limit}</joint>'


LEG = (
    '<robot name="leg">'
    + _link("thigh", 3.0, "0 0 .1")
    + _link("shank", 2.0, "0 0 -.1")
    + _link("cross", 0.1, "0 0 0")
    + _link("foot", 0.9, ".04 .002 -.03")
    + _hinge("knee", "thigh", "shank", "0 0 -.3", "0 1 0")
    + _hinge("pitch", "shank", "cross", "0 0 -.3", "0 1 0")
    + _hinge("roll", "cross", "foot", "0 0 0", "1 0 0")
    + "</robot>"
)
_LIMITS = {"position": [-1.2, 1.2], "velocity": 10.0, "torque": 25.0}


def _rod(name: str, side: float) -> dict[str, object]:
    return {
        "name": name,
        "link": "shank",
        "xyz": [-0.01, side, -0.05],
        "axis": [0, 1, 0],
        "crank": [-0.05, 0, 0],
        "rod": {"link": "foot", "xyz": [-0.06, side, 0.01]},
        **_LIMITS,
    }


RODS = [_rod("A", 0.03), _rod("B", -0.03)]
GEARS = [
    {"name": "A", "link": "shank", "ratios": {"pitch": 2.0, "roll": 1.0}, **_LIMITS},
    {"name": "B", "link": "shank", "ratios": {"pitch": 2.0, "roll": -1.0}, **_LIMITS},
]


def leg(folder: Path, motors: list[dict[str, object]]) -> Robot:
    (folder / "leg.urdf").write_text(LEG, encoding="utf-8")
    file = write_scaffold(folder / "leg.urdf", folder).description
    content = yaml.safe_load(file.read_text())
    block = {"name": "ankle", "joints": ["pitch", "roll"], "motors": motors, "source": "test"}
    content |= {"transmissions": [block], "drives": {"armature": {"default": 0.01, "source": "test"}}}
    content |= {"base": "fixed", "posture": {"source": "test"}}
    content.pop("feet", None)
    content["sensors"].pop("imu", None)
    content["collision"]["table_height"] = -2.0
    for values in (*content["limits"].values(), *content["controller"].values()):
        if "joints" in values:
            values["joints"] |= dict.fromkeys(("A", "B"), 5.0)
    content["sensors"]["noise_torque"]["joints"] |= dict.fromkeys(("A", "B"), 0.05)
    content["limits"]["torque"] = {"joints": {}, "source": "test"}
    content["limits"]["position"].pop("joints", None)
    file.write_text(yaml.safe_dump(content))
    return load_robot(file)


def _crank_angle(side: float, pitch: float, roll: float) -> float:
    """By the length of its rod, which is that of the zero posture."""
    axis = np.array([-0.01, side, -0.05])
    turn = Rotation.from_euler("y", pitch) * Rotation.from_euler("x", roll)
    ball = np.array([0.0, 0.0, -0.3]) + turn.apply([-0.06, side, 0.01])
    length = np.linalg.norm(np.array([-0.06, side, -0.29]) - axis - [-0.05, 0.0, 0.0])

    def gap(angle: float) -> float:
        return float(
            np.linalg.norm(ball - axis - Rotation.from_euler("y", angle).apply([-0.05, 0, 0])) - length
        )

    return float(brentq(gap, -0.9, 0.9, xtol=1e-14))


def _states(robot: Robot, of_motors: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    q, v, a = (np.zeros((6, robot.model.nv)) for _ in range(3))
    for name in ("knee", *(("A", "B") if of_motors else ("pitch", "roll"))):
        column = robot.joint_index(name)
        q[:, column] = rng.uniform(-0.3, 0.3, 6)
        v[:, column], a[:, column] = rng.normal(size=(2, 6))
    assert robot.mechanism is not None
    columns = np.array([robot.joint_index(name) for name in ("pitch", "roll")])
    by = robot.mechanism if of_motors else robot.mechanism.following_from(columns)
    return by.complete_motion(q, v, a)


def test_motors_stand_where_their_rods_hold_them(tmp_path: Path) -> None:
    """Both ways: joints' positions give the cranks', and cranks' the joints'."""
    robot = leg(tmp_path, RODS)
    assert sorted(robot.driven_names) == ["A", "B", "knee"]
    q, _, _ = _states(robot, of_motors=False)
    pitch, roll, first, second = (q[:, robot.joint_index(name)] for name in ("pitch", "roll", "A", "B"))
    for row in range(len(q)):
        assert first[row] == pytest.approx(_crank_angle(0.03, pitch[row], roll[row]), abs=1e-8)
        assert second[row] == pytest.approx(_crank_angle(-0.03, pitch[row], roll[row]), abs=1e-8)
    assert robot.mechanism is not None
    guess = q.copy()
    guess[:, robot.passive] = 0.0
    np.testing.assert_allclose(robot.mechanism.close_configurations(guess), q, atol=1e-8)


@pytest.mark.parametrize("motors", [RODS, GEARS], ids=["rods", "gears"])
def test_motors_do_the_work_of_the_joints(motors: list[dict[str, object]], tmp_path: Path) -> None:
    robot = leg(tmp_path, motors)
    q, v, a = _states(robot, of_motors=True)
    tree, found = inverse_dynamics(robot.model, q, v, a), motor_torques(robot, q, v, a)
    assert not found[:, robot.passive].any()
    # For any velocity that the mechanism allows, not just for the motion's own.
    rng = np.random.default_rng(2)
    assert robot.mechanism is not None
    other = robot.mechanism.follow_driven(q, rng.normal(size=v.shape), a).v
    np.testing.assert_allclose((found * other).sum(axis=1), (tree * other).sum(axis=1), atol=1e-9)
    if motors is GEARS:
        pitch, roll, first, second = (robot.joint_index(name) for name in ("pitch", "roll", "A", "B"))
        np.testing.assert_allclose(q[:, first], 2.0 * q[:, pitch] + q[:, roll], atol=1e-9)
        np.testing.assert_allclose(tree[:, pitch], 2.0 * (found[:, first] + found[:, second]), atol=1e-7)
        np.testing.assert_allclose(tree[:, roll], found[:, first] - found[:, second], atol=1e-7)


def test_limits_and_rotors_are_the_motors(tmp_path: Path) -> None:
    robot = leg(tmp_path, RODS)
    drives = nominal_drives(robot)
    for name, passive in zip(robot.joint_names, robot.passive, strict=True):
        index = robot.joint_index(name)
        assert drives.armature[index] == (0.0 if passive else 0.01)
        assert (drives.kp[index] == 0.0) == passive
    assert robot.limits.torque[robot.joint_index("A")] == 25.0
    assert robot.limits.position_upper[robot.joint_index("A")] == pytest.approx(1.2, abs=0.05)


def test_a_log_of_motors_and_one_of_joints_are_both_read(tmp_path: Path) -> None:
    """As Unitree's ankles are, in mode A/B or PR: what a log has is what its torques belong to."""
    robot = leg(tmp_path, RODS)
    header = log_header(robot, (TrialHeader(file="one.parquet", role="identification"),))
    assert set(header.joints) == {"knee", "A", "B"}
    assert list(robot_in_log(robot, header).driven_names) == list(robot.driven_names)
    joints = robot_in_log(robot, header.model_copy(update={"joints": ("knee", "pitch", "roll")}))
    assert set(joints.driven_names) == {"knee", "pitch", "roll"}
    q, v, a = _states(robot, of_motors=False)
    tree, found = inverse_dynamics(robot.model, q, v, a), motor_torques(joints, q, v, a)
    columns = [robot.joint_index(name) for name in ("knee", "pitch", "roll")]
    # The cranks weigh 1e-8 kg.
    np.testing.assert_allclose(found[:, columns], tree[:, columns], atol=1e-7)
    with pytest.raises(LogError, match="follows from others that it has"):
        robot_in_log(robot, header.model_copy(update={"joints": ("knee", "pitch", "roll", "A")}))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"link": "gone"}, r"transmissions\.ankle\.A\.link: no link 'gone'"),
        ({"name": "knee"}, "name of a joint already"),
        ({"ratios": {"pitch": 1.0}}, "either crank and rod, or ratios"),
    ],
)
def test_faults_are_named(change: dict[str, object], message: str, tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=message):
        leg(tmp_path, [{**RODS[0], **change}, RODS[1]])
