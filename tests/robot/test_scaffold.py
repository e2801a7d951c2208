"""A first description is complete: it loads as it is written, and says what it assumed."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yaml

import excite
from excite.errors import RobotError
from excite.robot.init_robot.description import scaffold_description
from excite.robot.init_robot.files import write_scaffold
from excite.robot.init_robot.source import Source
from excite.robot.legs import holding_torques, too_soft_to_stand
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.shapes.collision import (
    collision_model,
    collision_shapes,
    geometry_data,
    pair_distance,
)
from excite.robot.shapes.shape import bottom_points
from tests.robot.small import ARM
from tests.simulation.motions import replay_motion, standing

INERTIAL = (
    '<inertial><mass value="{m}"/><inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def link(name: str, mass: float, solid: str = "", at: str = "0 0 0") -> str:
    inertial = INERTIAL.format(m=mass, i=0.01 * mass)
    shape = f'<collision><origin xyz="{at}"/><geometry>{solid}</geometry></collision>' if solid else ""
    return f'<link name="{name}">{inertial}{shape}</link>'


def hinge(
    name: str, parent: str, child: str, xyz: str, axis: str, more: str = "", kind: str = "revolute"
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="{axis}"/><limit lower="-1.5" upper="1.5" velocity="5" effort="60"/>{more}</joint>'
    )


def quadruped() -> str:
    parts = [link("trunk", 6.0, '<box size="0.4 0.2 0.1"/>')]
    for x, side in (("0.18", "front"), ("-0.18", "hind")):
        for y, hand in (("0.12", "left"), ("-0.12", "right")):
            leg = f"{side}_{hand}"
            parts += [
                link(f"{leg}_hip", 0.3),
                hinge(f"{leg}_roll", "trunk", f"{leg}_hip", f"{x} {y} 0", "1 0 0"),
                link(f"{leg}_thigh", 0.5),
                hinge(f"{leg}_pitch", f"{leg}_hip", f"{leg}_thigh", "0 0 0", "0 1 0"),
                link(f"{leg}_shank", 0.2, '<sphere radius="0.02"/>', "0 0 -0.2"),
                hinge(f"{leg}_knee", f"{leg}_thigh", f"{leg}_shank", "0 0 -0.2", "0 1 0"),
            ]
    return f'<robot name="four">{"".join(parts)}</robot>'


SIDES = ("left", "right")
HIPS = (("hip_yaw", "0 0 1"), ("hip_roll", "1 0 0"), ("hip_pitch", "0 1 0"))


def biped(hips: tuple[tuple[str, str], ...] = HIPS) -> str:
    parts = [link("pelvis", 10.0, '<box size="0.2 0.2 0.2"/>')]
    for leg, y in (("left", "0.12"), ("right", "-0.12")):
        last = "pelvis"
        chain = (*hips, ("knee", "0 1 0"), ("ankle_pitch", "0 1 0"), ("ankle_roll", "1 0 0"))
        for name, axis in chain:
            place = {hips[0][0]: f"0 {y} -0.15", "knee": "0 0 -0.3", "ankle_pitch": "0 0 -0.3"}.get(
                name, "0 0 0"
            )
            foot = name == "ankle_roll"
            parts.append(
                link(f"{leg}_{name}", 1.0, '<box size="0.2 0.1 0.04"/>' if foot else "", "0.03 0 -0.05")
            )
            parts.append(hinge(f"{leg}_{name}_joint", last, f"{leg}_{name}", place, axis))
            last = f"{leg}_{name}"
    return f'<robot name="two">{"".join(parts)}</robot>'


def cart() -> str:
    wheel = '<cylinder radius="0.1" length="0.05"/>'
    parts = [link("base", 20.0, '<box size="0.5 0.4 0.2"/>', "0 0 0.2")]
    for number in range(2):
        parts += [
            link(f"wheel_{number}", 1.0, wheel, "0 0 0"),
            hinge(
                f"drive_{number}", "base", f"wheel_{number}", f"{number} 0 0.1", "0 1 0", kind="continuous"
            ),
        ]
    parts += [
        link("shoulder", 2.0),
        hinge("pan", "base", "shoulder", "0 0 0.4", "0 0 1"),
        link("elbow", 1.0, '<box size="0.05 0.05 0.3"/>', "0 0 0.15"),
        hinge("lift", "shoulder", "elbow", "0 0 0.1", "0 1 0"),
        link("finger_a", 0.05),
        hinge("grip_a", "elbow", "finger_a", "0 0.02 0.3", "1 0 0"),
        link("finger_b", 0.05),
        hinge(
            "grip_b", "elbow", "finger_b", "0 -0.02 0.3", "1 0 0", '<mimic joint="grip_a" multiplier="-1"/>'
        ),
    ]
    return f'<robot name="cart">{"".join(parts)}</robot>'


def written(text: str, folder: Path, name: str = "mine.urdf", source: Source | None = None) -> Robot:
    folder.mkdir(exist_ok=True)
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return load_robot(write_scaffold(path, folder, source=source).description)


def test_a_quadruped_stands_level_on_four_balls(tmp_path: Path) -> None:
    robot = written(quadruped(), tmp_path)
    assert robot.description.base == "floating"
    assert sorted(foot.link for foot in robot.feet) == [
        "front_left_shank", "front_right_shank", "hind_left_shank", "hind_right_shank",
    ]  # fmt: skip
    assert all(len(foot.sole) == 1 and foot.radius == 0.02 for foot in robot.feet)
    data = robot.model.createData()
    centre = pin.centerOfMass(robot.model, data, robot.rest)
    touching = np.array([data.oMi[foot.joint].act(foot.sole[0]) for foot in robot.feet])
    np.testing.assert_allclose(touching[:, 2], 0.0, atol=2e-3)
    assert np.linalg.norm(centre[:2] - touching[:, :2].mean(axis=0)) < 0.02


@pytest.mark.parametrize(("length", "wheels"), [(0.04, True), (0.2, False)])
def test_a_leg_on_a_wheel_rolls_as_on_a_ball(length: float, wheels: bool, tmp_path: Path) -> None:
    across = f'rpy="1.5708 0 0"/><geometry><cylinder radius="0.05" length="{length}"/>'
    robot = written(quadruped().replace('/><geometry><sphere radius="0.02"/>', " " + across), tmp_path)
    assert robot.floating and len(robot.feet) == 4
    for foot, stated in zip(robot.feet, robot.description.feet, strict=True):
        assert len(foot.sole) == (1 if wheels else 2)
        assert stated.radius == (0.05 if wheels else 0.0)


def test_a_belly_is_kept_off_the_ground(tmp_path: Path) -> None:
    """With its legs bent by as much as is tried first, it would hang 15 mm above the feet."""
    robot = written(quadruped().replace('"0.4 0.2 0.1"', '"0.4 0.2 0.71"'), tmp_path)
    assert robot.floating
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    trunk = [
        bottom_points(shape, data.oMi[shape.joint])
        for shape in collision_shapes(robot)
        if shape.link == "trunk"
    ]
    assert min(points[:, 2].min() for points in trunk) > robot.description.collision.margin + 0.02


def test_balls_stand_on_the_ground_in_another_posture_too(tmp_path: Path) -> None:
    """Where a ball is lowest depends on the shank's angle: ANYmal's feet were lifted by 15 mm."""
    robot = written(quadruped(), tmp_path)
    text = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    assert all(foot["radius"] == 0.02 for foot in text["feet"])
    hind = {name for name in robot.joint_names if name.startswith("hind")}
    turned = {"roll": 0.0, "pitch": 0.7, "knee": -1.4}
    text["posture"]["joints"] = {
        name: turned[name.split("_")[-1]] * (1.0 if name in hind else -1.0) for name in robot.joint_names
    }
    (tmp_path / "other.yaml").write_text(yaml.safe_dump(text))
    other = load_robot(tmp_path / "other.yaml")
    data = other.model.createData()
    pin.framesForwardKinematics(other.model, data, other.rest)
    for foot in other.feet:
        centre = data.oMf[other.model.getFrameId(foot.link)].act(np.array([0.0, 0.0, -0.2]))
        np.testing.assert_allclose(centre - [0, 0, 0.02], data.oMi[foot.joint].act(foot.sole[0]), atol=1e-9)
        assert centre[2] == pytest.approx(0.02, abs=1e-6)


def test_a_quadruped_whose_legs_cannot_steer_it_is_held(tmp_path: Path) -> None:
    stiff = re.sub(r'(<joint name="\w+_roll" type=)"revolute"', r'\1"fixed"', quadruped())
    robot = written(stiff, tmp_path)
    assert robot.description.base == "held" and robot.n_joints == 8
    assert "too few joints" in " ".join(str(one) for one in robot.description.assumed)


def test_a_leg_that_bends_about_any_level_axis_stands_bent(tmp_path: Path) -> None:
    turned = quadruped().replace('axis xyz="0 1 0"', 'axis xyz="0.6 0.8 0"')
    turned = turned.replace('axis xyz="1 0 0"', 'axis xyz="0.8 -0.6 0"')
    robot = written(turned, tmp_path)
    knees = [robot.joint_index(name) for name in robot.joint_names if name.endswith("knee")]
    assert robot.description.base == "floating"
    assert (np.abs(robot.rest[robot.n_base_q :][knees]) > 0.5).all()


def test_a_biped_stands_on_its_soles(tmp_path: Path) -> None:
    robot = written(biped(), tmp_path)
    assert [foot.link for foot in robot.feet] == ["left_ankle_roll", "right_ankle_roll"]
    for foot in robot.feet:
        np.testing.assert_allclose(np.ptp(foot.sole, axis=0), [0.2, 0.1, 0.0], atol=1e-3)


@pytest.mark.parametrize("effort", [60.0, 4.0, 2.0])
def test_a_biped_leans_no_further_over_its_toes_than_its_ankles_hold_with_ease(
    effort: float, tmp_path: Path
) -> None:
    """The middle of each sole is 0.03 m ahead of its ankle; half of what motions may use holds 108 N there."""
    ankle = r'(ankle_pitch_joint".*?effort=)"60"'
    robot = written(re.sub(ankle, rf'\1"{effort}"', biped()), tmp_path)
    assert robot.mass == pytest.approx(22.0)
    data = robot.model.createData()
    centre = pin.centerOfMass(robot.model, data, robot.rest)
    ahead = min(0.03, 0.5 * 0.85 * effort / (0.5 * 22.0 * 9.81))
    assert centre[0] - data.oMi[robot.feet[0].joint].translation[0] == pytest.approx(ahead, abs=3e-3)


def test_hulls_that_touch_on_all_bent_legs_leave_a_biped_on_bent_legs(tmp_path: Path) -> None:
    """A plate on each thigh, 30 mm below the pelvis, meets it as soon as the hip bends: Fourier's N1 stood straight."""
    text = biped()
    for side, inwards in (("left", -0.04), ("right", 0.04)):
        plate = (
            f'<collision><origin xyz="0 {inwards} 0.01"/>'
            '<geometry><box size="0.3 0.06 0.02"/></geometry></collision>'
        )
        text = re.sub(rf'(<link name="{side}_hip_pitch">.*?)(</link>)', rf"\1{plate}\2", text)
    robot = written(text, tmp_path)
    assert robot.floating
    knees = [robot.rest[robot.n_base_q + robot.joint_index(f"{side}_knee_joint")] for side in SIDES]
    assert min(np.abs(knees)) > 0.5
    (said,) = [one for one in robot.description.assumed if one.what == "links that touch at rest"]
    assert "pelvis and left_hip_pitch" in said.value or "left_hip_pitch and pelvis" in said.value


