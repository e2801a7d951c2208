"""What motions leave unexcited."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from excite.excitation.conditioning import (
    MotionFactor,
    compute_conditioning,
    motion_factor,
    unexcited_parameters,
)
from excite.regressor.base_parameters import r_factor
from excite.regressor.columns import measured_columns, regressor_rows
from excite.robot.robot import Robot
from tests.excitation.conftest import sines


def test_joints_that_rest_leave_their_friction_unexcited(panda: Robot) -> None:
    still = {0, 4}
    motions = [
        sines(panda, f"motion{i}", i, moving=[j for j in range(7) if j not in still]) for i in range(2)
    ]
    found = unexcited_parameters(
        compute_conditioning(panda, [motion_factor(panda, motion) for motion in motions])
    )
    labels = {parameter.label for parameter in found}
    friction = {label for label in labels if label.startswith(("viscous", "coulomb"))}
    assert friction == {f"{term}({panda.joint_names[j]})" for term in ("viscous", "coulomb") for j in still}
    assert all(0.25 < parameter.share <= 1.0 + 1e-9 for parameter in found)
    assert all(parameter.expression.startswith(parameter.label) for parameter in found)


def test_nothing_is_unexcited_when_all_joints_move(panda: Robot) -> None:
    factors = [motion_factor(panda, sines(panda, f"motion{i}", i)) for i in range(3)]
    assert unexcited_parameters(compute_conditioning(panda, factors)) == ()


def test_a_humanoid_on_its_feet_with_still_legs_lacks_leg_parameters(g1: Robot) -> None:
    arms = [
        6 + j
        for j, name in enumerate(g1.joint_names)
        if "leg" not in name and name.startswith(("left_s", "waist"))
    ]
    found = unexcited_parameters(
        compute_conditioning(g1, [motion_factor(g1, sines(g1, "arm", 0, moving=arms), 25.0)])
    )
    assert any("knee" in parameter.label for parameter in found)
    assert len(found) > 50


def standing(robot: Robot, feet: tuple[str, ...], n: int) -> MotionFactor:
    """Factor of random postures, velocities and accelerations that leave the soles of these feet at rest."""
    model, data, random = robot.model, robot.model.createData(), np.random.default_rng(0)
    parts = tuple(foot.split("_")[0] + part for foot in feet for part in ("_hip", "_knee", "_ankle"))
    legs = np.array([6 + j for j, name in enumerate(robot.joint_names) if name.startswith(parts)])
    free = np.setdiff1d(np.arange(model.nv), legs)
    planted = [robot.foot(name) for name in feet]
    pin.forwardKinematics(model, data, robot.rest)
    soles = [data.oMi[foot.joint] * foot.placement for foot in planted]

    def jacobian(q: np.ndarray) -> np.ndarray:
        pin.computeJointJacobians(model, data, q)
        return np.vstack([pin.getJointJacobian(model, data, foot.joint, pin.LOCAL) for foot in planted])

    samples = []
    for _ in range(n):
        step = random.uniform(-1.5, 1.5, model.nv)
        step[:6] = random.uniform(-0.05, 0.05, 6) - [0.0, 0.0, 0.07, 0.0, 0.0, 0.0]
        step[legs] = 0.0
        q = pin.integrate(model, robot.rest, step)
        for _ in range(25):
            whole = jacobian(q)
            errors = [
                pin.log(data.oMi[foot.joint].actInv(sole * foot.placement.inverse())).vector
                for foot, sole in zip(planted, soles, strict=True)
            ]
            q[legs + 1] += np.clip(np.linalg.solve(whole[:, legs], np.concatenate(errors)), -0.2, 0.2)
        whole = jacobian(q)
        v, a = random.normal(size=(2, model.nv))
        v[legs] = -np.linalg.solve(whole[:, legs], whole[:, free] @ v[free])
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        drift = np.concatenate([data.a[foot.joint].vector for foot in planted])
        a[legs] = -np.linalg.solve(whole[:, legs], whole[:, free] @ a[free] + drift)
        samples.append((q, v, a))
    columns = measured_columns(robot)
    rows = regressor_rows(robot, columns, *(np.array(part) for part in zip(*samples, strict=True)))
    return MotionFactor(feet, columns, r_factor(rows.reshape(-1, rows.shape[2])), 6 * n, 50.0)


def test_double_support_leaves_leg_parameters_unexcited_and_one_leg_stances_do_not(g1: Robot) -> None:
    plates = replace(g1, sensors=tuple(replace(sensor, excludes=()) for sensor in g1.sensors))
    for robot, lacking in ((plates, 21), (g1, 7)):
        both = compute_conditioning(robot, [standing(robot, ("left_foot", "right_foot"), 150)])
        assert both.n_base_parameters - both.rank == lacking
        labels = {parameter.label for parameter in unexcited_parameters(both)}
        assert all("hip" in label or "ankle" in label for label in labels)
        # A sole at rest shows nothing of its foot's inertia; ankle sensors leave the foot out altogether.
        feet = {label for label in labels if "ankle_roll" in label}
        assert ("Ixy(left_ankle_roll_link)" in feet) == (robot is plates)
        one_leg = compute_conditioning(robot, [standing(robot, (foot.name,), 100) for foot in robot.feet])
        assert one_leg.rank == one_leg.n_base_parameters
        assert unexcited_parameters(one_leg) == ()
