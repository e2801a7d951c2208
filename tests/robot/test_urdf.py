"""Strict reading: one clear error for each fault, and rewriting that keeps the physics."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from excite.conversion.recording import load_machine
from excite.errors import RobotError
from excite.robot.catalogue import example_robot_data
from excite.robot.urdf.reading import Stated, find_mesh, parse_urdf, read_urdf
from tests.robot.small import ARM, ELBOW_AXIS, ELBOW_LIMIT, chain, spoiled

MASS = '<mass value="1.0"/>'
INERTIA = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.002"/>'
CHILD = '<child link="lower"/>'
BOMB = '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>'
MIMIC = '<mimic joint="shoulder" multiplier="2" offset="0.1"/>'
FAULTS = {
    "MuJoCo model": ("<mujoco model='m'/>", "MuJoCo", "URDF"),
    "SDF model": ("<sdf/>", "SDF", "URDF"),
    "joint called universe": (
        ARM.replace('"elbow"', '"universe"'),
        "joint 'universe': is called as readers call what the robot stands on",
        "rename the joint",
    ),
    "torque of next to nothing": (
        spoiled('effort="20"', 'effort="9e-301"'),
        "joint 'elbow'/limit@effort: is 9e-301, less than any drive gives",
        "check its exponent",
    ),
    "velocity of next to nothing": (
        spoiled('velocity="3.0"', 'velocity="9e-301"'),
        "joint 'elbow'/limit@velocity: is 9e-301",
        "leave it out where none is known",
    ),
    "part of a MuJoCo model": ("<worldbody/>", "a part of a MuJoCo model", "give the file that includes it"),
    "no links": ("<robot name='r'/>", "no <link>", "describe"),
    "no inertial": (
        spoiled(
            ARM[ARM.index('    <inertial>\n      <origin xyz="0 0 0.15"') : ARM.index(INERTIA)], "<inertial>"
        ),
        "link 'lower'/inertial: has no <mass>",
        "kilograms",
    ),
    "no inertial at all": (
        spoiled(
            '<link name="tool"/>',
            '<link name="tool"/><link name="bare"/><joint name="wrist" type="revolute"><parent link="tool"/>'
            '<child link="bare"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>',
        ),
        "link 'bare'/inertial: moves and has no mass",
        "give the link",
    ),
    "zero mass": (spoiled(MASS, '<mass value="0"/>'), "link 'lower'/inertial/mass@value", "positive"),
    "no inertia": (spoiled(INERTIA, ""), "link 'lower'/inertial: has no <inertia>", "moments"),
    "moment missing": (
        spoiled(INERTIA, INERTIA.replace('ixy="0" ', "")),
        "link 'lower'/inertial/inertia@ixy: is missing",
        "one number",
    ),
    "negative moment": (
        spoiled(INERTIA, INERTIA.replace("0.002", "-0.002")),
        "link 'lower'/inertial/inertia: is not positive definite",
        "correct the moments",
    ),
    "triangle inequality": (
        spoiled(INERTIA, INERTIA.replace("0.002", "0.03")),
        "link 'lower'/inertial/inertia: breaks the triangle inequality",
        "model.acknowledged.lower",
    ),
    "flat inertia": (
        spoiled(INERTIA, INERTIA.replace("0.002", "0.0")),
        "link 'lower'/inertial: is not positive definite",
        "give the link",
    ),
    "short axis": (spoiled(ELBOW_AXIS, '<axis xyz="0 1"/>'), "joint 'elbow'/axis@xyz", "3 numbers"),
    "unknown parent": (
        spoiled('<parent link="upper"/>', '<parent link="uper"/>'),
        "unknown link 'uper'",
        "define",
    ),
    "no child": (spoiled(CHILD, ""), "joint 'elbow'/child: unknown link ''", "name the child link"),
    "joint twice": (spoiled('joint name="elbow"', 'joint name="shoulder"'), "joint 'shoulder'", "rename"),
    "closed loop": (
        spoiled(
            '<link name="tool"/>',
            '<link name="tool"/><joint name="bar" type="fixed">'
            '<parent link="world"/><child link="tool"/></joint>',
        ),
        "link 'tool': is the child of two joints, 'bar' and 'mount': a closed loop",
        "cut the loop",
    ),
    "cycle": (spoiled('<parent link="world"/>', '<parent link="tool"/>'), "closed loop of", "cut the loop"),
    "planar joint": (
        spoiled('<joint name="elbow" type="revolute">', '<joint name="elbow" type="planar">'),
        "joint 'elbow': is planar",
        "fix it",
    ),
    "continuous joint": (
        spoiled('<joint name="elbow" type="revolute">', '<joint name="elbow" type="continuous">').replace(
            'lower="-2.0" upper="2.0" ', ""
        ),
        "joint 'elbow'/limit: turns without end",
        "limits.position.joints.elbow",
    ),
    "no limits": (
        spoiled(ELBOW_LIMIT, ""),
        "joint 'elbow'/limit: has no position",
        "limits.position.joints.elbow",
    ),
    "negative effort": (
        spoiled(ELBOW_LIMIT, ELBOW_LIMIT.replace("20", "-20")),
        "joint 'elbow'/limit@effort",
        "positive",
    ),
    "mimic joint": (
        spoiled(ELBOW_LIMIT, ELBOW_LIMIT + MIMIC.replace('"2"', '"2,0"')),
        "joint 'elbow'/mimic@multiplier",
        "number",
    ),
    "flat box": (
        spoiled('size="0.06 0.06 0.25"', 'size="0.06 0.06 0"'),
        "link 'lower'/collision 0/box@size",
        "above 0",
    ),
    "too many links": (chain(2500), "2500 links", "reduce"),
}


def urdf_text(path: Path, stated: Stated | None = None) -> str:
    return read_urdf(path, stated).text


def write(folder: Path, text: str) -> Path:
    path = folder / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_one_error_with_file_element_and_remedy(fault: str, tmp_path: Path) -> None:
    text, element, remedy = FAULTS[fault]
    path = write(tmp_path, text)
    with pytest.raises(RobotError) as caught:
        urdf_text(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert element in message
    assert remedy in message.split(element, 1)[1]
    assert "\n" not in message
    assert caught.value.exit_code == 4


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"none\.urdf: no such file; check the path"):
        urdf_text(tmp_path / "none.urdf")


def test_sound_arm_reads(tmp_path: Path) -> None:
    model = pin.buildModelFromXML(urdf_text(write(tmp_path, ARM)))
    assert model.nq == 2
    assert pin.computeTotalMass(model) == pytest.approx(3.0)


def test_floating_base_needs_mass_on_the_root(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="link 'world'/inertial: moves and has no mass"):
        urdf_text(write(tmp_path, ARM), Stated(floating=True))


def test_acknowledged_fault_passes_and_idle_acknowledgement_does_not(tmp_path: Path) -> None:
    path = write(tmp_path, FAULTS["triangle inequality"][0])
    assert "lower" in urdf_text(path, Stated(acknowledged={"lower": "measured on a swing"}))
    with pytest.raises(RobotError, match=r"link 'upper': needs no acknowledgement"):
        urdf_text(path, Stated(acknowledged={"lower": "measured", "upper": "for luck"}))


def test_moments_of_a_link_that_weighs_next_to_nothing_may_be_acknowledged(tmp_path: Path) -> None:
    """As an iiwa's flange has them, 1e-6 kg and 1 kg·m²; on links that weigh something their unit is wrong."""
    moments = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    flange = f'<link name="tool"><inertial><mass value="1e-6"/>{moments}</inertial></link>'
    path = write(tmp_path, spoiled('<link name="tool"/>', flange))
    with pytest.raises(RobotError, match=r"spreads 1e-06 kg over a radius of 1e\+03 m.*acknowledged\.tool"):
        urdf_text(path)
    assert "tool" in urdf_text(path, Stated(acknowledged={"tool": "stands for a frame"}))


