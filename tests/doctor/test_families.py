"""Many readings from a few motions are what each is by itself; shares are those of scipy's bounded least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from excite.doctor.channel_mapping import Reading
from excite.doctor.model_comparison import WIDTH, Columns, drive_columns, shares_left
from excite.doctor.torque_samples import TorqueSamples, torque_samples
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log


@pytest.fixture(scope="module")
def samples() -> TorqueSamples:
    panda = load_robot("panda")
    found = torque_samples(panda, arm_log(panda))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def reading() -> Reading:
    panda = load_robot("panda")
    stated = Reading.as_stated(arm_log(panda))
    return replace(stated.with_position(1, zero=0.3), gravity=np.array([1.0, -2.0, -9.0]))


@pytest.mark.parametrize("joint", [0, 1, 3, 6])
def test_torques_follow_a_joints_zero(samples: TorqueSamples, reading: Reading, joint: int) -> None:
    angles = np.array([0.0, -2.9, -0.4, 0.123, 1.57, 3.0])
    one_by_one = [samples.left(reading.with_position(joint, zero=float(angle))) for angle in angles]
    np.testing.assert_allclose(samples.by_zero(reading, joint)(angles), one_by_one, atol=1e-9)


def test_torques_follow_gravity(samples: TorqueSamples, reading: Reading) -> None:
    pulls = 9.81 * np.array([[0.0, 0.0, -1.0], [0.6, 0.0, 0.8], [0.0, -1.0, 0.0]])
    one_by_one = [samples.left(replace(reading, gravity=pull)) for pull in pulls]
    np.testing.assert_allclose(samples.by_gravity(reading)(pulls), one_by_one, atol=1e-9)


@pytest.mark.parametrize("factor", [0.1, 0.9, 1.0, 4.0])
def test_torques_follow_the_clock(samples: TorqueSamples, reading: Reading, factor: float) -> None:
    slow = replace(reading, tick=1.3)
    alone = samples.left(replace(slow, tick=1.3 * factor))
    np.testing.assert_allclose(samples.by_clock(slow)(np.array([factor]))[0], alone, atol=1e-9)


def test_shares_are_those_of_bounded_least_squares() -> None:
    rng = np.random.default_rng(3)
    model, v, a, noise = rng.normal(size=(4, 200, 40))
    weights = rng.normal(size=(4, 40))
    torque = (
        weights[0] * model + weights[1] * v + weights[2] * np.tanh(v / WIDTH) + weights[3] * a + 0.3 * noise
    )
    torque[:, 0] = 2.0
    found = shares_left(Columns.of(drive_columns(v, a), model).sums_with(torque))
    for j in range(40):
        columns = np.column_stack([model[:, j], v[:, j], np.tanh(v[:, j] / WIDTH), a[:, j]])
        columns, y = columns - columns.mean(axis=0), torque[:, j] - torque[:, j].mean()
        bounds = (np.array([0.5, 0.0, 0.0, 0.0]), np.array([2.0, np.inf, np.inf, np.inf]))
        best = lsq_linear(columns, y, bounds, tol=1e-12)
        assert found[j] == pytest.approx(2.0 * best.cost / (y @ y) if y @ y else 1.0, rel=1e-6)
