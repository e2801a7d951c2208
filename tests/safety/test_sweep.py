"""The finer grid and what is evaluated on it, against pinocchio and the motion's own interpolation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.lazy_kernel import LazyKernel
from excite.motion.motion import Motion, interpolate_motion
from excite.robot.quantities import PerJoint
from excite.robot.robot import Robot
from excite.safety.checks.control_points import joint_bounds
from excite.safety.checks.joints import drive_torques
from excite.safety.checks.sweep import Sweep
from excite.safety.ground_forces import polygon_margin, wrench_at_world_origin, zero_moment_point
from tests.safety.control_points import control_points
from tests.safety.motions import arm_motion


@pytest.mark.parametrize(
    ("own", "fine"), [(500.0, 1000.0), (200.0, 400.0), (100.0, 200.0), (40.0, 200.0), (70.0, 210.0)]
)
def test_the_grid_is_twice_as_fine_and_never_below_200_hz(own: float, fine: float, arm: Robot) -> None:
    motion = arm_motion(arm, 1.0).resampled(arm, own)
    sweep = Sweep(arm, motion)
    assert np.diff(sweep.fine.time) == pytest.approx(1.0 / fine)
    at = np.searchsorted(sweep.fine.time, motion.time - 1e-9)
    assert np.allclose(sweep.fine.q[at], motion.q, atol=1e-12), "the motion's own samples are among them"


def test_a_rate_that_is_asked_for_is_never_below_the_motion_s(arm: Robot) -> None:
    motion = arm_motion(arm, 1.0).resampled(arm, 100.0)
    assert np.diff(Sweep(arm, motion, 250.0).fine.time) == pytest.approx(1.0 / 250.0)
    assert Sweep(arm, motion, 20.0).fine is motion


@pytest.mark.parametrize(
    ("rate", "stride"), [(200.0, 1), (290.0, 1), (310.0, 2), (400.0, 2), (1000.0, 5), (150.0, 1)]
)
def test_torques_are_evaluated_about_200_times_a_second(rate: float, stride: int, arm: Robot) -> None:
    motion = arm_motion(arm, 1.0).resampled(arm, 100.0)
    sweep = Sweep(arm, motion, rate)
    expected = [*range(0, sweep.fine.n_samples - 1, stride), sweep.fine.n_samples - 1]
    assert sweep.torque_samples.tolist() == expected


def test_control_points_are_those_of_the_interpolation(humanoid: Robot, squatting: Motion) -> None:
    """Bernstein polynomials of the control points are the motion between the grid's samples."""
    sweep = Sweep(humanoid, squatting)
    points, grid = control_points(sweep.fine), sweep.fine.time
    bounds = points.bounds()
    for name in ("lowest", "highest", "speed", "acceleration"):
        assert np.allclose(getattr(sweep.bounds, name), getattr(bounds, name), rtol=1e-9, atol=1e-8), name
    for k in (200, 411, 600):
        for u in (0.0, 0.3, 0.8):
            there = interpolate_motion(
                sweep.fine, humanoid, np.array([grid[k] + u * (grid[k + 1] - grid[k])])
            )
            for values, expected in (
                (points.position[:, k], there.joint_positions()[0]),
                (points.velocity[:, k], there.joint_velocities()[0]),
                (points.acceleration[:, k], there.joint_accelerations()[0]),
            ):
                while len(values) > 1:
                    values = (1.0 - u) * values[:-1] + u * values[1:]
                assert np.allclose(values[0], expected, atol=1e-8)


@pytest.mark.parametrize("lost", ["q", "v", "a"])
def test_what_is_no_number_bounds_nothing(lost: str, arm: Robot) -> None:
    motion = arm_motion(arm, 1.0)
    values = getattr(motion, lost).copy()
    values[7, 2] = np.nan
    bounds = joint_bounds(replace(motion, **{lost: values}))
    for name in ("lowest", "highest", "speed", "acceleration"):
        found = np.argwhere(np.isnan(getattr(bounds, name)))
        assert found.tolist() == [[6, 2], [7, 2]]