def test_a_biped_is_given_servos_that_hold_it_upright_and_told_so(tmp_path: Path) -> None:
    """Twenty times its weight at the height of its mass; what the user says instead is judged when all motions fall."""
    robot = written(biped(), tmp_path)
    gains = robot.description.controller.kp
    ankles = [robot.model.names[foot.joint] for foot in robot.feet]
    data = robot.model.createData()
    centre = pin.centerOfMass(robot.model, data, robot.rest)
    for foot, ankle in zip(robot.feet, ankles, strict=True):
        topples = 9.81 * robot.mass * np.linalg.norm(centre - data.oMi[foot.joint].translation)
        assert gains.joints[ankle] == pytest.approx(20.0 * topples, rel=0.15)
    (said,) = [one for one in robot.description.assumed if one.what == "servo gains"]
    assert "may fall where this one stands" in said.consequence
    assert too_soft_to_stand(robot) is None
    soft = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    soft["controller"]["kp"]["joints"][ankles[1]] = 40.0
    (tmp_path / "soft.yaml").write_text(yaml.safe_dump(soft))
    assert re.match(
        rf"{ankles[1]} has 40 N·m/rad .* topple", too_soft_to_stand(load_robot(tmp_path / "soft.yaml"))
    )


def test_wheels_and_fingers_are_held_and_the_ground_is_there(tmp_path: Path) -> None:
    robot = written(cart(), tmp_path)
    assert robot.description.base == "fixed"
    assert robot.joint_names == ("pan", "lift")
    assert robot.description.collision.table_height is not None
    said = " ".join(str(one) for one in robot.description.assumed)
    assert "a wheel" in said and "of a hand or gripper" in said and "ground" in said


