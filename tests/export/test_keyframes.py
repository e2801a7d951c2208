"""MuJoCo keyframes: loaded by MuJoCo beside the robot's model, and compared with pinocchio's kinematics."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError
from excite.export.export import export_motion
from excite.export.models.mjcf import exact_text
from excite.motion.files import load_motion
from excite.robot.robot import Robot
from excite.simulation.mjcf import World, build_spec
from excite.simulation.true_parameters import nominal_drives
from tests.export.conftest import ready


@pytest.mark.parametrize("name", ["ur10", "g1"])
def test_mujoco_loads_the_keys_beside_the_robots_model(name: str, tmp_path: Path) -> None:
    robot, motion = ready(name)
    path = export_motion(motion, robot, "mujoco-keyframes", tmp_path / "keys")
    text = exact_text(build_spec(robot, robot.nominal_parameters, nominal_drives(robot), World())).decode()
    scene = tmp_path / "scene.xml"
    scene.write_text(text.replace("</mujoco>", f'<include file="{path.name}"/></mujoco>'))
    model = mujoco.MjModel.from_xml_path(str(scene))
    assert model.nkey == motion.n_samples and model.key(0).name.startswith(f"{motion.name}.0")
    np.testing.assert_array_equal(model.key_time, motion.time)
    np.testing.assert_array_equal(model.key_ctrl, motion.joint_positions())
    data, check = mujoco.MjData(model), robot.model.createData()
    for k in (0, motion.n_samples // 3, motion.n_samples - 1):
        mujoco.mj_resetDataKeyframe(model, data, k)
        mujoco.mj_forward(model, data)
        pin.forwardKinematics(robot.model, check, motion.q[k], motion.v[k])
        for segment in robot.segments:
            body = model.body(segment.link).id
            np.testing.assert_allclose(data.xpos[body], check.oMi[segment.joint].translation, atol=1e-9)
            velocity = np.zeros(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
            own = pin.getVelocity(robot.model, check, segment.joint, pin.LOCAL_WORLD_ALIGNED)
            np.testing.assert_allclose(velocity[3:], own.linear, atol=1e-8)
            np.testing.assert_allclose(velocity[:3], own.angular, atol=1e-8)


OTHER = """<mujoco><worldbody>
  <body name="table"><geom size="1"/><joint name="lid" ref="0.25" range="-1 1"/></body>
  {bodies}</worldbody>
  <actuator><motor joint="lid"/>{actuators}</actuator></mujoco>"""


def other_model(robot: Robot) -> str:
    """A chain with the robot's joints in the opposite order behind another joint, driven in four ways."""
    names = list(reversed(robot.joint_names))
    bodies = "".join(f'<body name="b_{n}"><geom size="0.1"/><joint name="{n}"/>' for n in names)
    drives = [
        f'<position joint="{names[0]}" kp="30" gear="2"/>',
        f'<velocity joint="{names[1]}" kv="3"/>',
        f'<motor joint="{names[2]}"/>',
    ]
    return OTHER.format(bodies=bodies + "</body>" * len(names), actuators="".join(drives))


def test_keys_fit_a_model_of_other_order_by_the_joints_names(tmp_path: Path) -> None:
    robot, motion = ready("ur10")
    other = tmp_path / "other.xml"
    other.write_text(other_model(robot))
    path = export_motion(motion, robot, "mujoco-keyframes", tmp_path / "keys", settings={"model": str(other)})
    scene = tmp_path / "scene.xml"
    scene.write_text('<mujoco><include file="other.xml"/><include file="keys.xml"/></mujoco>')
    model = mujoco.MjModel.from_xml_path(str(scene))
    np.testing.assert_array_equal(model.key_qpos[:, 1:], motion.q[:, ::-1])
    np.testing.assert_array_equal(model.key_qvel[:, 1:], motion.v[:, ::-1])
    np.testing.assert_array_equal(model.key_qpos[:, 0], model.qpos0[0])
    expected = [0.0 * motion.q[:, 0], 2.0 * motion.q[:, -1], motion.v[:, -2], 0.0 * motion.q[:, 0]]
    np.testing.assert_array_equal(model.key_ctrl, np.column_stack(expected))
    again = load_motion(path, robot)
    np.testing.assert_array_equal(again.q, motion.q)
    np.testing.assert_array_equal(again.v, motion.v)


def test_a_model_without_the_robots_joints_is_one_line(tmp_path: Path) -> None:
    robot, motion = ready("ur10")
    (tmp_path / "in").mkdir()
    other, broken = tmp_path / "in" / "other.xml", tmp_path / "in" / "broken.xml"
    other.write_text(other_model(robot).replace("elbow_joint", "knee"))
    broken.write_text("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>")
    for model, said in (
        (other, "has no joint 'elbow_joint' of robot 'ur10'"),
        (broken, "MuJoCo refuses it"),
        (tmp_path / "none.xml", "no such file"),
    ):
        with pytest.raises(InputError, match=said) as caught:
            export_motion(
                motion, robot, "mujoco-keyframes", tmp_path / "out" / "keys", settings={"model": str(model)}
            )
        assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["in"]
