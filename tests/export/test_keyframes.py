"""MuJoCo keyframes: loaded by MuJoCo beside the robot's model, and compared with pinocchio's kinematics."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from excite.export.export import export_motion
from excite.export.models.mjcf import exact_text
from excite.motion.files import load_motion
from excite.simulation.mjcf import World, build_spec
from excite.simulation.true_parameters import nominal_drives
from tests.export.conftest import ready


@pytest.mark.parametrize("name", ["ur10", "g1"])
def test_mujoco_loads_the_keys_beside_the_robots_model(name: str, tmp_path: Path) -> None:
    robot, motion = ready(name)
    path = export_motion(motion, robot, "mujoco-keyframes", tmp_path / "keys")
    # A key of a free base lacks what a motion says of it.
    if not robot.floating:
        np.testing.assert_array_equal(load_motion(path, robot).q, motion.q)
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
