"""SDF models are read: frames, axes, limits and shapes as the specification has them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import excite
from excite.errors import RobotError

LINK = (
    "<inertial><pose>0 0 -0.2 0 0 0</pose><mass>2</mass>"
    "<inertia><ixx>0.02</ixx><iyy>0.03</iyy><izz>0.01</izz></inertia></inertial>"
)
LIMIT = "<limit><lower>-2</lower><upper>1.5</upper><effort>40</effort><velocity>3</velocity></limit>"


def model(links: str, joints: str, version: str = "1.9") -> str:
    return f'<sdf version="{version}"><model name="arm">{links}{joints}</model></sdf>'


def arm(folder: Path, text: str) -> pin.Model:
    file = folder / "arm.sdf"
    file.write_text(text)
    return excite.load_robot(file).model


# Two links that hang from a base; poses are in the model unless they say otherwise.
BASE = f'<link name="base">{LINK}</link>'
FAR = (
    f'<link name="upper"><pose>0.1 0 1 0.3 0 0</pose>{LINK}</link>'
    f'<link name="lower"><pose>0.1 0.2 0.5 0 0.4 0</pose>{LINK}</link>'
)


def joint(
    name: str, parent: str, child: str, pose: str, xyz: str, expressed: str = "", kind: str = "revolute"
) -> str:
    seen = f' expressed_in="{expressed}"' if expressed else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent>{parent}</parent><child>{child}</child>{pose}'
        f"<axis><xyz{seen}>{xyz}</xyz>{LIMIT}</axis></joint>"
    )


JOINTS = (
    '<joint name="hold" type="fixed"><parent>world</parent><child>base</child></joint>'
    + joint("shoulder", "base", "upper", "", "0 1 0")
    + joint("elbow", "upper", "lower", "<pose>0 0 0.1 0 0 0</pose>", "1 0 0")
)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> pin.Model:
    return arm(tmp_path_factory.mktemp("plain"), model(BASE + FAR, JOINTS))


def torques(built: pin.Model) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.array([pin.rnea(built, built.createData(), *rng.normal(size=(3, built.nv))) for _ in range(5)])


def test_torques_are_those_of_the_same_arm_in_mujoco(plain: pin.Model) -> None:
    """Bodies and hinges are put where the specification says, by hand."""
    body = 'mass="2" diaginertia="0.02 0.03 0.01"'
    text = f"""<mujoco><compiler angle="radian" eulerseq="XYZ" autolimits="true"/>
    <worldbody><body name="upper" pos="0.1 0 1" euler="0.3 0 0"><inertial pos="0 0 -0.2" {body}/><joint axis="0 1 0"/>
    <body name="lower" LOWER><inertial pos="0 0 -0.2" {body}/><joint pos="0 0 0.1" axis="1 0 0"/>
    </body></body></worldbody></mujoco>"""
    upper = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.0, 0.0), np.array([0.1, 0.0, 1.0]))
    lower = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.4, 0.0), np.array([0.1, 0.2, 0.5]))
    inner = upper.actInv(lower)
    quaternion = pin.Quaternion(inner.rotation)
    turned = f"{quaternion.w} {quaternion.x} {quaternion.y} {quaternion.z}"
    place = " ".join(map(repr, map(float, inner.translation)))
    text = text.replace("LOWER", f'pos="{place}" quat="{turned}"')
    peer = mujoco.MjModel.from_xml_string(text)
    data, rng = mujoco.MjData(peer), np.random.default_rng(3)
    for mine in torques(plain):
        data.qpos, data.qvel, data.qacc = rng.normal(size=(3, 2))
        mujoco.mj_inverse(peer, data)
        assert np.allclose(mine, data.qfrc_inverse, rtol=0, atol=1e-9)


def test_frames_degrees_quaternions_and_expressed_axes_say_the_same(plain: pin.Model, tmp_path: Path) -> None:
    upper = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.0, 0.0), np.array([0.1, 0.0, 1.0]))
    lower = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.4, 0.0), np.array([0.1, 0.2, 0.5]))
    inner = upper.actInv(lower)
    turn = np.degrees(pin.rpy.matrixToRpy(inner.rotation))
    in_upper = " ".join(map(repr, map(float, (*inner.translation, *turn))))
    quaternion = pin.Quaternion(lower.rotation)
    links = (
        BASE
        + f'<link name="upper"><pose relative_to="high" degrees="true">0 0 0 {np.degrees(0.3)} 0 0</pose>{LINK}</link>'
        + f'<link name="lower"><pose relative_to="upper" degrees="true">{in_upper}</pose>{LINK}</link>'
        + '<frame name="high"><pose>0.1 0 1 0 0 0</pose></frame><frame name="tip" attached_to="lower"/>'
    )
    axis = upper.rotation @ np.array([0.0, 1.0, 0.0])
    joints = JOINTS.replace(
        "<xyz>0 1 0</xyz>", f'<xyz expressed_in="__model__">{axis[0]} {axis[1]} {axis[2]}</xyz>'
    )
    joints = joints.replace("<child>lower</child>", "<child>tip</child>")
    joints = joints.replace("<pose>0 0 0.1 0 0 0</pose>", '<pose relative_to="lower">0 0 0.1 0 0 0</pose>')
    assert np.allclose(torques(arm(tmp_path, model(links, joints))), torques(plain), rtol=0, atol=1e-9)
    words = " ".join(map(repr, map(float, quaternion.coeffs())))
    text = f'<pose rotation_format="quat_xyzw">0.1 0.2 0.5 {words}</pose>'
    links = (BASE + FAR).replace("<pose>0.1 0.2 0.5 0 0.4 0</pose>", text)
    assert np.allclose(torques(arm(tmp_path, model(links, JOINTS))), torques(plain), rtol=0, atol=1e-9)


def test_limits_and_couplings_are_taken(plain: pin.Model, tmp_path: Path) -> None:
    assert list(plain.lowerPositionLimit) == [-2.0, -2.0] and list(plain.upperPositionLimit) == [1.5, 1.5]
    assert list(plain.effortLimit) == [40.0, 40.0] and list(plain.velocityLimit) == [3.0, 3.0]
    tied = JOINTS.replace(
        "<xyz>1 0 0</xyz>",
        '<xyz>1 0 0</xyz><mimic joint="shoulder"><multiplier>2</multiplier><offset>0.1</offset></mimic>',
    )
    file = tmp_path / "arm.sdf"
    file.write_text(model(BASE + FAR, tied))
    robot = excite.load_robot(file)
    assert robot.mechanism is not None and robot.joint_names == ("shoulder", "elbow")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<sdf version="1.9"/>', "holds 0 models"),
        ('<sdf version="1.9"><model name="a"/><model name="b"/></sdf>', "holds 2 models, a, b"),
        (model(BASE + "<include><uri>model://hand</uri></include>", JOINTS), "holds another model"),
        (model(BASE + FAR, JOINTS.replace('type="revolute"', 'type="ball"')), "is of type 'ball'"),
        (
            model(BASE + FAR.replace("<pose>0.1 0 1", '<pose relative_to="nowhere">0.1 0 1'), JOINTS),
            "is not in the model",
        ),
        (
            model(BASE + FAR.replace("<pose>0.1 0 1", '<pose relative_to="upper">0.1 0 1'), JOINTS),
            "relative to itself",
        ),
        (model(BASE + FAR.replace("<mass>2</mass>", "<mass>2,5</mass>"), JOINTS), "2,5"),
        (model(BASE + FAR, JOINTS.replace("<child>lower</child>", "<child>hand</child>")), "hand"),
    ],
)
def test_what_cannot_be_a_robot_is_refused_in_one_line(text: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "arm.sdf"
    file.write_text(text)
    with pytest.raises(RobotError, match=said) as caught:
        excite.load_robot(file)
    assert "\n" not in str(caught.value) and str(file) in str(caught.value)
