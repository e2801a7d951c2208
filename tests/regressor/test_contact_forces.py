"""Contact forces taken out of the joints' equations, against forward dynamics with forces that are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.columns import measured_columns, regressor_rows
from excite.regressor.contact_forces import contact_elimination, contact_maps, stance_flags
from excite.robot.robot import Foot, Robot
from tests.quadruped import quadruped


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return quadruped(tmp_path_factory.mktemp("toy"))


def _touching(robot: Robot, data: pin.Data, foot: Foot) -> np.ndarray:
    """World positions of the points at which a foot touches the ground."""
    pose = data.oMi[foot.joint]
    points = np.array([pose.act(corner) for corner in foot.sole])
    if foot.radius:
        middle = pose.act(foot.sole[0] + foot.radius * foot.placement.rotation[:, 2])
        points = np.array([middle - [0.0, 0.0, foot.radius]])
    return points


def _moved(robot: Robot, flags: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, ...]:
    """A state, joint torques, and the acceleration that they and random contact forces give."""
    model, data = robot.model, robot.model.createData()
    q = pin.integrate(model, robot.rest, 0.3 * random.normal(size=model.nv))
    v, tau = random.normal(size=model.nv), 20.0 * random.normal(size=robot.n_joints)
    pin.forwardKinematics(model, data, q)
    forces = [pin.Force.Zero() for _ in range(model.njoints)]
    for foot, on in zip(robot.feet, flags, strict=True):
        for point in _touching(robot, data, foot) if on else ():
            force = random.normal(size=3) * 50.0
            world = pin.Force(force, np.cross(point, force))
            forces[foot.joint] += data.oMi[foot.joint].actInv(world)
    listed = pin.StdVec_Force()
    listed.extend(forces)
    a = pin.aba(model, data, q, v, np.r_[np.zeros(6), tau], listed)
    return q, v, a, tau


@pytest.mark.parametrize("name", ["toy", "g1"])
def test_rows_hold_whatever_the_contact_forces_are(name: str, request: pytest.FixtureRequest) -> None:
    robot: Robot = request.getfixturevalue(name)
    random = np.random.default_rng(0)
    closed = stance_flags(robot, 12)
    drawn = [_moved(robot, flags, random) for flags in closed]
    q, v, a, tau = (np.array([state[i] for state in drawn]) for i in range(4))
    out = contact_elimination(robot, q, closed)
    forces = np.array(
        [pin.rnea(robot.model, robot.model.createData(), *row) for row in zip(q, v, a, strict=True)]
    )
    predicted = np.einsum("nij,nj->ni", out, forces)
    measured = np.einsum("nij,nj->ni", out[:, :, 6:], tau)
    assert np.abs(predicted - measured).max() < 1e-9 * np.abs(forces).max()
    # They say something: without the elimination the joints' rows are off by the contact forces.
    assert np.abs(forces[:, 6:] - tau).max() > 10.0
    assert np.abs(measured).max() > 1.0


def test_rank_is_what_contacts_cannot_exert_against_each_other(toy: Robot) -> None:
    """Three forces a foot, less the six that the base's equations give; of two feet these are but five."""
    q = np.array([toy.rest])
    for down, lost in ((4, 6), (3, 3), (2, 1), (1, 0), (0, 0)):
        closed = np.array([[i < down for i in range(4)]])
        out = contact_elimination(toy, q, closed)[0, :, 6:]
        assert np.linalg.matrix_rank(out, tol=1e-9) == 12 - lost


def test_in_the_air_the_joints_rows_stay_as_they_are(toy: Robot) -> None:
    out = contact_elimination(toy, np.array([toy.rest]), np.zeros((1, 4), dtype=bool))[0]
    assert np.array_equal(out, np.hstack([np.zeros((12, 6)), np.eye(12)]))


def test_a_ball_is_touched_where_it_is_lowest(toy: Robot) -> None:
    q = toy.rest.copy()
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.3, -0.2, 0.0)).coeffs()
    data = toy.model.createData()
    pin.forwardKinematics(toy.model, data, q)
    foot = toy.feet[0]
    maps = contact_maps(toy, q[None], [foot])[0]
    arm = pin.XYZQUATToSE3(q[:7]).actInv(_touching(toy, data, foot)[0])
    assert np.allclose(maps[3:6], pin.skew(arm) @ maps[:3], atol=1e-12)


def test_regressor_of_a_quadruped_is_that_of_its_projected_dynamics(toy: Robot) -> None:
    random = np.random.default_rng(1)
    closed = stance_flags(toy, 8)
    drawn = [_moved(toy, flags, random) for flags in closed]
    q, v, a, tau = (np.array([state[i] for state in drawn]) for i in range(4))
    columns = measured_columns(toy, ("viscous",))
    rows = regressor_rows(toy, columns, q, v, a, closed)
    friction = 0.1
    theta = np.r_[toy.nominal_parameters, np.full(12, friction)]
    out = contact_elimination(toy, q, closed)[:, :, 6:]
    expected = np.einsum("nij,nj->ni", out, tau + friction * v[:, 6:])
    assert np.allclose(np.einsum("nij,j->ni", rows, theta), expected, atol=1e-8)


def test_total_mass_is_among_the_base_parameters(toy: Robot) -> None:
    base = structural_base_parameters(toy)
    total = np.array([name.startswith("m(") for name in base.names], dtype=float)
    weights = np.linalg.lstsq(base.matrix.T, total, rcond=None)[0]
    assert np.allclose(base.matrix.T @ weights, total, atol=1e-9)


def test_hung_up_it_keeps_its_joints_rows(tmp_path: Path) -> None:
    robot = quadruped(tmp_path, "suspended")
    out = contact_elimination(robot, np.array([robot.rest]), np.zeros((1, 0), dtype=bool))[0]
    assert np.array_equal(out[:, 6:], np.eye(12))