def hand_on_an_arm() -> str:
    """An arm of four joints, its hand of three fingers on a wrist."""
    parts, last = [link("base", 10.0)], "base"
    for number, mass in enumerate((3.0, 2.0, 0.4, 0.2)):
        parts.append(link(f"part_{number}", mass))
        axis = ("0 0 1", "0 1 0", "0 1 0", "1 0 0")[number]
        parts.append(hinge(f"joint_{number}", last, f"part_{number}", "0.3 0 0", axis))
        last = f"part_{number}"
    for number in range(3):
        parts.append(link(f"digit_{number}", 0.02))
        parts.append(hinge(f"bend_{number}", last, f"digit_{number}", f"0.1 {0.03 * number} 0", "0 1 0"))
    return f'<robot name="handy">{"".join(parts)}</robot>'


def test_a_joint_that_follows_one_that_is_not_there_is_held(tmp_path: Path) -> None:
    robot = written(cart().replace('mimic joint="grip_a"', 'mimic joint="gone"'), tmp_path)
    assert robot.joint_names == ("pan", "lift")
    assert "it follows gone" in " ".join(str(one) for one in robot.description.assumed)


@pytest.mark.parametrize("palm", ["0.2", "0.7"])
def test_a_hand_begins_where_its_fingers_part(palm: str, tmp_path: Path) -> None:
    """However heavy its palm: of two hands of one kind a published pair has one palm of 0.7 kg."""
    light = '<link name="part_3"><inertial><mass value="0.2"/>'
    assert light in hand_on_an_arm()
    text = hand_on_an_arm().replace(light, light.replace("0.2", palm))
    assert written(text, tmp_path).joint_names == ("joint_0", "joint_1", "joint_2", "joint_3")


def test_an_arm_that_cannot_hold_itself_stretched_out_rests_where_it_can(tmp_path: Path) -> None:
    text = hand_on_an_arm().replace('effort="60"', 'effort="2"')
    robot = written(text, tmp_path)
    stretched = np.abs(holding_torques(robot, np.zeros((1, robot.n_joints))))
    assert (stretched > robot.limits.torque).any()
    assert (np.abs(holding_torques(robot, robot.rest[None])) < robot.limits.torque).all()


def test_a_joint_too_weak_for_any_posture_is_held(tmp_path: Path) -> None:
    spring = link("frame", 20.0) + hinge("suspension", "rail", "frame", "0 0 0.1", "0 0 1").replace(
        "revolute", "prismatic"
    ).replace('effort="60"', 'effort="5"').replace('lower="-1.5" upper="1.5"', 'lower="0" upper="0.05"')
    text = hand_on_an_arm().replace("</robot>", f"{link('rail', 1.0)}{spring}</robot>")
    text = text.replace('<parent link="base"/>', '<parent link="frame"/>')
    text = text.replace(
        "</robot>",
        '<joint name="bolts" type="fixed"><parent link="base"/><child link="rail"/></joint></robot>',
    )
    robot = written(text, tmp_path)
    assert "suspension" not in robot.joint_names and robot.n_joints == 4
    assert (
        "the torque limit that the model states cannot hold what it carries: state the drive's"
        in " ".join(str(one) for one in robot.description.assumed)
    )


