"""What any motion could excite, within limits and contacts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import InputError
from excite.excitation.precision import _random_state, determined_columns, excitable_parameters
from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.kernels import forward_kinematics
from excite.robot.robot import Robot


def with_locked(robot: Robot, joint: str) -> Robot:
    """The robot with one joint without range."""
    index = robot.joint_index(joint)
    upper = robot.limits.position_upper.copy()
    upper[index] = robot.limits.position_lower[index]
    return replace(robot, limits=replace(robot.limits, position_upper=upper))


def test_with_a_foot_on_the_ground_everything_that_free_motion_shows_can_be_shown(g1: Robot) -> None:
    base = structural_base_parameters(g1)
    assert excitable_parameters(g1, base).all()


def test_a_joint_without_range_hides_its_own_parameters_and_no_others(panda: Robot) -> None:
    base, last = structural_base_parameters(panda), panda.joint_names[-1]
    hidden = {
        name
        for name, able in zip(base.labels, excitable_parameters(with_locked(panda, last), base), strict=True)
        if not able
    }
    assert {f"viscous({last})", f"coulomb({last})"} <= hidden
    assert all(panda.segments[-1].name in name or last in name for name in hidden)
    assert excitable_parameters(panda, base).all()


def test_random_states_keep_the_foot_still_and_flat(g1: Robot) -> None:
    foot, random = g1.feet[1], np.random.default_rng(0)
    q, v, a = _random_state(g1, foot, random)
    h = 1e-4
    import pinocchio as pin

    def sole(time: float) -> np.ndarray:
        at = pin.integrate(g1.model, q, v * time + 0.5 * a * time**2)
        return forward_kinematics(g1.model, at[None]).point(foot.joint, foot.placement.translation)[0]

    np.testing.assert_allclose(sole(0.0), 0.0, atol=1e-12)
    assert np.linalg.norm(sole(h) - sole(-h)) / (2.0 * h) < 1e-5
    data = g1.model.createData()
    pin.forwardKinematics(g1.model, data, q, v, a)
    np.testing.assert_allclose(data.v[foot.joint].vector, 0.0, atol=1e-10)
    np.testing.assert_allclose(data.a[foot.joint].vector, 0.0, atol=1e-8)
    np.testing.assert_allclose((data.oMi[foot.joint] * foot.placement).rotation, np.eye(3), atol=1e-12)


def test_determined_columns() -> None:
    rows = np.random.default_rng(0).normal(size=(20, 3))
    factor = np.column_stack([rows, np.zeros(20), 1e6 * rows[:, 0]])
    assert determined_columns(factor, 1e-8).tolist() == [False, True, True, False, False]


def test_base_parameters_of_another_robot(panda: Robot, g1: Robot) -> None:
    with pytest.raises(InputError, match="other columns"):
        excitable_parameters(g1, structural_base_parameters(panda))