def test_small_rounding_of_the_triangle_inequality_is_accepted(tmp_path: Path) -> None:
    sum_of_others = INERTIA.replace('izz="0.002"', 'izz="0.020000001"')
    assert urdf_text(write(tmp_path, spoiled(INERTIA, sum_of_others)))


def test_a_frame_with_a_mass_of_next_to_nothing_may_have_any_radius(tmp_path: Path) -> None:
    """As tools and sensors are exported: 1e-15 kg and 1e-11 kg·m²."""
    moments = 'ixx="{0}" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"'
    dummy = f'<inertial><mass value="1e-15"/><inertia {moments}/></inertial>'
    model = spoiled('<link name="tool"/>', f'<link name="tool">{dummy.format("1e-11")}</link>')
    assert pin.computeTotalMass(pin.buildModelFromXML(urdf_text(write(tmp_path, model)))) == pytest.approx(
        3.0
    )
    with pytest.raises(RobotError, match="over a radius of"):
        urdf_text(write(tmp_path, model.replace("1e-11", "1e-5")))


def test_continuous_joint_gets_one_coordinate(tmp_path: Path) -> None:
    path = write(tmp_path, FAULTS["continuous joint"][0])
    model = pin.buildModelFromXML(urdf_text(path, Stated(limits={"elbow": (-6.0, 6.0)})))
    assert model.nq == 2
    assert model.upperPositionLimit[1] == 6.0