@pytest.mark.parametrize("end", ["999999", "1e16"])
def test_slides_that_are_wheels_in_disguise_are_held(end: str, tmp_path: Path) -> None:
    slide = hinge("forth", "floor", "base", "0 0 0", "1 0 0", kind="prismatic").replace("1.5", end)
    robot = written(hand_on_an_arm().replace("</robot>", f"{link('floor', 0.0)}{slide}</robot>"), tmp_path)
    assert "forth" not in robot.joint_names
    assert "a slide without limits" in " ".join(str(one) for one in robot.description.assumed)


def on_wheels(solid: str = "", yaw: str = "0 0 1") -> str:
    """The arm on a base that slides along x and y, up and down and about ``yaw``, links between of a solid or none."""
    chain = [("x", "1 0 0", "prismatic"), ("y", "0 1 0", "prismatic"), ("yaw", yaw, "continuous")]
    links = ["floor", "along", "across", "carriage", "base"]
    parts = [link(name, 1.0, solid) for name in links[:-1]]
    for (name, axis, kind), parent, child in zip(
        [*chain, ("lift", "0 0 1", "prismatic")], links[:-1], links[1:], strict=True
    ):
        parts.append(
            hinge(name, parent, child, "0 0 0.1", axis, kind=kind).replace('effort="60"', 'effort="600"')
        )
    arm = hand_on_an_arm().replace(link("base", 10.0), link("base", 10.0, '<box size="0.3 0.3 0.1"/>'))
    return arm.replace("</robot>", f"{''.join(parts)}</robot>")


def test_what_wheels_do_is_held(tmp_path: Path) -> None:
    robot = written(on_wheels(), tmp_path)
    assert not {"x", "y", "yaw"} & set(robot.joint_names) and "lift" in robot.joint_names
    assert "what its wheels or legs do" in " ".join(str(one) for one in robot.description.assumed)


@pytest.mark.parametrize("made", [on_wheels('<box size="0.1 0.1 0.1"/>'), on_wheels(yaw="1 0 0")])
def test_a_gantry_moves(made: str, tmp_path: Path) -> None:
    robot = written(made, tmp_path)
    assert {"x", "y", "lift"} <= set(robot.joint_names)


def test_a_held_joint_needs_no_effort(tmp_path: Path) -> None:
    text = re.sub(r'(<joint name="bend_\d.*?) effort="60"', r"\1", hand_on_an_arm())
    assert text.count("effort") == 4 and written(text, tmp_path).n_joints == 4


def test_a_slide_in_millimetres_is_told_from_one_without_limits(tmp_path: Path) -> None:
    slide = hinge("forth", "floor", "base", "0 0 0", "1 0 0", kind="prismatic").replace("1.5", "350")
    with pytest.raises(RobotError, match="looks like millimetres"):
        written(hand_on_an_arm().replace("</robot>", f"{link('floor', 0.0)}{slide}</robot>"), tmp_path)


def test_a_continuous_joint_rests_and_moves_in_the_range_that_it_states(tmp_path: Path) -> None:
    text = ARM.replace('name="elbow" type="revolute"', 'name="elbow" type="continuous"')
    robot = written(text.replace('lower="-2.0" upper="2.0"', 'lower="-2.8" upper="-0.6"'), tmp_path)
    assert robot.limits.position_lower[1] > -2.8
    assert robot.limits.position_upper[1] < -0.6
    assert -2.8 < robot.rest[1] < -0.6
    (said,) = [one for one in robot.description.assumed if "continuous" in one.what]
    assert said.value == "elbow"


DRIVES = {
    "transmission": '<transmission name="t"><joint name="shoulder"/></transmission>',
    "ros2_control": '<ros2_control name="c" type="system"><joint name="shoulder"><command_interface name="effort"/>'
    '</joint><joint name="elbow"><state_interface name="position"/></joint></ros2_control>',
}


@pytest.mark.parametrize("drives", DRIVES)
def test_a_joint_without_effort_and_drive_is_held(drives: str, tmp_path: Path) -> None:
    """Springs of Cassie, where motors have transmissions; a drive of the same kind makes zero a value left out."""
    text = ARM.replace('effort="20"', 'effort="0"').replace("</robot>", DRIVES[drives] + "</robot>")
    robot = written(text, tmp_path)
    assert robot.joint_names == ("shoulder",)
    (said,) = [one for one in robot.description.assumed if "held still" in one.what]
    assert (said.what, said.value) == ("1 joint held still (no motor drives it)", "elbow")
    more = DRIVES["transmission"].replace("shoulder", "elbow") + "</robot>"
    assert len(written(text.replace("</robot>", more), tmp_path / "both").joint_names) == 2
    stated = text.replace('effort="0"', 'effort="20"')
    assert len(written(stated, tmp_path / "stated").joint_names) == 2


def test_a_torque_limit_of_zero_is_asked_about_where_others_state_more(tmp_path: Path) -> None:
    robot = written(ARM.replace('effort="20"', 'effort="0"'), tmp_path)
    assert len(robot.joint_names) == 2
    (said,) = [one for one in robot.description.assumed if one.what == "torque limits"]
    assert "it is 0 in the model for elbow: hold under locked_joints" in said.consequence
    nothing = written(
        ARM.replace('effort="20"', 'effort="0"').replace('effort="50"', 'effort="0"'), tmp_path / "no"
    )
    (said,) = [one for one in nothing.description.assumed if one.what == "torque limits"]
    assert "locked_joints" not in said.consequence