def turned(robot: Robot, motion: Motion) -> Motion:
    """The motion with the base elsewhere and turned about all axes; joints move on."""
    q = motion.q.copy()
    pose = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.4, 1.1), np.array([0.7, -0.5, 0.2]))
    for row in q:
        row[:7] = pin.SE3ToXYZQUAT(pose * pin.XYZQUATToSE3(row[:7]))
    return replace(motion, q=q)


def test_poses_and_wrench_of_a_turned_base(humanoid: Robot, squatting: Motion) -> None:
    motion = turned(humanoid, squatting)
    sweep = Sweep(humanoid, motion)
    model, data = humanoid.model, humanoid.model.createData()
    for k in (250, 640):
        q, v, a = sweep.fine.q[k], sweep.fine.v[k], sweep.fine.a[k]
        tau = pin.rnea(model, data, q, v, a)
        pin.forwardKinematics(model, data, q)
        expected = data.oMi[1].act(pin.Force(tau[:6])).vector
        assert np.allclose(sweep.wrench[k], expected, atol=1e-9)
        assert np.allclose(sweep.dynamics.com[k], pin.centerOfMass(model, data, q))
        for foot, corners in zip(humanoid.feet, sweep.sole_corners, strict=True):
            assert np.allclose(corners[k], [data.oMi[foot.joint].act(corner) for corner in foot.sole])
        row = int(np.flatnonzero(sweep.torque_samples == k)[0])
        jacobian = pin.computeJointJacobians(model, data, q)
        assert np.allclose(sweep.dynamics.screws[row, 2:].T, jacobian[:, 6:])


