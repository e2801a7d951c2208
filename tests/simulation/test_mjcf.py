"""The MuJoCo model against pinocchio."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from excite.arrays import Array
from excite.errors import InputError
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.simulation.coordinates import motion_from_mujoco, position_from_mujoco, position_to_mujoco
from excite.simulation.mjcf import World, build_spec
from excite.simulation.true_parameters import (
    UnphysicalParametersError,
    box_parameters,
    nominal_drives,
    principal_inertia,
    scattered_parameters,
)
from tests.simulation.motions import generator

pytestmark = pytest.mark.usefixtures("readers_here")

ROBOTS = ("g1", "panda", "ur10", "iiwa14", "talos", "human")


def _frictionless(robot: Robot, phi: Array) -> mujoco.MjModel:
    model = build_spec(robot, phi, nominal_drives(robot), World()).compile()
    model.dof_damping[:] = 0.0
    model.dof_armature[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    for flag in ("CONTACT", "LIMIT", "ACTUATION"):
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    return model


@pytest.mark.parametrize("name", ROBOTS)
def test_inverse_dynamics_equals_recursive_newton_euler(name: str) -> None:
    robot, rng = load_robot(name), generator(1)
    phi = scattered_parameters(robot, rng, scatter=0.1).phi
    massive = phi[::10].all()
    model, reference = _frictionless(robot, phi), robot.model.copy()
    for joint in range(1, reference.njoints):
        if phi[10 * (joint - 1)] > 0.0:
            reference.inertias[joint] = pin.Inertia.FromDynamicParameters(phi[10 * (joint - 1) : 10 * joint])
    data, pin_data = mujoco.MjData(model), reference.createData()
    assert model.body_mass.sum() == pytest.approx(phi[::10].sum(), abs=1e-6)
    for _ in range(5):
        q = robot.rest.copy()
        q[robot.n_base_q :] = rng.uniform(robot.limits.position_lower, robot.limits.position_upper)
        if robot.floating:
            q[:3], q[3:7] = rng.normal(size=3), pin.Quaternion(pin.exp3(rng.normal(size=3))).coeffs()
        qvel, qacc = rng.normal(size=model.nv), 5.0 * rng.normal(size=model.nv)
        v, a = motion_from_mujoco(q[None], qvel[None], qacc[None], floating=robot.floating)
        expected = pin.rnea(reference, pin_data, q, v[0], a[0])
        data.qpos[:], data.qvel[:], data.qacc[:] = position_to_mujoco(q, floating=robot.floating), qvel, qacc
        mujoco.mj_inverse(model, data)
        force = data.qfrc_inverse.copy()
        if robot.floating:
            force[:3] = pin.Quaternion(q[3:7]).matrix().T @ force[:3]
        np.testing.assert_allclose(force, expected, atol=1e-8 if massive else 1e-5)


def test_positions_survive_the_way_to_mujoco_and_back(g1: Robot) -> None:
    q = pin.integrate(g1.model, g1.rest, generator(2).normal(size=g1.model.nv))
    back = position_from_mujoco(position_to_mujoco(q, floating=True)[None], floating=True)[0]
    np.testing.assert_array_equal(back, q)


def test_the_soles_lowest_points_are_the_corners(g1: Robot) -> None:
    model = build_spec(g1, g1.nominal_parameters, nominal_drives(g1), World()).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = position_to_mujoco(g1.rest, floating=True)
    mujoco.mj_kinematics(model, data)
    pin_data = g1.model.createData()
    pin.forwardKinematics(g1.model, pin_data, g1.rest)
    for foot in g1.feet:
        for number, corner in enumerate(foot.sole):
            geom = model.geom(f"{foot.name}.sole.{number}").id
            lowest = data.geom_xpos[geom] - np.array([0.0, 0.0, model.geom_size[geom, 0]])
            np.testing.assert_allclose(lowest, pin_data.oMi[foot.joint].act(corner), atol=1e-12)


def test_box_parameters_match_the_textbook() -> None:
    body = pin.Inertia.FromDynamicParameters(
        box_parameters(3.0, np.array([0.1, 0.2, 0.3]), np.array([0.2, 0.4, 0.6]))
    )
    np.testing.assert_allclose(body.lever, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(np.diag(body.inertia), [0.13, 0.10, 0.05])


def test_principal_axes_rebuild_the_inertia(g1: Robot) -> None:
    for segment in g1.segments:
        phi = g1.nominal_parameters[g1.parameter_columns(segment.joint - 1)]
        body = principal_inertia(phi, segment.name)
        about_com = body.rotation @ np.diag(body.moments) @ body.rotation.T
        rebuilt = pin.Inertia(body.mass, body.com, about_com).toDynamicParameters()
        np.testing.assert_allclose(rebuilt, phi, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda phi: phi.__setitem__(0, -1.0), "mass is -1"),
        (lambda phi: phi.__setitem__(0, np.nan), "not finite"),
        (lambda phi: phi.__setitem__(4, -5.0), "principal moment"),
        (lambda phi: phi.__setitem__(9, phi[9] + 5.0), "exceeds the sum"),
    ],
)
def test_unphysical_parameters_are_refused_by_segment(g1: Robot, change, message: str) -> None:
    phi = g1.nominal_parameters.copy()
    change(phi[10 * 15 : 10 * 16])
    with pytest.raises(UnphysicalParametersError, match=message) as caught:
        build_spec(g1, phi, nominal_drives(g1), World()).compile()
    assert caught.value.segment == g1.segments[15].name


def test_parameters_of_another_robot_are_refused(g1: Robot) -> None:
    with pytest.raises(InputError, match="ten parameters per segment"):
        build_spec(g1, g1.nominal_parameters[:-10], nominal_drives(g1), World()).compile()