def test_an_arm_without_limits_or_geometry_is_complete(tmp_path: Path) -> None:
    text = (
        cart().replace('velocity="5" effort="60"', 'velocity="0" effort="0"').replace("<collision>", "<none>")
    )
    robot = written(text.replace("</collision>", "</none>"), tmp_path)
    assert (robot.limits.torque > 0.0).all() and (robot.limits.velocity > 0.0).all()
    n = sum(mass > 0.0 for mass in [float(one) for one in re.findall(r'mass value="([^"]*)"', text)])
    assert {"torque limits", "velocity limits", f"geometry of {n} links"} <= {
        one.what for one in robot.description.assumed
    }


@pytest.mark.usefixtures("reader_here")
def test_xacro_takes_its_arguments(tmp_path: Path) -> None:
    text = ARM.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1)
    start = text.index(">", text.index("<robot")) + 1
    text = f'{text[:start]}<xacro:arg name="tool" default="x"/><link name="$(arg tool)_spare"/>{text[start:]}'
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RobotError, match="root"):
        # A loose link named by the argument is refused, so its name shows that the argument arrived.
        write_scaffold(path, tmp_path / "out", source=Source(arguments={"tool": "drill"}))


@pytest.mark.usefixtures("reader_here")
@pytest.mark.parametrize("given", ["", "clones", "clones/utils-main"])
def test_a_package_is_found_by_the_name_in_its_package_xml(given: str, tmp_path: Path) -> None:
    """PAL's pal_urdf_utils is a repository of another name; a folder of that name that is another package is not it."""
    clone, other, own = (
        tmp_path / "clones" / "utils-main",
        tmp_path / "clones" / "shared_parts",
        tmp_path / "arm-main",
    )
    for folder, name in ((clone, "shared_parts"), (other, "another"), (own, "arm")):
        (folder / "urdf").mkdir(parents=True)
        (folder / "package.xml").write_text(f"<package><name> {name} </name></package>")
    # A folder above that is called as the robot's own package, and is none.
    (tmp_path / "arm").mkdir()
    head = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a">'
    (clone / "urdf" / "rest.xacro").write_text(
        f"{head}<xacro:include filename='$(find arm)/urdf/arm.xacro'/></robot>"
    )
    (own / "urdf" / "arm.xacro").write_text(ARM.replace('<?xml version="1.0"?>', "").strip())
    path = own / "urdf" / "whole.urdf.xacro"
    path.write_text(f"{head}<xacro:include filename='$(find shared_parts)/urdf/rest.xacro'/></robot>")
    if not given:
        with pytest.raises(RobotError, match="needs the package 'shared_parts'"):
            write_scaffold(path, tmp_path / "out")
        return
    source = Source(package_path=(tmp_path / given,))
    assert load_robot(write_scaffold(path, tmp_path / "out", source=source).description).n_joints == 2


@pytest.mark.usefixtures("reader_here")
def test_a_package_elsewhere_in_the_same_clone_is_found(tmp_path: Path) -> None:
    """Realman's torso takes its arm from a package beside the one that holds its own."""
    for folder, name in (("arms/reach", "reach"), ("humanoids/torso", "torso")):
        (tmp_path / "clone" / folder / "urdf").mkdir(parents=True)
        (tmp_path / "clone" / folder / "package.xml").write_text(f"<package><name>{name}</name></package>")
    (tmp_path / "clone/arms/reach/urdf/arm.xacro").write_text(
        ARM.replace('<?xml version="1.0"?>', "").strip()
    )
    head = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a">'
    path = tmp_path / "clone/humanoids/torso/urdf/whole.urdf.xacro"
    path.write_text(f"{head}<xacro:include filename='$(find reach)/urdf/arm.xacro'/></robot>")
    with pytest.raises(RobotError, match="needs the package 'reach'"):
        write_scaffold(path, tmp_path / "out")
    (tmp_path / "clone" / ".git").mkdir()
    assert load_robot(write_scaffold(path, tmp_path / "out").description).n_joints == 2


@pytest.mark.usefixtures("reader_here")
@pytest.mark.parametrize(
    ("body", "what", "remedy"),
    [
        ('<xacro:macro name="my_arm" params="p"><link name="l"/></xacro:macro>', "my_arm", "calls it"),
        ('<link name="$(arg side)_hand"/>', "side", "--xacro-arg side:=value"),
        ("", "expands to no <link>", "describes the robot"),
    ],
)
def test_a_xacro_file_that_is_no_robot_says_which_is(
    body: str, what: str, remedy: str, tmp_path: Path
) -> None:
    path = tmp_path / "part.urdf.xacro"
    path.write_text(f'<robot xmlns:xacro="http://www.ros.org/wiki/xacro">{body}</robot>')
    with pytest.raises(RobotError, match=what) as error:
        write_scaffold(path, tmp_path / "out")
    assert remedy in str(error.value.remedy)


def test_limits_of_minus_one_are_none(tmp_path: Path) -> None:
    """As Halodi's EVE states them; other negative ones are refused."""
    text = re.sub(r'effort="[^"]*"', 'effort="-1"', re.sub(r'velocity="[^"]*"', 'velocity="-1.0"', ARM))
    robot = written(text, tmp_path)
    assert (robot.limits.torque > 0.0).all() and (robot.limits.velocity > 0.0).all()
    assert {"torque limits", "velocity limits"} <= {one.what for one in robot.description.assumed}


def test_a_joint_with_no_room_for_motion_is_held(tmp_path: Path) -> None:
    """Atlas has wrists of ±0.001 rad, of which planning keeps a milliradian at either end."""
    text = re.sub(r'lower="-2.0" upper="2.0"', 'lower="-0.001" upper="0.001"', ARM)
    robot = written(text, tmp_path)
    assert robot.description.locked_joints == {"elbow": 0.0}