@pytest.mark.parametrize(
    ("lower", "upper", "kept"),
    [
        ("-2.8623", "-0.6458", True),
        ("0", "0", False),
        ("-3.14", "3.14", False),
        ("-3.1416", "3.1416", False),
        ("-100", "100", False),
    ],
)
def test_a_continuous_joint_keeps_a_range_that_is_one(
    lower: str, upper: str, kept: bool, tmp_path: Path
) -> None:
    """Cassie's knees are continuous, and state where they end; a turn, or nothing, is what others write."""
    text = spoiled('<joint name="elbow" type="revolute">', '<joint name="elbow" type="continuous">')
    path = write(tmp_path, text.replace('lower="-2.0" upper="2.0"', f'lower="{lower}" upper="{upper}"'))
    if not kept:
        with pytest.raises(RobotError, match="turns without end"):
            urdf_text(path)
        return
    model = pin.buildModelFromXML(urdf_text(path))
    assert (model.lowerPositionLimit[1], model.upperPositionLimit[1]) == (float(lower), float(upper))
    stated = pin.buildModelFromXML(urdf_text(path, Stated(limits={"elbow": (-6.0, 6.0)})))
    assert stated.upperPositionLimit[1] == 6.0
    assert load_machine(path).upper[1] == float(upper)


def test_a_continuous_joint_whose_limit_is_no_number_is_named(tmp_path: Path) -> None:
    text = spoiled('<joint name="elbow" type="revolute">', '<joint name="elbow" type="continuous">')
    with pytest.raises(RobotError, match=r"joint 'elbow'/limit@upper: is '2,0'"):
        parse_urdf(write(tmp_path, text.replace('upper="2.0"', 'upper="2,0"')))


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_locked_joint_keeps_the_pose(kind: str, tmp_path: Path) -> None:
    text = spoiled('<joint name="elbow" type="revolute">', f'<joint name="elbow" type="{kind}">').replace(
        'xyz="0 0 0.4" rpy="0 0 0"', 'xyz="0.1 0 0.4" rpy="0.3 -0.2 0.7"'
    )
    path = write(tmp_path, text)
    full = pin.buildModelFromXML(urdf_text(path))
    held = pin.buildModelFromXML(urdf_text(path, Stated(locked={"elbow": 0.6})))
    reduced = pin.buildReducedModel(full, [full.getJointId("elbow")], np.array([0.0, 0.6]))
    assert list(held.names) == ["universe", "shoulder"]
    np.testing.assert_allclose(
        held.inertias[1].toDynamicParameters(), reduced.inertias[1].toDynamicParameters(), atol=1e-12
    )
    for model in (held, reduced):
        assert model.existFrame("tool")
    np.testing.assert_allclose(
        held.frames[held.getFrameId("tool")].placement.homogeneous,
        reduced.frames[reduced.getFrameId("tool")].placement.homogeneous,
        atol=1e-12,
    )


def test_mimic_joint_follows_a_locked_one(tmp_path: Path) -> None:
    solid_tool = f'<link name="tool"><inertial>{MASS}{INERTIA}</inertial></link>'
    limit = '<limit lower="0" upper="1" effort="1" velocity="1"/>'
    text = (
        spoiled(ELBOW_LIMIT, ELBOW_LIMIT + MIMIC)
        .replace('joint name="mount" type="fixed"', 'joint name="mount" type="prismatic"')
        .replace('<child link="tool"/>', f'<child link="tool"/>{limit}')
        .replace('<link name="tool"/>', solid_tool)
    )
    model = pin.buildModelFromXML(urdf_text(write(tmp_path, text), Stated(locked={"shoulder": 0.2})))
    assert list(model.names) == ["universe", "mount"]
    bent = pin.rpy.rpyToMatrix(0.0, 0.2 + (2 * 0.2 + 0.1), 0.0)
    np.testing.assert_allclose(model.jointPlacements[1].rotation, bent, atol=1e-12)


def test_unknown_locked_joint(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"locked_joints: no joint 'knee'.*shoulder, elbow"):
        urdf_text(write(tmp_path, ARM), Stated(locked={"knee": 0.0}))


def test_package_paths_become_absolute() -> None:
    urdf = example_robot_data() / "ur_description/urdf/ur5_robot.urdf"
    text = urdf_text(urdf)
    assert "package://" not in text
    found = find_mesh(
        "package://example-robot-data/robots/ur_description/meshes/ur5/collision/base.stl", urdf
    )
    assert found is not None and found.is_file()
    assert find_mesh("package://example-robot-data/none.stl", urdf) is None


