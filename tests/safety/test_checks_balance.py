"""Contact wrench, zero-moment point and torques against MuJoCo, pinocchio, linear programming and statics."""

from __future__ import annotations

import re

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog, nnls
from scipy.spatial import ConvexHull

from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.checks.joints import drive_torques
from excite.safety.checks.sweep import Sweep
from excite.safety.ground_forces import (
    RESIDUAL_TOLERANCE,
    distribute_wrench,
    friction_edges,
    polygon_margin,
    zero_moment_point,
)
from tests.safety.motions import squat


def still(robot: Robot) -> Motion:
    """Three samples at rest."""
    q, nothing = np.tile(robot.rest, (3, 1)), np.zeros((3, robot.model.nv))
    contacts = {foot.name: np.ones(3, bool) for foot in robot.feet}
    time = np.array([0.0, 0.005, 0.01])
    return Motion("still", robot.name, robot.joint_names, time, q, nothing, nothing, contacts)


# --- Statics


def test_static_zmp_is_the_centre_of_mass_and_soles_carry_the_weight(humanoid: Robot) -> None:
    sweep = Sweep(humanoid, still(humanoid))
    data = humanoid.model.createData()
    com = pin.centerOfMass(humanoid.model, data, humanoid.rest)
    weight = humanoid.mass * 9.81
    assert np.allclose(sweep.zmp, com[:2], atol=1e-9)
    assert np.allclose(sweep.wrench[:, :3], [0.0, 0.0, weight], atol=1e-9)
    left, right = (part.forces[:, :, 2].sum(axis=1) for part in sweep.contact_forces)
    assert np.allclose(left + right, weight, rtol=RESIDUAL_TOLERANCE)
    # The lever rule along the line between the feet.
    y = [corners[0, :, 1] for corners in sweep.sole_corners]
    moment = sum((part.forces[0, :, 2] * y[i]).sum() for i, part in enumerate(sweep.contact_forces))
    assert moment == pytest.approx(weight * com[1], abs=RESIDUAL_TOLERANCE * weight * 0.1)
    assert np.allclose(left, right, rtol=0.05), "a symmetric posture loads both feet alike"


def test_static_torques_have_no_drive_for_the_base(humanoid: Robot) -> None:
    """Pinocchio's inverse dynamics with the soles' forces applied: nothing is left for the base's rows."""
    sweep = Sweep(humanoid, still(humanoid))
    model, data = humanoid.model, humanoid.model.createData()
    pin.forwardKinematics(model, data, humanoid.rest)
    external = pin.StdVec_Force()
    for _ in range(model.njoints):
        external.append(pin.Force.Zero())
    for foot, part in zip(humanoid.feet, sweep.contact_forces, strict=True):
        for corner, force in zip(foot.sole, part.forces[0], strict=True):
            local = data.oMi[foot.joint].rotation.T @ force
            external[foot.joint] += pin.Force(local, np.cross(corner, local))
    zero = np.zeros(model.nv)
    tau = pin.rnea(model, data, humanoid.rest, zero, zero, external)
    assert np.abs(tau[:6]).max() < 2.0 * RESIDUAL_TOLERANCE * humanoid.mass * 9.81
    assert np.allclose(drive_torques(sweep)[0], tau[6:], atol=1e-9)


# --- Against MuJoCo


def mujoco_model(robot: Robot) -> mujoco.MjModel:
    """The robot's URDF without geometry, on a free joint."""
    bare = re.sub(r"<(visual|collision)\b.*?</\1>", "", robot.urdf, flags=re.DOTALL)
    bare = re.sub(
        r"(<robot\b[^>]*>)",
        r'\1<mujoco><compiler fusestatic="false" strippath="false"/></mujoco>',
        bare,
        count=1,
    )
    spec = mujoco.MjSpec.from_string(bare)
    spec.worldbody.first_body().add_freejoint()
    return spec.compile()


def test_wrench_and_zmp_match_mujoco(humanoid: Robot) -> None:
    motion = squat(humanoid, depth=0.1, sway=0.05, duration=1.5)
    sweep = Sweep(humanoid, motion)
    model = mujoco_model(humanoid)
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.dof_armature[:] = 0.0
    data = mujoco.MjData(model)
    assert [model.joint(i).name for i in range(1, model.njnt)] == list(humanoid.joint_names)
    fine = sweep.fine
    for k in range(0, fine.n_samples, 37):
        q, v, a = fine.q[k], fine.v[k], fine.a[k]
        rotation = pin.XYZQUATToSE3(q[:7]).rotation
        data.qpos[:3], data.qpos[3:7], data.qpos[7:] = q[:3], q[[6, 3, 4, 5]], q[7:]
        # MuJoCo's free joint: linear velocity of the origin in the world, angular velocity in the body.
        data.qvel[:] = np.concatenate([rotation @ v[:3], v[3:]])
        data.qacc[:] = np.concatenate([rotation @ (a[:3] + np.cross(v[3:6], v[:3])), a[3:]])
        mujoco.mj_inverse(model, data)
        force, moment = data.qfrc_inverse[:3], rotation @ data.qfrc_inverse[3:6]
        expected = np.concatenate([force, moment + np.cross(q[:3], force)])
        assert np.allclose(sweep.wrench[k], expected, atol=1e-6 * humanoid.mass * 9.81)
        assert np.allclose(sweep.dynamics.tau[k, 6:], data.qfrc_inverse[6:], atol=1e-6)
        zmp = np.array([-expected[4], expected[3]]) / expected[2]
        assert np.allclose(sweep.zmp[k], zmp, atol=1e-8)