def test_same_seed_same_text(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM, encoding="utf-8")
    assert scaffold_description(path) == scaffold_description(path)


@pytest.mark.parametrize(
    ("text", "message"), [("<mujoco/>", "give it to excite init-robot"), ("<robot name='x'/>", "no <link>")]
)
def test_what_cannot_be_described_is_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(text)
    with pytest.raises(RobotError, match=message):
        scaffold_description(path)


def test_boxes_of_made_up_inertia_are_no_longer_than_the_links(tmp_path: Path) -> None:
    text = re.sub(r'i(xx|yy|zz)="[^"]*"', r'i\1="1"', hand_on_an_arm())
    robot = written(text, tmp_path)
    boxes = [shape for shape in robot.description.collision.shapes if shape.kind == "box"]
    assert {box.link for box in boxes} == set(re.findall(r'<link name="([^"]*)"', text))
    # Joints lie 0.3 m apart, and the centres of mass on them.
    assert max(max(box.size) for box in boxes) <= 0.3 + 1e-4


def test_small_robots_keep_small_distances(tmp_path: Path) -> None:
    """An arm of 1.2 m, and one of a tenth of its size."""
    box = '<collision><geometry><box size="0.2 0.05 0.05"/></geometry></collision></link>'
    large = re.sub(r"</link>", box, hand_on_an_arm())
    small = re.sub(r'(xyz|size)="([^"]*)"', _tenth, large)
    assert written(large, tmp_path / "l").description.collision.margin == 0.01
    assert written(small, tmp_path / "s").description.collision.margin == pytest.approx(0.004, abs=1e-3)


def _tenth(match: re.Match[str]) -> str:
    numbers = [float(x) for x in match.group(2).split()]
    scale = 1.0 if max(abs(x) for x in numbers) == 1.0 else 0.1
    return f'{match.group(1)}="{" ".join(str(scale * x) for x in numbers)}"'


def test_links_without_geometry_get_boxes_and_are_named(tmp_path: Path) -> None:
    robot = written(cart(), tmp_path)
    said = [str(one) for one in robot.description.assumed]
    assert any(
        "geometry of 1 link: boxes of their own inertia, as large as their mass: shoulder" in o for o in said
    )
    assert [shape.link for shape in robot.description.collision.shapes] == ["shoulder"]


def test_friction_that_the_model_states_is_said_not_to_count(tmp_path: Path) -> None:
    parts = [
        link("base", 5.0, '<box size="0.2 0.2 0.1"/>'),
        link("arm", 1.0, '<box size="0.04 0.04 0.3"/>', "0 0 0.15"),
        hinge("turn", "base", "arm", "0 0 0.1", "0 1 0", '<dynamics damping="6" friction="12"/>'),
        link("fore", 0.5, '<box size="0.03 0.03 0.2"/>', "0 0 0.1"),
        hinge("bend", "arm", "fore", "0 0 0.3", "0 1 0", '<dynamics damping="0.0"/>'),
    ]
    said = [
        str(one)
        for one in written(f'<robot name="rubs">{"".join(parts)}</robot>', tmp_path).description.assumed
    ]
    # 12 N·m and 6 N·m·s/rad at 5 rad/s, of 60 N·m.
    assert any(
        "friction that the model states at 1 joint" in one and "0.7 of the torque limit of turn" in one
        for one in said
    )
    assert not any(
        "friction that the model" in str(one)
        for one in written(biped(), tmp_path / "two").description.assumed
    )


def test_what_is_only_drawn_is_kept_apart_too(tmp_path: Path) -> None:
    hand = '<visual><origin xyz="0 0 0.1"/><geometry><box size="0.06 0.06 0.2"/></geometry></visual>'
    gone = '<visual><geometry><mesh filename="gone.stl"/></geometry></visual>'
    parts = [
        link("base", 5.0, '<box size="0.2 0.2 0.1"/>'),
        link("arm", 1.0, '<box size="0.04 0.04 0.3"/>', "0 0 0.15"),
        hinge("turn", "base", "arm", "0 0 0.1", "0 1 0"),
        link("fore", 0.5, '<box size="0.03 0.03 0.2"/>', "0 0 0.1"),
        hinge("bend", "arm", "fore", "0 0 0.3", "0 1 0").replace("1.5", "3.1"),
        # A hand on the forearm that has no <collision>, and one whose picture is not there.
        link("hand", 0.2).replace("</link>", f"{hand}</link>"),
        '<joint name="wrist" type="fixed"><parent link="fore"/><child link="hand"/><origin xyz="0 0 0.2"/></joint>',
        link("marker", 0.01).replace("</link>", f"{gone}</link>"),
        '<joint name="on_it" type="fixed"><parent link="hand"/><child link="marker"/></joint>',
    ]
    robot = written(f'<robot name="drawn">{"".join(parts)}</robot>', tmp_path)
    assert robot.description.collision.geometry == "either"
    assert {shape.link for shape in collision_shapes(robot)} == {"base", "arm", "fore", "hand", "table"}
    folded = np.array([0.0, 2.9])
    model = collision_model(robot)
    data = geometry_data(model)
    pin.updateGeometryPlacements(robot.model, robot.model.createData(), model, data, folded)
    names = [
        {model.geometryObjects[i].name.rsplit("_", 1)[0] for i in (p.first, p.second)}
        for p in model.collisionPairs
    ]
    assert {"base", "hand"} in names
    assert pair_distance(model, data, names.index({"base", "hand"})) < 0.0


