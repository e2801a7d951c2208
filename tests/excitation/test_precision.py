"""Predicted standard deviations against formulae and random draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import InputError
from excite.excitation.conditioning import motion_factor
from excite.excitation.precision import predicted_std, row_noise
from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.columns import base_wrench, measured_columns, regressor_rows
from excite.robot.robot import Robot
from tests.excitation.conftest import sines


def test_predicted_std_is_that_of_weighted_least_squares_with_noisy_torques(panda: Robot) -> None:
    rate = panda.description.sensors.rate_hz
    noise, base, motion = row_noise(panda), structural_base_parameters(panda), sines(panda, "motion", 0)
    predicted = predicted_std(panda, motion_factor(panda, motion, 50.0, row_std=noise), base)
    log = motion.resampled(panda, rate)
    rows = regressor_rows(panda, measured_columns(panda), log.q, log.v, log.a)[:, :, base.independent]
    rows = (rows / noise[:, None]).reshape(-1, base.rank)
    errors = np.random.default_rng(0).normal(size=(len(rows), 400))
    drawn = np.linalg.lstsq(rows, errors, rcond=None)[0].std(axis=1)
    # 400 draws know a standard deviation to 3.5 %; sampling at 50 Hz rather than the log rate adds a little.
    np.testing.assert_allclose(predicted, drawn, rtol=0.2)
    assert np.median(predicted / drawn) == pytest.approx(1.0, abs=0.03)
    bound = predicted_std(panda, motion_factor(panda, motion, 50.0), base)
    assert (bound >= predicted * (1.0 - 1e-9)).all()


def test_noise_of_a_humanoids_rows_is_that_of_its_sensors(g1: Robot) -> None:
    random, n = np.random.default_rng(1), 20_000
    readings = {
        s.name: random.normal(size=(n, 6)) * np.repeat([s.noise_force, s.noise_moment], 3) for s in g1.sensors
    }
    drawn = base_wrench(g1, np.tile(g1.rest, (n, 1)), readings).std(axis=0)
    np.testing.assert_allclose(row_noise(g1), drawn, rtol=0.03)


def test_what_the_motions_do_not_excite_has_no_finite_std(panda: Robot) -> None:
    factor = motion_factor(panda, sines(panda, "motion", 0, moving=[0, 1, 2, 3]))
    base = structural_base_parameters(panda)
    std = dict(zip(base.labels, predicted_std(panda, factor, base), strict=True))
    assert std[f"viscous({panda.joint_names[6]})"] == np.inf
    assert std[f"viscous({panda.joint_names[3]})"] < 10.0


def test_faults(panda: Robot, g1: Robot) -> None:
    factor, base = motion_factor(panda, sines(panda, "motion", 0)), structural_base_parameters(panda)
    with pytest.raises(InputError, match="noise of shape"):
        predicted_std(panda, factor, base, np.ones(3))
    with pytest.raises(InputError, match="other columns"):
        predicted_std(panda, factor, structural_base_parameters(panda, ()))
    silent = panda.description.model_copy(
        update={"sensors": panda.description.sensors.model_copy(update={"noise_torque": None})}
    )
    with pytest.raises(InputError, match="no noise of joint"):
        row_noise(replace(panda, description=silent))
