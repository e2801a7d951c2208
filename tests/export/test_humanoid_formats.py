"""Patterns of OpenHRP: read back by numpy, and held against kinematics of their own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from excite.errors import MotionError
from excite.export.export import export_motion
from excite.motion.files import load_motion
from excite.robot.loading import load_robot
from tests.export.conftest import ready
from tests.safety.motions import check_file


def test_patterns_are_times_and_numbers_of_joints_base_and_zmp(
    tmp_path: Path,
) -> None:
    g1, squat = ready("g1")
    path = export_motion(squat, g1, "openhrp", tmp_path / "down")
    names = sorted(file.name for file in path.iterdir())
    assert names == ["excite.json", *(f"squat_009.{ending}" for ending in ("hip", "pos", "waist", "zmp"))]
    pos, waist, hip, zmp = (np.loadtxt(path / f"squat_009.{e}") for e in ("pos", "waist", "hip", "zmp"))
    for rows in (pos, waist, hip, zmp):
        np.testing.assert_array_equal(rows[:, 0], squat.time - squat.time[0])
    np.testing.assert_array_equal(pos[:, 1:], squat.joint_positions())
    np.testing.assert_array_equal(waist[:, 1:4], squat.q[:, :3])
    np.testing.assert_array_equal(hip[:, 1:], waist[:, 4:])
    turned = Rotation.from_euler("xyz", hip[:, 1:])
    assert (turned.inv() * Rotation.from_quat(squat.q[:, 3:7])).magnitude().max() < 1e-9
    # In the world it is on the ground, and while the robot stands still it is below the centre of mass.
    world = turned.apply(zmp[:, 1:]) + squat.q[:, :3]
    assert np.abs(world[:, 2]).max() < 1e-9
    centre = pin.centerOfMass(g1.model, g1.model.createData(), squat.q[0])
    assert not squat.a[0].any()
    np.testing.assert_allclose(world[0, :2], centre[:2], atol=1e-6)
    assert json.loads((path / "excite.json").read_text())["verdict"]["safe"]


def test_the_joints_may_stand_in_the_players_order_and_are_read_again(tmp_path: Path) -> None:
    arm, motion = ready("ur10")
    order = ",".join(reversed(arm.joint_names))
    path = export_motion(motion, arm, "openhrp", tmp_path / "a", settings={"joints": order})
    np.testing.assert_array_equal(np.loadtxt(path / f"{motion.name}.pos")[:, 1:], motion.q[:, ::-1])
    assert sorted(file.suffix for file in path.iterdir()) == [".json", ".pos"]
    for file in (path, path / f"{motion.name}.pos"):
        assert check_file(arm, file).safe
        np.testing.assert_array_equal(load_motion(file, arm).q, motion.q)
    (path / "excite.json").unlink()
    with pytest.raises(MotionError, match="has 6 joints, not 7"):
        load_motion(path / f"{motion.name}.pos", load_robot("panda"))
