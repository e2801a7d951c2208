"""Noise-free runs against the equations of motion, which pinocchio evaluates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from excite.arrays import Array
from excite.errors import MotionError
from excite.robot.robot import Robot
from excite.simulation.execution import Machine, execute_motion
from excite.simulation.replay import watched_run
from excite.simulation.virtual_robot import Plant, Recording, VirtualRobot, nominal_robot
from tests.simulation.motions import squatting, standing, waving


def _true_model(virtual: VirtualRobot) -> pin.Model:
    model = virtual.robot.model.copy()
    for joint in range(1, model.njoints):
        model.inertias[joint] = pin.Inertia.FromDynamicParameters(
            virtual.truth.phi[10 * (joint - 1) : 10 * joint]
        )
    return model


def _base_rows(virtual: VirtualRobot, run: Recording) -> tuple[Array, Array]:
    """Y₁ φ of the measured segments and Σ J₁ᵀ f, ``(n, 6)`` each, in the base frame."""
    robot = virtual.robot
    model, data, phi = robot.model, robot.model.createData(), virtual.truth.phi.copy()
    for sensor in robot.sensors:
        for segment in sensor.excludes:
            phi[robot.parameter_columns(segment)] = 0.0
    left, right = np.zeros((len(run.time), 6)), np.zeros((len(run.time), 6))
    for row, (q, v, a) in enumerate(zip(run.q, run.v, run.a, strict=True)):
        left[row] = (pin.computeJointTorqueRegressor(model, data, q, v, a) @ phi)[:6]
        pin.forwardKinematics(model, data, q)
        for sensor in robot.sensors:
            pose = data.oMi[1].inverse() * data.oMi[sensor.joint] * sensor.placement
            right[row] += pose.act(pin.Force(run.wrenches[sensor.name][row])).vector
    return left, right


def test_standing_still_the_ankles_carry_the_weight_less_the_feet(changed_g1: VirtualRobot) -> None:
    run = execute_motion(changed_g1, standing(changed_g1.robot))
    feet = [segment for sensor in changed_g1.robot.sensors for segment in sensor.excludes]
    mass, feet_mass = changed_g1.truth.phi[::10].sum(), changed_g1.truth.phi[::10][feet].sum()
    vertical = sum(wrench[-1, 2] for wrench in run.wrenches.values())
    ground = sum(wrench[-1, 2] for wrench in run.contacts.values())
    assert ground == pytest.approx(9.81 * mass, rel=1e-4)
    assert vertical == pytest.approx(9.81 * (mass - feet_mass), rel=1e-4)


def test_base_rows_hold_to_rounding(changed_g1: VirtualRobot, squat: Recording) -> None:
    left, right = _base_rows(changed_g1, squat)
    assert np.ptp(right, axis=0).min() > 0.5
    np.testing.assert_allclose(left, right, atol=1e-9)


def test_the_nominal_parameters_do_not_explain_the_changed_robot(
    changed_g1: VirtualRobot, squat: Recording
) -> None:
    left, right = _base_rows(changed_g1, squat)
    nominal = VirtualRobot(changed_g1.robot, _nominal(changed_g1), changed_g1.drives)
    wrong, _ = _base_rows(nominal, squat)
    assert np.abs(wrong - right)[:, 2].mean() == pytest.approx(5.0 * 9.81, rel=0.1)
    assert np.abs(left - right).max() < 1e-3 * np.abs(wrong - right).max()


def _nominal(virtual: VirtualRobot):
    from excite.simulation.true_parameters import nominal_truth

    return nominal_truth(virtual.robot)


def test_contact_forces_stay_in_the_friction_cone(changed_g1: VirtualRobot, squat: Recording) -> None:
    for foot in changed_g1.robot.feet:
        force = squat.contacts[foot.name][:, :3]
        assert (force[:, 2] > 0.0).all()
        assert (np.linalg.norm(force[:, :2], axis=1) <= foot.friction * force[:, 2] * (1.0 + 1e-6)).all()


def test_accelerations_are_those_of_the_positions(arm_run: Recording) -> None:
    h = arm_run.time[1] - arm_run.time[0]
    second = np.diff(arm_run.q, n=2, axis=0) / h**2
    smooth = np.abs(np.diff(arm_run.a, axis=0)).max(axis=1) < 1.0
    rows = np.flatnonzero(smooth[1:] & smooth[:-1])
    assert len(rows) > 100
    np.testing.assert_allclose(second[rows], arm_run.a[rows + 1], atol=0.5)


def test_arm_torques_are_inverse_dynamics_and_friction(arm: VirtualRobot, arm_run: Recording) -> None:
    model, drives = _true_model(arm), arm.drives
    data, run = model.createData(), arm_run
    rigid = np.array([pin.rnea(model, data, *sample) for sample in zip(run.q, run.v, run.a, strict=True)])
    end = run.v + arm.world.timestep * run.a
    moving = np.abs(run.v) > 0.05
    assert moving.mean() > 0.5
    link = rigid + drives.bearing_viscous * end + drives.bearing_coulomb * np.sign(run.v)
    motor = link + drives.viscous * end + drives.coulomb * np.sign(run.v) + drives.armature * run.a
    np.testing.assert_allclose(run.tau_link[moving], link[moving], atol=1e-6)
    np.testing.assert_allclose(run.tau_motor[moving], motor[moving], atol=1e-6)


def test_friction_holds_a_still_joint_within_its_bound(arm: VirtualRobot) -> None:
    run = execute_motion(arm, standing(arm.robot, 0.5))
    assert np.abs(run.v[-1]).max() < 1e-3
    gap = np.abs(run.tau_motor[-1] - run.tau_link[-1])
    assert (gap <= arm.drives.coulomb + arm.drives.viscous * 1e-3 + 1e-6).all()


def test_tracking_is_that_of_a_stiff_servo(squat: Recording) -> None:
    assert np.abs(squat.q[:, 7:] - squat.q_cmd).max() < 0.01


def test_the_run_ends_where_it_is_told_to(g1: Robot, changed_g1: VirtualRobot) -> None:
    run = execute_motion(changed_g1, standing(g1), stop=lambda sample, qpos: sample == 9)
    assert len(run.time) == len(run.q_cmd) == len(run.wrenches["left_foot"]) == 10


def test_a_motion_of_another_robot_is_refused(changed_g1: VirtualRobot, panda: Robot) -> None:
    with pytest.raises(MotionError, match="other joints"):
        execute_motion(changed_g1, waving(panda, {}))


def test_a_finer_step_changes_little(changed_g1: VirtualRobot, squat: Recording) -> None:

    fine = replace(changed_g1, world=replace(changed_g1.world, timestep=2.5e-4))
    run = execute_motion(fine, squatting(fine.robot, duration=2.0))
    assert np.abs(run.q[:, 7:] - squat.q[:, 7:]).max() < 2e-3


def test_a_run_that_goes_wrong_is_refused_and_leaves_no_file_behind(
    arm: VirtualRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Blow:
        """A torque that no robot takes."""

        def start(self, plant: Plant) -> Callable[[], None]:
            return lambda: plant.torque.fill(1e25)

    monkeypatch.chdir(tmp_path)
    wild = arm.with_law(Blow())
    with pytest.raises(MotionError, match="diverged"):
        execute_motion(wild, waving(arm.robot, {arm.robot.joint_names[0]: 0.3}))
    assert not list(tmp_path.iterdir())


def test_soles_stand_still_however_stiffly_their_joints_are_damped(g1: Robot) -> None:
    """Where contacts do not know that damping outweighs inertia by far, they slip 21 mm in steps of 1 ms."""
    stiff = nominal_robot(g1)
    stiff = replace(stiff, drives=replace(stiff.drives, kd=8.0 * stiff.drives.kd))
    motion = squatting(g1, duration=1.0)
    slips = [
        watched_run(replace(stiff, world=replace(stiff.world, timestep=step)), motion).replay.max_slip_m
        for step in (2.5e-3, 1e-3, 2.5e-4)
    ]
    assert max(slips) < 1e-3 and slips == pytest.approx([slips[-1]] * 3, abs=3e-4)


def test_a_clipped_drive_of_a_standing_robot_satisfies_the_equations_of_motion(g1: Robot) -> None:
    weak = nominal_robot(g1)
    limit = weak.drives.torque_limit.copy()
    waist = g1.joint_index("waist_yaw_joint")
    limit[waist] = 0.5
    weak = replace(weak, drives=replace(weak.drives, torque_limit=limit))
    run = execute_motion(weak, waving(g1, {"waist_yaw_joint": 0.3}))
    assert run.clipped[:, waist].mean() > 0.1
    model, data = _true_model(weak), g1.model.createData()
    rigid = np.array([pin.rnea(model, data, *sample) for sample in zip(run.q, run.v, run.a, strict=True)])
    np.testing.assert_allclose(run.tau_link[:, waist], rigid[:, g1.n_base_v + waist], atol=1e-6)


def test_a_single_tree_is_not_searched_for_islands_and_moves_the_same(changed_g1: VirtualRobot) -> None:
    machine, searching = Machine(changed_g1), Machine(changed_g1)
    assert machine.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ISLAND
    searching.model.opt.disableflags = 0
    motion = squatting(changed_g1.robot)
    ours, theirs = (execute_motion(changed_g1, motion, machine=each) for each in (machine, searching))
    assert np.array_equal(ours.q, theirs.q)
    assert np.array_equal(ours.tau_link, theirs.tau_link)