def test_cart_table_zmp() -> None:
    """One mass at height h: ``p = x − h·ẍ/g`` (Kajita et al. 2003, eq. 5)."""
    mass, height, g, x, acceleration = 30.0, 0.7, 9.81, 0.12, 1.7
    force = mass * np.array([acceleration, 0.0, g])
    wrench = np.concatenate([force, np.cross([x, 0.0, height], force)])
    assert zero_moment_point(wrench[None])[0] == pytest.approx(
        [x - height * acceleration / g, 0.0], abs=1e-12
    )
    assert np.isnan(zero_moment_point(-wrench[None])).all()


# --- Support polygon


def test_polygon_margin_matches_qhull() -> None:
    rng = np.random.default_rng(1)
    corners, points = rng.normal(size=(200, 8, 2)), rng.normal(size=(200, 2))
    margin = polygon_margin(corners, points)
    for k in range(200):
        planes = ConvexHull(corners[k]).equations
        assert margin[k] == pytest.approx(-(planes[:, :2] @ points[k] + planes[:, 2]).max(), abs=1e-12)
    assert (margin > 0.0).any() and (margin < 0.0).any()


def test_polygon_margin_of_a_square_and_of_a_line() -> None:
    square = np.array([[[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.0], [0.0, 0.0]]], dtype=float)
    assert polygon_margin(square, np.array([[0.3, 0.5]])) == pytest.approx([0.3])
    assert polygon_margin(square, np.array([[1.2, 0.5]])) == pytest.approx([-0.2])
    line = np.array([[[0, 0], [1, 0], [2, 0]]], dtype=float)
    assert np.isnan(polygon_margin(line, np.array([[0.5, 0.0]]))).all()
    assert np.isnan(polygon_margin(square, np.array([[np.nan, 0.5]]))).all()


# --- Contact wrench cone


def random_case(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two feet at random, and a wrench in or out of their cone."""
    foot = np.array([[-0.05, 0.03, 0], [-0.05, -0.03, 0], [0.12, -0.03, 0], [0.12, 0.03, 0]])
    left, right = np.array([0.0, 0.1, 0.0]), np.array([rng.uniform(-0.2, 0.2), -0.1, 0.0])
    corners = np.vstack([foot + left, foot + right])
    point = np.array([rng.uniform(-0.06, 0.14), rng.uniform(-0.15, 0.15), 0.0])
    force = 300.0 * np.array([*rng.uniform(-0.5, 0.5, size=2), 1.0])
    wrench = np.concatenate([force, np.cross(point, force)])
    wrench[5] += rng.uniform(-15.0, 15.0)
    return wrench, corners, np.full(8, 0.6)


def test_contact_wrench_cone_matches_linear_programming() -> None:
    rng = np.random.default_rng(2)
    answers = []
    for _ in range(150):
        wrench, corners, friction = random_case(rng)
        edges = friction_edges(friction)
        columns = np.concatenate([edges, np.cross(corners[:, None], edges)], axis=2).reshape(-1, 6).T
        feasible = linprog(np.zeros(32), A_eq=columns, b_eq=wrench).status == 0
        shared = distribute_wrench(wrench[None], corners[None], friction)
        if RESIDUAL_TOLERANCE / 10.0 < shared.residual[0] < RESIDUAL_TOLERANCE * 10.0:
            continue
        assert bool(shared.residual[0] < RESIDUAL_TOLERANCE) is feasible
        answers.append(feasible)
    assert 20 < sum(answers) < len(answers) - 20, "both answers occur"


def test_distributed_forces_supply_the_wrench_and_stay_in_their_cones() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        wrench, corners, friction = random_case(rng)
        shared = distribute_wrench(wrench[None], corners[None], friction)
        forces = shared.forces[0]
        assert (np.linalg.norm(forces[:, :2], axis=1) <= friction * forces[:, 2] + 1e-9).all()
        if shared.residual[0] < 1e-4:
            total = np.concatenate([forces.sum(axis=0), np.cross(corners, forces).sum(axis=0)])
            assert np.allclose(total, wrench, atol=1e-3 * np.linalg.norm(wrench[:3]))


def test_distributed_forces_are_the_smallest_that_supply_the_wrench() -> None:
    rng = np.random.default_rng(4)
    for _ in range(50):
        wrench, corners, friction = random_case(rng)
        shared = distribute_wrench(wrench[None], corners[None], friction)
        edges, centre, size = friction_edges(friction), corners.mean(axis=0), np.linalg.norm(wrench[:3])
        arms = np.cross((corners - centre)[:, None], edges) / 0.1
        rays = np.concatenate([edges, arms], axis=2).reshape(-1, 6).T
        target = np.concatenate([wrench[:3], (wrench[3:] - np.cross(centre, wrench[:3])) / 0.1]) / size
        weights, _ = nnls(np.vstack([rays, 1e-2 * np.eye(32)]), np.concatenate([target, np.zeros(32)]))
        expected = size * np.einsum("me,mec->mc", weights.reshape(8, 4), edges)
        assert np.allclose(shared.forces[0], expected, atol=1e-6 * size)


def test_a_wrench_that_is_no_number_counts_as_not_supplied() -> None:
    wrench, corners, friction = random_case(np.random.default_rng(5))
    wrenches = np.tile(wrench, (3, 1))
    wrenches[1, 4] = np.nan
    shared = distribute_wrench(wrenches, np.tile(corners, (3, 1, 1)), friction)
    assert np.isinf(shared.residual[1])
    assert np.isfinite(shared.residual[[0, 2]]).all()


def test_distribution_is_continuous_in_time(humanoid: Robot, squatting: Motion) -> None:
    sweep = Sweep(humanoid, squatting)
    for part in sweep.contact_forces:
        assert np.abs(np.diff(part.forces, axis=0)).max() < 0.02 * humanoid.mass * 9.81