def test_an_expression_of_xacro_that_does_not_end_is_one_line(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("excite.robot.init_robot.files._SECONDS", 1.5)
    head = '<robot name="n" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    with pytest.raises(RobotError, match=r"not expanded after 1.5 s"):
        written(f'{head}<link name="a${{9**9**9}}"/></robot>', tmp_path, "mine.urdf.xacro")


@pytest.mark.usefixtures("reader_here")
def test_whatever_xacro_raises_is_one_line(tmp_path: Path) -> None:
    head = '<robot name="n" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    wanting = {
        "default": '<xacro:arg name="which"/><link name="$(arg which)"/>',
        "needs the package 'some_description'": '<xacro:include filename="$(find some_description)/a.xacro"/>',
        "division by zero": '<link name="a${1/0}"/>',
    }
    for said, body in wanting.items():
        with pytest.raises(RobotError, match=said) as caught:
            written(f"{head}{body}</robot>", tmp_path, "mine.urdf.xacro")
        assert "<class" not in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.usefixtures("reader_here")
def test_a_xacro_that_cannot_be_expanded_says_what_arguments_it_takes(tmp_path: Path) -> None:
    head = '<robot name="n" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    arguments = (
        '<xacro:arg name="which"/><xacro:arg name="folder" default="none"/>'
        '<xacro:arg name="meshes" default="$(arg folder)/meshes"/>'
    )
    with pytest.raises(RobotError, match=r"it takes which, folder:=none\)"):
        written(
            f'{head}{arguments}<xacro:include filename="$(arg meshes)/a.xacro"/></robot>', tmp_path, "a.xacro"
        )


def test_a_file_of_another_kind_is_no_unknown_name(tmp_path: Path) -> None:
    path = tmp_path / "robot.blend"
    path.write_text("BLENDER")
    with pytest.raises(RobotError, match="is neither a robot"):
        excite.load_robot(path)


@pytest.mark.usefixtures("reader_here")
def test_slides_that_close_a_loop_need_no_limits(tmp_path: Path) -> None:
    """A plate on three passive slides, carried by rods that two motors and a third one turn."""
    arms = "".join(
        f'<body name="up{k}" pos="{x} {y} 0" euler="0 0 {turn}"><joint name="m{k}" axis="0 1 0" range="-60 80"/>'
        f'<geom type="capsule" size=".012" fromto=".03 0 0 .17 0 0" mass=".2"/><body name="lo{k}" pos=".2 0 0">'
        f'<joint name="u{k}" axis="0 1 0"/><joint name="v{k}" axis="0 0 1"/>'
        '<geom type="capsule" size=".008" fromto="-.015 0 -.03 -.14 0 -.37" mass=".1"/></body></body>'
        for k, (x, y, turn) in enumerate(((0.15, 0, 0), (-0.075, 0.1299, 120), (-0.075, -0.1299, 240)))
    )
    slides = "".join(
        f'<joint name="p{a}" type="slide" axis="{v}"/>' for a, v in zip("xyz", AXES, strict=True)
    )
    path = tmp_path / "delta.xml"
    path.write_text(
        '<mujoco model="delta"><compiler angle="degree"/><worldbody><body name="top" pos="0 0 1">'
        f'<geom type="cylinder" size=".15 .02" mass="2"/>{arms}<body name="plate" pos="0 0 -.4">{slides}'
        '<geom type="cylinder" size=".04 .01" mass=".2"/></body></body></worldbody><equality>'
        + "".join(f'<connect body1="lo{k}" body2="plate" anchor="-.15 0 -.4"/>' for k in range(3))
        + "</equality><actuator>"
        + "".join(f'<motor joint="m{k}" ctrlrange="-10 10"/>' for k in range(3))
        + "</actuator></mujoco>"
    )
    robot = load_robot(write_scaffold(path, tmp_path / "out").description)
    assert robot.n_joints == 12
    assert {n for n, p in zip(robot.joint_names, robot.passive, strict=True) if not p} == {"m0", "m1", "m2"}


AXES = ("1 0 0", "0 1 0", "0 0 1")


def test_numbers_that_stand_for_no_limit_are_none(tmp_path: Path) -> None:
    """Exporters write them: what the drives can do is assumed then, and said."""
    text = quadruped().replace('velocity="5" effort="60"', 'velocity="1e9" effort="50000"')
    limits = written(text, tmp_path).limits
    assert limits.velocity.max() <= 1.5
    assert limits.torque.max() < 60.0
    stated = written(quadruped(), tmp_path / "stated").limits
    assert (stated.velocity == 5.0).all() and (stated.torque == 60.0).all()


def test_solids_without_size_are_none(tmp_path: Path) -> None:
    points = '<visual><geometry><box size="0 0 0"/></geometry></visual>'
    points += '<collision><geometry><sphere radius="0.0"/></geometry></collision></link>'
    plain = written(biped(), tmp_path / "plain")
    robot = written(biped().replace("</link>", points, 1), tmp_path / "points")
    shapes = [[shape.name for shape in collision_shapes(one)] for one in (plain, robot)]
    assert shapes[0] == shapes[1]
    with pytest.raises(RobotError, match="size: is '0 1 1'"):
        written(biped().replace("</link>", points.replace("0 0 0", "0 1 1"), 1), tmp_path / "flat")


def test_soles_have_no_corners_on_one_another(tmp_path: Path) -> None:
    """Two boxes a hundredth of a millimetre apart in size."""
    box = '<geometry><box size="0.2 0.1 0.04"/></geometry></collision>'
    twice = box + '<collision><origin xyz="0.03 0 -0.05"/>' + box.replace("0.1 ", "0.10002 ")
    robot = written(biped().replace(box, twice), tmp_path)
    assert [len(foot.sole) for foot in robot.feet] == [4, 4]