def test_package_path_through_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = tmp_path / "ws" / "my_robot" / "meshes" / "a.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_bytes(b"")
    urdf = write(tmp_path, ARM)
    for root in (tmp_path / "ws", tmp_path / "ws" / "my_robot"):
        monkeypatch.setenv("ROS_PACKAGE_PATH", str(root))
        assert find_mesh("package://my_robot/meshes/a.stl", urdf) == mesh
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    assert find_mesh("package://my_robot/meshes/a.stl", urdf) is None


def test_packages_that_are_installed_are_found_from_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = tmp_path / "prefix" / "share" / "my_robot" / "a.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_bytes(b"")
    urdf = write(tmp_path, ARM)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere{os.pathsep}{tmp_path / 'prefix'}")
    assert find_mesh("package://my_robot/a.stl", urdf) == mesh
    wheel = "package://example-robot-data/robots/ur_description/meshes/ur5/collision/base.stl"
    assert find_mesh(wheel, urdf) == example_robot_data() / "ur_description/meshes/ur5/collision/base.stl"


def test_a_package_copied_under_another_name_is_found(tmp_path: Path) -> None:
    mesh = tmp_path / "my_robot_copy" / "meshes" / "visual" / "a.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_bytes(b"")
    (tmp_path / "my_robot_copy" / "urdf").mkdir()
    urdf = write(tmp_path / "my_robot_copy" / "urdf", ARM)
    assert find_mesh("package://my_robot/meshes/visual/a.stl", urdf) == mesh
    assert find_mesh("package://my_robot/a.stl", urdf) is None


def outcome(path: Path) -> None:
    """Read a URDF; what passes must also pass pinocchio."""
    try:
        text = urdf_text(path)
    except RobotError:
        return
    model = pin.buildModelFromXML(text)
    assert np.isfinite(pin.computeTotalMass(model))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_mutations_never_crash(tmp_path: Path, data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(ARM)))
    end = data.draw(st.integers(start, min(len(ARM), start + 60)))
    filling = data.draw(
        st.sampled_from(
            ["", "nan", "1e400", "<", "/>", '"', "\0", "link", "-", "1,5", "<joint/>", "ü", "&a;"]
        )
        | st.text(max_size=12)
    )
    path = tmp_path / "robot.urdf"
    path.write_bytes((ARM[:start] + filling + ARM[end:]).encode("utf-8", "surrogatepass"))
    outcome(path)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=200))
def test_bytes_never_crash(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "robot.urdf"
    path.write_bytes(content)
    outcome(path)


def test_what_stands_twice_and_says_the_same_counts_once(tmp_path: Path) -> None:
    """Published quadrupeds have an axis before and after the origin; some editors end a file with a zero byte."""
    twins = spoiled(ELBOW_AXIS, ELBOW_AXIS + "\n    " + ELBOW_AXIS).replace(MASS, MASS + MASS)
    (tmp_path / "twins.urdf").write_text(twins + "\0")
    (tmp_path / "once.urdf").write_text(ARM)
    found, expected = (
        pin.buildModelFromXML(urdf_text(tmp_path / name)) for name in ("twins.urdf", "once.urdf")
    )
    q = np.array([0.4, -0.7])
    torques = [pin.computeGeneralizedGravity(one, one.createData(), q) for one in (found, expected)]
    np.testing.assert_array_equal(torques[0], torques[1])


def test_prefixes_that_nothing_declares(tmp_path):
    """Drake's models state accelerations and groups of collisions so; readers of ROS pass over them."""
    text = ARM.replace("<limit ", '<limit drake:acceleration="2.5" ').replace(
        "</robot>",
        '<drake:collision_filter_group name="all"><drake:member link="x"/></drake:collision_filter_group></robot>',
    )
    (tmp_path / "drake.urdf").write_text(text.replace("<robot ", "<!-- <robot> made by hand -->\n<robot ", 1))
    (tmp_path / "plain.urdf").write_text(ARM)
    found, expected = (
        pin.buildModelFromXML(urdf_text(tmp_path / name)) for name in ("drake.urdf", "plain.urdf")
    )
    assert list(found.names) == list(expected.names)
    np.testing.assert_array_equal(found.effortLimit, expected.effortLimit)
    (tmp_path / "broken.urdf").write_text(text.replace("</robot>", ""))
    with pytest.raises(RobotError, match="not valid XML"):
        urdf_text(tmp_path / "broken.urdf")
