"""Where a model goes under measured forces: forward dynamics of pinocchio go there, too."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from excite.arrays import Array, Moved
from excite.identification.problem import IdentificationProblem
from excite.identification.rollout import HORIZON_S, model_departures
from excite.regressor.kernels import base_link_regressor, joint_torque_regressor
from excite.robot.loading import load_robot
from excite.robot.robot import Robot

RATE = 1000.0


@pytest.fixture(scope="module")
def panda() -> Robot:
    return load_robot("panda")


def moving(robot: Robot, seconds: float = 0.5) -> tuple[Array, Array, Array, Array]:
    """Time, q, v, a of joints that swing about their rest; a base of its own stands."""
    time = np.arange(round(seconds * RATE) + 1) / RATE
    rate = 3.0 + 0.3 * np.arange(robot.n_joints)
    phase = np.outer(time, rate) + np.arange(robot.n_joints)
    q = np.tile(robot.rest, (len(time), 1))
    v, a = np.zeros((len(time), robot.model.nv)), np.zeros((len(time), robot.model.nv))
    q[:, robot.n_base_q :] += 0.3 * np.sin(phase)
    v[:, robot.n_base_v :] = 0.3 * rate * np.cos(phase)
    a[:, robot.n_base_v :] = -0.3 * rate**2 * np.sin(phase)
    return time, q, v, a


def problem_of(
    robot: Robot, rows: Array, true: Array, time: Array, names: tuple[str, ...]
) -> IdentificationProblem:
    """Rows of a trial of a robot whose parameters are others than its model's."""
    n, width, n_params = rows.shape
    return IdentificationProblem(
        robot=robot,
        Y=rows.reshape(-1, n_params),
        y=(rows @ true).ravel(),
        weights=np.ones(n * width),
        channel=np.tile(np.arange(width), n),
        channel_names=names,
        channel_units=("N·m",) * width,
        time=np.repeat(time, width),
        trial=np.zeros(n * width, dtype=np.int64),
        trial_names=("one",),
        parameter_names=tuple(f"{segment.link}.{k}" for segment in robot.segments for k in range(10)),
        prior=robot.nominal_parameters,
        n_inertial=n_params,
        noise_bandwidth=1.0,
    )


def with_payload(robot: Robot, mass: float) -> Array:
    """The nominal parameters with a ball in the hand."""
    true = robot.nominal_parameters.copy()
    true[-10:] += pin.Inertia.FromSphere(mass, 0.04).toDynamicParameters()
    return true


def test_an_arm_goes_where_forward_dynamics_take_it(panda: Robot) -> None:
    time, q, v, a = moving(panda)
    true, model = with_payload(panda, 0.3), panda.model
    problem = problem_of(panda, joint_torque_regressor(model, q, v, a), true, time, panda.joint_names)
    found = model_departures(problem, panda.nominal_parameters, time, Moved(q, v, a))
    assert found is not None

    model = model.copy()
    model.armature = np.zeros(model.nv)
    torque, data, stretch = problem.y.reshape(len(time), -1), model.createData(), round(HORIZON_S * RATE)
    at, speed, apart = q[0].copy(), v[0].copy(), np.zeros_like(q)
    for k in range(len(time) - 1):
        if k % stretch == 0:
            at, speed = q[k].copy(), v[k].copy()
        apart[k] = at - q[k]
        now = pin.aba(model, data, at, speed, torque[k])
        middle = pin.aba(
            model, data, at + 0.5 * speed / RATE, speed + 0.5 * now / RATE, torque[k : k + 2].mean(axis=0)
        )
        at, speed = at + speed / RATE + 0.5 * middle / RATE**2, speed + middle / RATE
    ends = np.arange(stretch - 1, len(time) - 1, stretch)
    assert np.abs(apart[ends]).max() > 0.01
    np.testing.assert_allclose(found[ends], apart[ends], atol=0.01 * np.abs(apart[ends]).max())
    np.testing.assert_allclose(model_departures(problem, true, time, Moved(q, v, a)), 0.0, atol=1e-9)


def test_the_base_of_a_standing_robot_falls_as_fast_as_the_ground_lacks_force(g1: Robot) -> None:
    time, q, v, a = moving(g1)
    v[:], a[:], q[:] = 0.0, 0.0, g1.rest
    heavy = 1.1 * g1.nominal_parameters
    rows = base_link_regressor(g1.model, q, v, a)
    problem = problem_of(g1, rows, g1.nominal_parameters, time, ("fx", "fy", "fz", "tx", "ty", "tz"))
    found = model_departures(problem, heavy, time, Moved(q, v, a))
    assert found is not None
    # A body that weighs a tenth more than the ground carries falls with an eleventh of g.
    end = round(HORIZON_S * RATE) - 1
    fallen = -0.5 * 9.81 / 11.0 * time[end] ** 2
    np.testing.assert_allclose(found[end, :3], [0.0, 0.0, fallen], rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(found[:, 6:], 0.0)


def test_rows_that_are_missing_leave_the_record_as_it_is(panda: Robot) -> None:
    time, q, v, a = moving(panda)
    rows = joint_torque_regressor(panda.model, q, v, a)
    kept = (time < 0.22) | (time > 0.28)
    problem = problem_of(panda, rows[kept], with_payload(panda, 0.3), time[kept], panda.joint_names)
    found = model_departures(problem, panda.nominal_parameters, time, Moved(q, v, a))
    assert found is not None
    stretch = (time / HORIZON_S + 1e-9).astype(int)
    assert not found[stretch == 2].any()
    assert all(np.abs(found[stretch == k]).max() > 0.0 for k in (0, 1, 3, 4))


@pytest.mark.parametrize("mass", [0.0, -1.0])
def test_parameters_of_no_bodies_go_nowhere(panda: Robot, mass: float) -> None:
    time, q, v, a = moving(panda, 0.2)
    problem = problem_of(
        panda, joint_torque_regressor(panda.model, q, v, a), panda.nominal_parameters, time, panda.joint_names
    )
    wrong = panda.nominal_parameters.copy()
    wrong[10] = mass
    assert model_departures(problem, wrong, time, Moved(q, v, a)) is None