def test_an_ankle_that_rests_as_low_as_the_soles_does_not_touch_the_ground(tmp_path: Path) -> None:
    heel = '<collision><origin xyz="-0.02 0 -0.06"/><geometry><box size="0.04 0.04 0.02"/></geometry></collision>'
    text = re.sub(r'(<link name="\w+_ankle_pitch">.*?)(</link>)', rf"\1{heel}\2", biped())
    robot = written(text, tmp_path)
    assert any(shape.link == "left_ankle_pitch" for shape in collision_shapes(robot))
    outcome = replay_motion(robot, standing(robot, 1.0))
    assert outcome.on_its_feet, outcome


def test_a_base_called_world_stands_in_simulation(tmp_path: Path) -> None:
    """MuJoCo keeps the name for what does not move."""
    robot = written(biped().replace('"pelvis"', '"world"'), tmp_path)
    run = replay_motion(robot, standing(robot, 0.2))
    assert run.on_its_feet and run.max_tilt_rad < 0.05


@pytest.mark.parametrize("bare", [True, False])
def test_a_floating_joint_at_the_root_says_that_the_base_is_free(bare: bool, tmp_path: Path) -> None:
    world = '<link name="world"/>' if bare else link("world", 3.0)
    above = '<joint name="reference" type="floating"><parent link="world"/><child link="trunk"/></joint>'
    text = quadruped().replace("</robot>", f"{world}{above}</robot>")
    if bare:
        robot = written(text, tmp_path)
        assert robot.floating and robot.n_joints == 12 and robot.base_link == "trunk"
        return
    with pytest.raises(RobotError, match="only joints with one coordinate"):
        written(text, tmp_path)


def test_a_planar_joint_at_the_root_stands_for_wheels_that_stand_still(tmp_path: Path) -> None:
    """As MoveIt wants it of bases on wheels; inside a robot it is refused as before."""
    above = '<link name="floor"/><joint name="drive" type="planar"><parent link="floor"/><child link="{}"/></joint>'
    root = ElementTree.fromstring(ARM)
    first = next(link for link in root.iter("link")).get("name")
    robot = written(ARM.replace("</robot>", above.format(first) + "</robot>"), tmp_path)
    assert robot.joint_names == written(ARM, tmp_path / "bare").joint_names and not robot.floating
    assert any(
        "1 joint held still (what its wheels or legs do): drive" in str(one)
        for one in robot.description.assumed
    )


@pytest.mark.parametrize(("joint", "held"), [("wrist_rotate", []), ("gripper", ["gripper"])])
def test_a_wrist_that_turns_the_gripper_is_free(joint: str, held: list[str], tmp_path: Path) -> None:
    """The last joint of a ViperX turns a link that is called the gripper's."""
    text = ARM.replace('"lower"', '"gripper_link"').replace('joint name="elbow"', f'joint name="{joint}"')
    (tmp_path / "arm.urdf").write_text(text)
    robot = load_robot(write_scaffold(tmp_path / "arm.urdf", tmp_path / "described").description)
    assert list(robot.description.locked_joints) == held


@pytest.mark.usefixtures("reader_here")
def test_a_key_frame_that_nobody_can_stand_in_is_not_where_legs_are_sought(tmp_path: Path) -> None:
    """That of a published Mini Cheetah folds its front legs up: it was held in a stand, for two feet span no area."""
    spec = mujoco.MjSpec.from_string(quadruped())
    spec.body("trunk").add_freejoint()
    joints = [joint.name for body in spec.bodies for joint in body.joints if joint.name]
    folded = {
        "front_left_pitch": -1.4,
        "front_right_pitch": -1.4,
        "hind_left_pitch": 0.9,
        "hind_right_pitch": 0.9,
    }
    qpos = [0.0, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0, *(folded.get(name, 0.0) for name in joints)]
    spec.add_key(name="home", qpos=qpos)
    spec.compile()
    robot = written(spec.to_xml(), tmp_path, "mine.xml")
    assert robot.description.base == "floating"
    assert len(robot.feet) == 4


def test_geometry_that_is_not_there_is_named_and_the_boxes_in_its_place_are_called_boxes(
    tmp_path: Path,
) -> None:
    gone = '<visual><geometry><mesh filename="gone.stl"/></geometry></visual></link>'
    text = cart().replace("<collision>", "<none>").replace("</collision>", "</none>").replace("</link>", gone)
    robot = written(text, tmp_path)
    (geometry,) = [one for one in robot.description.assumed if one.what.startswith("geometry of ")]
    assert "gone.stl: no such file" in geometry.consequence
    assert robot.description.collision.source.startswith("boxes of the links' inertia")


def test_moments_in_another_unit_are_named_by_the_size_of_the_link(tmp_path: Path) -> None:
    """As a hand in kg·cm²: accelerations that its arm was allowed were ten thousand times too small."""
    wide = re.sub(
        r'\bi(..)="([\d.e-]+)"', lambda found: f'i{found[1]}="{1e4 * float(found[2])}"', quadruped()
    )
    for text, names in ((quadruped(), set[str]()), (wide, {"front_left_shank"})):
        (tmp_path / "mine.urdf").write_text(text)
        chart = excite.examine_description(tmp_path / "mine.urdf")
        found = [one for one in chart.findings if one.kind == "inertia_scale" and "for kg·m²" in one.remedy]
        assert names <= {place for one in found for place in one.places} and bool(found) == bool(names)
