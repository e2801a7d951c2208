"""An arm that stands: encoders that tremble by a step are no motion, and no reading of channels ends in an error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.doctor.examine import examine
from excite.doctor.inertial_prior import LikelyBodies
from excite.regressor.kernels import inverse_dynamics
from excite.regressor.tree import read_tree
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log, changed

STEP = 2.0 * np.pi / 2**13


def _trembling(q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.asarray(STEP * np.round(q[:1] / STEP + rng.integers(-2, 3, q.shape)))


def test_trembling_encoders_are_no_motion() -> None:
    robot, rng = load_robot("panda"), np.random.default_rng(1)
    standing = changed(arm_log(robot), lambda trial: replace(trial, q=_trembling(trial.q, rng)))
    chart = examine(robot, standing)
    assert [f.kind for f in chart.findings if f.severity == "fatal"] == ["nothing_moves"]


@pytest.mark.parametrize("fast", [1.0, 1e9])
def test_what_likely_bodies_leave_of_accelerations_of_any_size(fast: float) -> None:
    """The reading of a standing arm with a clock in nanoseconds, as the error of a factorisation had it."""
    robot, rng = load_robot("panda"), np.random.default_rng(2)
    tree, n = read_tree(robot.model), robot.n_joints
    q, torque = np.full((200, n), 0.5), 0.01 * rng.standard_normal((200, n))
    v, a = fast * rng.standard_normal((200, n)), fast**2 * rng.standard_normal((200, n))
    nominal = inverse_dynamics(tree, q, v, a)
    left = LikelyBodies.of(tree).left(tree, (q, v, a), np.arange(n), torque, nominal, np.full(n, 0.01))
    assert np.isfinite(left).all()
