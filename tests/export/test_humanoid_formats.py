"""Patterns of OpenHRP and motions of OpenSim: read back by numpy, and held against kinematics of their own."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from excite.errors import MotionError
from excite.export.export import export_motion
from excite.human.body import Body
from excite.human.models import osim_text
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.export.conftest import ready
from tests.export.person import drawn_body, person_robot
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


@pytest.fixture(scope="module")
def body() -> Body:
    return drawn_body()


@pytest.fixture(scope="module")
def person(body: Body, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return person_robot(body, tmp_path_factory.mktemp("person"))


def bending(robot: Robot) -> Motion:
    """The person turns, leans and bends all joints a little."""
    n = 60
    time = np.arange(n) / 100.0
    share = np.sin(np.pi * time / time[-1]) ** 2
    q = np.tile(robot.rest, (n, 1))
    q[:, 3:7] = Rotation.from_euler("ZYX", np.outer(share, [0.6, 0.2, -0.3])).as_quat()
    q[:, 7:] += np.outer(share, np.linspace(-0.3, 0.3, robot.n_joints))
    zero = np.zeros((n, robot.model.nv))
    contacts = {foot.name: np.ones(n, dtype=bool) for foot in robot.feet}
    return Motion("bend", robot.name, robot.joint_names, time, q, zero, zero, contacts)


def test_a_persons_coordinates_are_those_of_its_osim(person: Robot, body: Body, tmp_path: Path) -> None:
    motion = bending(person)
    path = export_motion(motion, person, "opensim", tmp_path / "bend", unsafe_anyway="nobody performs it")
    lines = path.read_text().splitlines()
    end = lines.index("endheader")
    assert lines[0] == "bend" and {"version=1", "nRows=60", "nColumns=41", "inDegrees=no"} <= set(lines[:end])
    names = lines[end + 1].split("\t")
    rows = dict(zip(names, np.loadtxt(lines[end + 2 :]).T, strict=True))
    model = ElementTree.fromstring(osim_text(body))
    coordinates = [item.get("name") for item in model.iter("Coordinate")]
    assert sorted(coordinates) == sorted(names[1:]) and names[0] == "time"
    # Turns and place of the pelvis about and along the axes that the model itself states.
    joint = next(item for item in model.iter("CustomJoint") if item.get("name") == "ground_pelvis")
    turn, place = Rotation.identity(60), np.zeros((60, 3))
    for axis in joint.iter("TransformAxis"):
        direction = np.array([float(value) for value in axis.findtext("axis").split()])
        value = rows[axis.findtext("coordinates")]
        if axis.get("name").startswith("rotation"):
            turn = turn * Rotation.from_rotvec(np.outer(value, direction))
        else:
            place += np.outer(value, direction)
    up = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    base = Rotation.from_matrix(up @ Rotation.from_quat(motion.q[:, 3:7]).as_matrix() @ up.T)
    assert (turn.inv() * base).magnitude().max() < 1e-9
    np.testing.assert_allclose(place, motion.q[:, :3] @ up.T, atol=1e-12)
    for i, name in enumerate(person.joint_names):
        np.testing.assert_array_equal(rows[name], motion.q[:, 7 + i])
