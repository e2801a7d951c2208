"""Kernels against pinocchio and, for one robot, MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError, RobotError
from excite.regressor.kernels import (
    base_link_regressor,
    forward_kinematics,
    inverse_dynamics,
    joint_torque_regressor,
)
from excite.regressor.tree import read_tree
from tests.regressor.conftest import Sampled, odd_tree, panda_arm, sample


def relative(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.abs(found - truth).max() / np.abs(truth).max())


def test_joint_torque_regressor_is_pinocchios(sampled: Sampled) -> None:
    model, data = sampled.model, sampled.model.createData()
    found = joint_torque_regressor(model, sampled.q, sampled.v, sampled.a)
    truth = np.array(
        [
            pin.computeJointTorqueRegressor(model, data, q, v, a)
            for q, v, a in zip(sampled.q, sampled.v, sampled.a, strict=True)
        ]
    )
    assert found.shape == truth.shape
    assert relative(found, truth) < 1e-12


def test_base_rows_are_the_first_six_of_a_floating_robot(sampled: Sampled) -> None:
    tree = read_tree(sampled.model)
    rows = base_link_regressor(tree, sampled.q, sampled.v, sampled.a)
    if tree.floating:
        whole = joint_torque_regressor(tree, sampled.q, sampled.v, sampled.a)
        assert relative(rows, whole[:, :6]) < 1e-13
    else:
        # Wrench on all bodies = rate of their momentum, less gravity; moment about the world's origin.
        model, data = sampled.model, sampled.model.createData()
        truth = []
        for q, v, a in zip(sampled.q, sampled.v, sampled.a, strict=True):
            pin.computeCentroidalMomentumTimeVariation(model, data, q, v, a)
            force = data.dhg.linear - data.mass[0] * model.gravity.linear
            truth.append(np.concatenate([force, data.dhg.angular + np.cross(data.com[0], force)]))
        assert relative(rows @ tree.phi, np.array(truth)) < 1e-12


def test_inverse_dynamics_is_pinocchios_and_the_regressors(sampled: Sampled) -> None:
    model, data = sampled.model, sampled.model.createData()
    found = inverse_dynamics(model, sampled.q, sampled.v, sampled.a)
    truth = np.array(
        [pin.rnea(model, data, q, v, a) for q, v, a in zip(sampled.q, sampled.v, sampled.a, strict=True)]
    )
    assert relative(found, truth) < 1e-12
    phi = np.random.default_rng(1).normal(size=10 * (model.njoints - 1))
    other = inverse_dynamics(model, sampled.q, sampled.v, sampled.a, phi)
    rows = joint_torque_regressor(model, sampled.q, sampled.v, sampled.a)
    assert relative(other, rows @ phi) < 1e-12


def test_forward_kinematics(sampled: Sampled) -> None:
    model, data = sampled.model, sampled.model.createData()
    poses = forward_kinematics(model, sampled.q)
    corners = np.array([[0.1, 0.2, 0.3], [-0.4, 0.5, 0.0]])
    points = poses.point(model.njoints - 1, corners)
    for i, q in enumerate(sampled.q):
        pin.forwardKinematics(model, data, q)
        truth = np.array([pose.homogeneous for pose in data.oMi])
        np.testing.assert_allclose(poses.rotation[i], truth[:, :3, :3], atol=1e-12)
        np.testing.assert_allclose(poses.translation[i], truth[:, :3, 3], atol=1e-11)
        np.testing.assert_allclose(
            points[i], [data.oMi[model.njoints - 1].act(c) for c in corners], atol=1e-11
        )


def test_inverse_dynamics_is_mujocos() -> None:
    model = panda_arm()
    spec = mujoco.MjSpec()
    spec.option.gravity = model.gravity.linear
    bodies = {0: spec.worldbody}
    for j in range(1, model.njoints):
        pose, inertia = model.jointPlacements[j], model.inertias[j]
        body = bodies[model.parents[j]].add_body(
            pos=pose.translation,
            quat=np.roll(pin.Quaternion(pose.rotation).coeffs(), 1),
            mass=inertia.mass,
            ipos=inertia.lever,
            fullinertia=inertia.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]],
            explicitinertial=True,
        )
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        bodies[j] = body
    twin = spec.compile()
    data = mujoco.MjData(twin)
    samples = sample(model, 20)
    truth = np.empty_like(samples.v)
    for i in range(len(truth)):
        data.qpos, data.qvel, data.qacc = samples.q[i], samples.v[i], samples.a[i]
        mujoco.mj_inverse(twin, data)
        truth[i] = data.qfrc_inverse
    assert relative(inverse_dynamics(model, samples.q, samples.v, samples.a), truth) < 1e-9


def test_results_do_not_depend_on_the_number_of_samples_a_call(sampled: Sampled) -> None:
    whole = base_link_regressor(sampled.model, sampled.q, sampled.v, sampled.a)
    part = base_link_regressor(sampled.model, sampled.q[70:71], sampled.v[70:71], sampled.a[70:71])
    np.testing.assert_array_equal(whole[70], part[0])


def test_out_is_filled_and_checked() -> None:
    model = odd_tree(root=True)
    s = sample(model, 5)
    out = np.full((5, model.nv, 10 * (model.njoints - 1)), np.nan)
    assert joint_torque_regressor(model, s.q, s.v, s.a, out) is out
    np.testing.assert_array_equal(out, joint_torque_regressor(model, s.q, s.v, s.a))
    with pytest.raises(InputError, match="out has shape"):
        base_link_regressor(model, s.q, s.v, s.a, out)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: (s.q[:, :-1], s.v, s.a), "q has shape"),
        (lambda s: (s.q, s.v[0], s.a), "v has shape"),
        (lambda s: (s.q, s.v, s.a[:2]), "samples"),
    ],
)
def test_wrong_shapes_are_refused(change, message: str) -> None:
    s = sample(panda_arm(), 4)
    with pytest.raises(InputError, match=message):
        inverse_dynamics(s.model, *change(s))
    with pytest.raises(InputError, match="phi has shape"):
        inverse_dynamics(s.model, s.q, s.v, s.a, np.zeros(3))


def test_unsupported_joints_are_named() -> None:
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    with pytest.raises(RobotError, match=r"'ball' is of kind JointModelSpherical"):
        read_tree(model)
    model = pin.Model()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "hinge")
    model.addJoint(1, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "loose")
    with pytest.raises(RobotError, match="'loose' is a free-flyer"):
        read_tree(model)
