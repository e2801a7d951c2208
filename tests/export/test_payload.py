"""A load as controllers take it: frames, units and axes beside numbers worked out by hand; limits; what is not told."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError, UnknownNameError
from excite.export.payload import PAYLOAD_FORMATS, payload_for, read_payload
from excite.identification.load import WeighedLoad
from excite.robot.loading import load_robot

MASS, CENTRE = 1.6, np.array([0.03, 0.1, -0.02])
# About the centre of mass: a brick turned by 0.4 rad, so that no axis is a principal one.
TURN = pin.rpy.rpyToMatrix(0.4, -0.3, 0.2)
INERTIA = TURN @ np.diag([0.02, 0.03, 0.04]) @ TURN.T
NUMBER = r"-?\d+\.\d+"


@pytest.fixture(scope="module")
def robot():
    return load_robot("ur10")


@pytest.fixture(scope="module")
def load():
    """About the last joint's frame, all of it known to a thousandth."""
    told = np.ones(10, dtype=bool)
    numbers = pin.Inertia(MASS, CENTRE, INERTIA).toDynamicParameters()
    return WeighedLoad(numbers, np.full(10, 1e-3), told, told, {}, "stated", {})


def numbers_in(payload):
    return [float(number) for number in re.findall(NUMBER, payload.text)]


def expected(robot, flange):
    """Centre and inertia along a frame's axes, by its transform from the last joint's frame."""
    frame = robot.model.frames[robot.model.getFrameId(flange)].placement
    turn = frame.rotation.T
    return turn @ (CENTRE - frame.translation), turn @ INERTIA @ turn.T


def test_ur_has_metres_and_the_matrix_in_the_order_of_its_manual(robot, load):
    m, x, y, z, *rest = numbers_in(payload_for(load, robot, "ur"))
    centre, inertia = expected(robot, "tool0")
    np.testing.assert_allclose([m, x, y, z], [MASS, *centre], atol=1e-6)
    np.testing.assert_allclose(rest, inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], atol=1e-6)


def test_a_summary_says_where_the_centre_is_axis_by_axis(robot, load):
    x, y, z = 1e3 * expected(robot, "tool0")[0]
    assert (
        f"1.600 kg, centre of mass ({x:.1f}, {y:.1f}, {z:.1f}) mm" in payload_for(load, robot, "ur").summary()
    )


def test_franka_has_the_arguments_of_set_load_in_its_flange(load):
    panda = load_robot("panda")
    found = json.loads(payload_for(load, panda, "franka").text)
    centre, inertia = expected(panda, "panda_link8")
    np.testing.assert_allclose(found["center_of_mass"], centre, atol=1e-6)
    np.testing.assert_allclose(np.reshape(found["load_inertia"], (3, 3)), inertia, atol=1e-6)


def test_kuka_has_millimetres_principal_moments_and_angles_about_z_y_x(robot, load):
    m, x, y, z, a, b, c, *moments = numbers_in(payload_for(load, robot, "kuka"))
    centre, inertia = expected(robot, "tool0")
    np.testing.assert_allclose([m, x, y, z], [MASS, *1e3 * centre], atol=1e-3)
    about = {
        axis: pin.utils.rotate(axis, np.radians(angle)) for axis, angle in zip("zyx", (a, b, c), strict=True)
    }
    axes = about["z"] @ about["y"] @ about["x"]
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, inertia, atol=1e-6)


def test_fanuc_has_centimetres_and_kilogram_force_centimetres_second_squared(robot, load):
    m, x, y, z, *moments = numbers_in(payload_for(load, robot, "fanuc"))
    centre, inertia = expected(robot, "tool0")
    np.testing.assert_allclose([m, x, y, z], [MASS, *100 * centre], atol=1e-4)
    np.testing.assert_allclose(moments, 10.19716 * np.diag(inertia), rtol=1e-4)


def test_abb_has_millimetres_and_a_unit_quaternion(robot, load):
    m, x, y, z, w, i, j, k, *moments = numbers_in(payload_for(load, robot, "abb"))
    centre, inertia = expected(robot, "tool0")
    np.testing.assert_allclose([m, x, y, z], [MASS, *1e3 * centre], atol=1e-3)
    assert abs(np.linalg.norm([w, i, j, k]) - 1.0) < 1e-5
    for axis, moment in zip(pin.Quaternion(w, i, j, k).matrix().T, moments, strict=True):
        np.testing.assert_allclose(inertia @ axis, moment * axis, atol=1e-6)


@pytest.mark.parametrize("format", PAYLOAD_FORMATS)
def test_what_is_written_is_read_again(robot, load, format):
    payload = payload_for(load, robot, format, "tool0")
    back = read_payload(payload.text, format)
    np.testing.assert_allclose(back.toDynamicParameters(), payload.body.toDynamicParameters(), atol=1e-5)
    with pytest.raises(InputError, match="no load"):
        read_payload(payload.text.replace("1.6", "1,6"), format)


@pytest.mark.parametrize("format", PAYLOAD_FORMATS)
def test_an_inertia_that_is_not_told_is_that_of_a_point(robot, load, format):
    vague = replace(load, half_width_95=np.array([*load.half_width_95[:4], *[0.05] * 6]))
    payload = payload_for(vague, robot, format, "tool0")
    assert payload.point_mass and not payload.body.inertia.any() and "point" in payload.summary()
    assert read_payload(payload.text, format).mass == pytest.approx(MASS)


def test_a_body_that_cannot_be_is_written_as_a_point(robot, load):
    numbers = pin.Inertia(MASS, CENTRE, np.diag([0.01, 0.01, 0.05])).toDynamicParameters()
    assert payload_for(replace(load, parameters=numbers), robot, "ur").point_mass


@pytest.mark.parametrize(
    ("format", "arm", "kilograms"),
    [
        ("ur", "ur3", 3.0),
        ("ur", "ur5e_robot", 5.0),
        ("ur", "UR10", 10.0),
        ("ur", "ur10e", 12.5),
        ("ur", "ur30", 35.0),
        ("franka", "fr3", 3.0),
        ("kuka", "lbr_iiwa_14_r820", 14.0),
        ("kuka", "iiwa7", 7.0),
        ("fanuc", "lrmate200id", 7.0),
        ("abb", "irb120_3_58", 3.0),
        ("abb", "mine", 800.0),
    ],
)
def test_a_load_beyond_the_rating_is_refused(robot, load, format, arm, kilograms):
    def carried(share):
        lifted = replace(load, parameters=load.parameters * share * kilograms / MASS)
        return payload_for(lifted, replace(robot, name=arm), format, "tool0")

    assert carried(0.99).body.mass < kilograms
    with pytest.raises(InputError, match=f"rated for {kilograms:g} kg"):
        carried(1.01)


def test_what_cannot_be_written_is_one_line_with_what_to_do(robot, load):
    blind = replace(load, seen=np.array([True, True, True, False, *[True] * 6]))
    with pytest.raises(InputError, match="not told"):
        payload_for(blind, robot, "ur")
    exchanged = replace(load, parameters=-load.parameters)
    with pytest.raises(InputError, match=r"is -.* kg.*first log is that without the load"):
        payload_for(exchanged, robot, "ur", "tool0")
    with pytest.raises(InputError, match="--flange"):
        payload_for(load, load_robot("iiwa14"), "kuka")
    assert payload_for(load, load_robot("iiwa14"), "kuka", "link7").flange == "link7"
    with pytest.raises(InputError, match="fixed to the last joint"):
        payload_for(load, robot, "ur", "elbow_joint")
    with pytest.raises(UnknownNameError):
        payload_for(load, robot, "yaskawa")
