"""Whole-body paths: rotations of the base against scipy and finite differences, feet against pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.repairs.path import MotionPath, angular_rates, coordinates_of
from tests.safety.soles import foot_displacements


def rotation_vectors(angle: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation vectors of one length in all directions, with derivatives of ordinary size."""
    rng = np.random.default_rng(3)
    r, dr, ddr = rng.normal(size=(3, 40, 3))
    return angle * r / np.linalg.norm(r, axis=1, keepdims=True), dr, ddr


@pytest.mark.parametrize("angle", [0.0, 1e-3, 0.03, 0.049, 0.051, 0.4, 1.5, 3.0])
def test_angular_rates_are_derivatives_of_the_rotation(angle: float) -> None:
    """Small angles take series, whose terms have to join the closed form at 0.05 rad."""
    r, dr, ddr = rotation_vectors(angle)
    h = 1e-4

    def at(t: float) -> np.ndarray:
        return r + t * dr + 0.5 * t**2 * ddr

    omega, rate = angular_rates(r, dr, ddr)
    turned = Rotation.from_rotvec(at(-h)).inv() * Rotation.from_rotvec(at(h))
    assert np.allclose(omega, turned.as_rotvec() / (2 * h), atol=2e-7)
    later, earlier = (angular_rates(at(t), dr + t * ddr, ddr)[0] for t in (h, -h))
    assert np.allclose(rate, (later - earlier) / (2 * h), atol=2e-7)


def test_series_and_closed_form_meet() -> None:
    below, above = (angular_rates(*rotation_vectors(angle)) for angle in (0.05 - 1e-9, 0.05 + 1e-9))
    for one, other in zip(below, above, strict=True):
        assert np.allclose(one, other, atol=1e-8)


def test_rotations_about_one_axis_are_those_of_the_plane() -> None:
    r, dr, ddr = (np.array([[0.0, 0.0, value]]) for value in (0.7, 1.3, -2.1))
    omega, rate = angular_rates(r, dr, ddr)
    assert np.allclose(omega, dr) and np.allclose(rate, ddr)


def test_coordinates_lead_back_to_the_configurations(g1: Robot) -> None:
    rng = np.random.default_rng(0)
    q = np.tile(g1.rest, (12, 1)) + np.r_[rng.normal(size=3), np.zeros(4), 0.1 * rng.normal(size=g1.n_joints)]
    turns = Rotation.from_rotvec(np.linspace(0.0, 1.0, 12)[:, None] * [0.4, -0.8, 1.1])
    q[:, 3:7] = (Rotation.from_quat(g1.rest[3:7]) * turns).as_quat()
    path = MotionPath(g1, np.linspace(0.0, 2.0, 12), coordinates_of(g1, q))
    for row, expected in zip(path.knots.q, q, strict=True):
        assert np.linalg.norm(pin.difference(g1.model, row, expected)) < 1e-9
    assert np.allclose(path.knots.twist[[0, -1]], 0.0, atol=1e-12)
    panda = load_robot("panda")
    joints = np.tile(panda.rest, (3, 1))
    assert coordinates_of(panda, joints) is joints


def test_twist_of_a_turning_base_is_in_its_own_frame(g1: Robot) -> None:
    """Base and joints moved at once; derivatives along the path by pinocchio's differences."""
    s = np.linspace(0.0, 3.0, 31)
    bump = np.sin(np.pi * s / 3.0)[:, None] ** 2
    coordinates = np.hstack(
        [g1.rest[:3] + bump * [0.3, -0.2, 0.1], bump * [0.5, 0.9, -0.7], g1.rest[7:] + 0.1 * bump]
    )
    path, h = MotionPath(g1, s, coordinates), 1e-5
    inside = np.array([0.55, 1.27, 2.43])
    here, before, after = path.sample(inside), path.sample(inside - h), path.sample(inside + h)
    for i in range(3):
        step = pin.difference(g1.model, before.q[i], after.q[i]) / (2 * h)
        assert np.allclose(here.twist[i], step, atol=1e-8)
    assert np.allclose(here.curvature, (after.twist - before.twist) / (2 * h), atol=1e-6)


def test_feet_are_as_far_as_their_farthest_corner(g1: Robot) -> None:
    lifted, turned = g1.rest.copy(), g1.rest.copy()
    lifted[:3] += [0.0, 0.03, 0.04]
    ankle = g1.joint_index("left_ankle_pitch_joint")
    turned[7 + ankle] += 0.2
    moved = foot_displacements(g1, np.array([g1.rest, lifted, turned]))
    for foot in g1.feet:
        assert moved[foot.name][:2] == pytest.approx([0.0, 0.05])
    left, right = g1.feet
    assert moved[right.name][2] == 0.0
    joint = g1.model.joints[ankle + 2]
    data = g1.model.createData()
    pin.forwardKinematics(g1.model, data, g1.rest)
    lever = (
        np.array([data.oMi[left.joint].act(corner) for corner in left.sole]) - data.oMi[joint.id].translation
    )
    axis = data.oMi[joint.id].rotation[:, 1]
    across = np.linalg.norm(lever - np.outer(lever @ axis, axis), axis=1)
    assert moved[left.name][2] == pytest.approx(2.0 * np.sin(0.1) * across.max(), rel=1e-6)
