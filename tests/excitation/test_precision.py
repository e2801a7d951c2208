"""Noise of a sample's rows against random draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import InputError
from excite.excitation.precision import row_noise
from excite.regressor.columns import base_wrench
from excite.robot.robot import Robot


def test_noise_of_a_humanoids_rows_is_that_of_its_sensors(g1: Robot) -> None:
    random, n = np.random.default_rng(1), 20_000
    readings = {
        s.name: random.normal(size=(n, 6)) * np.repeat([s.noise_force, s.noise_moment], 3) for s in g1.sensors
    }
    drawn = base_wrench(g1, np.tile(g1.rest, (n, 1)), readings).std(axis=0)
    np.testing.assert_allclose(row_noise(g1), drawn, rtol=0.03)


def test_an_arm_without_stated_noise_is_refused(panda: Robot) -> None:
    silent = panda.description.model_copy(
        update={"sensors": panda.description.sensors.model_copy(update={"noise_torque": None})}
    )
    with pytest.raises(InputError, match="no noise of joint"):
        row_noise(replace(panda, description=silent))
