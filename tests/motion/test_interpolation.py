"""A motion between its samples, against pinocchio's steps on SE(3) and a polynomial that is fitted to both ends."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from excite import load_robot
from excite.errors import MotionError
from excite.motion.motion import Motion, base_steps, interpolate_motion, moved_bases
from excite.robot.robot import Robot


@pytest.fixture(scope="module", params=["go2", "panda"])
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


@pytest.fixture(scope="module")
def tumbling(robot: Robot) -> Motion:
    """Random states, turned about any axis."""
    rng, n = np.random.default_rng(5), 40
    time = np.cumsum(rng.uniform(0.01, 0.3, n))
    ends = np.full(robot.model.nq, 2.0)
    q = np.array([pin.randomConfiguration(robot.model, -ends, ends) for _ in time])
    v, a = rng.normal(size=(n, robot.model.nv)), 20.0 * rng.normal(size=(n, robot.model.nv))
    return Motion("tumbling", robot.name, robot.joint_names, time, q, v, a)


def fitted(h: float, step: np.ndarray, ends: list[np.ndarray]) -> np.ndarray:
    """Coefficients ``(6, nv)``, lowest first, of the quintic through 0 and ``step`` with rates at both ends."""
    order = np.arange(6)
    rows = []
    for at in (0.0, h):
        rows.append(at**order)
        rows.append(np.where(order > 0, order * at ** np.maximum(order - 1, 0), 0.0))
        rows.append(np.where(order > 1, order * (order - 1) * at ** np.maximum(order - 2, 0), 0.0))
    v0, a0, v1, a1 = ends
    return np.linalg.solve(np.array(rows), np.array([0.0 * step, v0, a0, step, v1, a1]))


def test_between_samples_a_motion_follows_quintics_of_pinocchio_s_steps(
    robot: Robot, tumbling: Motion
) -> None:
    time = np.sort(np.random.default_rng(6).uniform(tumbling.time[0], tumbling.time[-1], 200))
    found = interpolate_motion(tumbling, robot, time)
    for i, t in enumerate(time):
        k = int(np.searchsorted(tumbling.time, t, side="right")) - 1
        h, s = tumbling.time[k + 1] - tumbling.time[k], t - tumbling.time[k]
        step = pin.difference(robot.model, tumbling.q[k], tumbling.q[k + 1])
        ends = [tumbling.v[k], tumbling.a[k], tumbling.v[k + 1], tumbling.a[k + 1]]
        way = np.polynomial.Polynomial
        lines = [way(column) for column in fitted(h, step, ends).T]
        q = pin.integrate(robot.model, tumbling.q[k], np.array([line(s) for line in lines]))
        assert np.allclose(pin.difference(robot.model, q, found.q[i]), 0.0, atol=1e-9)
        assert np.allclose(found.v[i], [line.deriv()(s) for line in lines], atol=1e-7)
        assert np.allclose(found.a[i], [line.deriv(2)(s) for line in lines], atol=1e-5)


def test_at_its_own_samples_a_motion_is_what_it_was(robot: Robot, tumbling: Motion) -> None:
    found = interpolate_motion(tumbling, robot, tumbling.time)
    for one, other in zip(found.q, tumbling.q, strict=True):
        assert np.allclose(pin.difference(robot.model, one, other), 0.0, atol=1e-8)
    assert np.allclose(found.v, tumbling.v, atol=1e-8) and np.allclose(found.a, tumbling.a, atol=1e-8)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 9.9e-4, 1.01e-3, 0.1, 1.0, 3.1])
def test_a_base_s_step_is_pinocchio_s(angle: float) -> None:
    model, rng = pin.Model(), np.random.default_rng(7)
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    for _ in range(20):
        start, step = pin.randomConfiguration(model, -np.ones(7), np.ones(7)), rng.normal(size=6)
        step[3:] *= angle / np.linalg.norm(step[3:])
        end, pose = pin.integrate(model, start, step), moved_bases(start[None], step[None])[0]
        assert np.allclose(base_steps(start[None], end[None])[0], step, atol=1e-12)
        assert np.allclose(pin.difference(model, pose, end), 0.0, atol=1e-12)
        # The same turn, written with its signs the other way round.
        other = np.r_[end[:3], -end[3:]]
        assert np.allclose(base_steps(start[None], other[None])[0], step, atol=1e-12)


def test_another_robot_s_motion_is_refused(robot: Robot, tumbling: Motion) -> None:
    with pytest.raises(MotionError, match="moves other joints than iiwa14"):
        interpolate_motion(tumbling, load_robot("iiwa14"), tumbling.time)