def test_an_arm_is_judged_without_compiled_loops(
    arm: Robot, swinging: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They take a third of a second to load, and few samples of an arm none."""
    monkeypatch.setattr(LazyKernel, "__call__", None)
    sweep = Sweep(arm, swinging)
    k = int(sweep.torque_samples[20])
    data = arm.model.createData()
    assert np.allclose(
        sweep.dynamics.tau[k], pin.rnea(arm.model, data, sweep.fine.q[k], sweep.fine.v[k], sweep.fine.a[k])
    )
    assert np.allclose(sweep.dynamics.com[k], pin.centerOfMass(arm.model, data, sweep.fine.q[k]))


def test_of_a_robot_on_feet_pinocchio_computes_nothing(
    humanoid: Robot, squatting: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pin, "rnea", None)
    assert np.isfinite(Sweep(humanoid, squatting).dynamics.tau).all()


def test_joint_torques_hold_against_the_feet_s_forces(humanoid: Robot, squatting: Motion) -> None:
    """Pinocchio's inverse dynamics with the soles' forces applied, in motion."""
    sweep = Sweep(humanoid, squatting)
    model, data = humanoid.model, humanoid.model.createData()
    for row in (70, 150):
        k = int(sweep.torque_samples[row])
        q, v, a = sweep.fine.q[k], sweep.fine.v[k], sweep.fine.a[k]
        pin.forwardKinematics(model, data, q)
        external = pin.StdVec_Force()
        for _ in range(model.njoints):
            external.append(pin.Force.Zero())
        for foot, part in zip(humanoid.feet, sweep.contact_forces, strict=True):
            for corner, force in zip(foot.sole, part.forces[row], strict=True):
                local = data.oMi[foot.joint].rotation.T @ force
                external[foot.joint] += pin.Force(local, np.cross(corner, local))
        tau = pin.rnea(model, data, q, v, a, external)[6:]
        friction = drive_torques(sweep)[row] - tau
        assert np.allclose(friction, drive_share(humanoid, v[6:], a[6:]), atol=1e-9)


def drive_share(robot: Robot, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """What drives need for themselves: viscous and Coulomb friction, and their rotors' inertia."""
    drives = robot.description.drives
    total = np.zeros(robot.n_joints)
    for block, factor in ((drives.viscous, v), (drives.coulomb, np.sign(v)), (drives.armature, a)):
        if block is not None:
            for i, name in enumerate(robot.joint_names):
                value = block.joints.get(name, block.default)
                total[i] += 0.0 if value is None else value * factor[i]
    return total


def test_drives_friction_and_inertia_count(arm: Robot, swinging: Motion) -> None:
    drives = arm.description.drives.model_copy(
        update={
            name: PerJoint(default=value, source="here")
            for name, value in (("viscous", 3.0), ("coulomb", 5.0), ("armature", 0.7))
        }
    )
    robot = replace(arm, description=arm.description.model_copy(update={"drives": drives}))
    sweep = Sweep(robot, swinging)
    rows = sweep.torque_samples
    data = robot.model.createData()
    for row in (40, 90):
        k = int(rows[row])
        q, v, a = sweep.fine.q[k], sweep.fine.v[k], sweep.fine.a[k]
        expected = pin.rnea(robot.model, data, q, v, a) + 3.0 * v + 5.0 * np.sign(v) + 0.7 * a
        assert np.allclose(drive_torques(sweep)[row], expected)


def test_a_foot_in_the_air_carries_nothing(humanoid: Robot, squatting: Motion) -> None:
    left, right = (foot.name for foot in humanoid.feet)
    flags = {name: np.ones(squatting.n_samples, bool) for name in (left, right)}
    flags[left][100:200], flags[right][400:450], flags[left][430:450] = False, False, False
    sweep = Sweep(humanoid, replace(squatting, contacts=flags))
    time = sweep.fine.time[sweep.torque_samples]
    first, second = sweep.contact_forces
    alone = (time > 0.51) & (time < 0.98)
    flying = (time > 2.16) & (time < 2.23)
    both = time < 0.48
    assert (first.forces[alone] == 0.0).all() and (second.forces[alone, :, 2].sum(axis=1) > 0.0).all()
    assert (first.forces[both, :, 2].sum(axis=1) > 0.0).all()
    assert (first.forces[flying] == 0.0).all() and (second.forces[flying] == 0.0).all()
    assert np.isinf(first.residual[flying]).all() and (first.residual[both] < 1e-3).all()
    assert np.array_equal(first.residual, second.residual)


def test_contact_phases_are_sets_of_feet(humanoid: Robot, squatting: Motion) -> None:
    left, right = (foot.name for foot in humanoid.feet)
    flags = {name: np.ones(squatting.n_samples, bool) for name in (left, right)}
    flags[left][100:200] = False
    sweep = Sweep(humanoid, replace(squatting, contacts=flags))
    every = np.arange(sweep.fine.n_samples)
    found = {tuple(standing.feet.tolist()): standing.rows for standing in sweep.on_feet(every)}
    assert set(found) == {(0, 1), (1,)}
    assert np.array_equal(np.sort(np.concatenate(list(found.values()))), every)
    assert not sweep.contacts[found[1,], 0].any()


def test_wrench_moves_to_the_world_as_a_spatial_force() -> None:
    rng = np.random.default_rng(0)
    wrenches, poses = rng.normal(size=(20, 6)), [pin.SE3.Random() for _ in range(20)]
    moved = wrench_at_world_origin(
        wrenches, np.array([pose.rotation for pose in poses]), np.array([pose.translation for pose in poses])
    )
    expected = [pose.act(pin.Force(wrench)).vector for pose, wrench in zip(poses, wrenches, strict=True)]
    assert np.allclose(moved, expected)


def test_the_zero_moment_point_has_no_horizontal_moment_at_its_height() -> None:
    rng = np.random.default_rng(1)
    wrench = rng.normal(size=(20, 6)) + np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
    for height in (0.0, 0.3):
        point = np.column_stack([zero_moment_point(wrench, height), np.full(20, height)])
        moment = wrench[:, 3:] - np.cross(point, wrench[:, :3])
        assert np.allclose(moment[:, :2], 0.0, atol=1e-12)
    wrench[3, 2], wrench[4, 2] = 0.0, -1.0
    assert np.isnan(zero_moment_point(wrench)).any(axis=1).nonzero()[0].tolist() == [3, 4]


def test_many_polygons_are_judged_as_each_alone() -> None:
    rng = np.random.default_rng(2)
    corners, points = rng.normal(size=(2500, 4, 2)), rng.normal(size=(2500, 2))
    together = polygon_margin(corners, points)
    for k in (0, 1023, 1024, 1025, 2047, 2048, 2499):
        assert together[k] == polygon_margin(corners[k : k + 1], points[k : k + 1])[0]
