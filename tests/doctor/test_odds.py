"""Odds by effective samples, and what is not asked of joints that were computed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.doctor.examine import doctor
from excite.doctor.inertial_prior import count_effective_samples
from excite.logs.log import Trial
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log, changed


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_samples_of_an_autoregression_count_as_theory_has_it(phi: float) -> None:
    """n (1 - φ) / (1 + φ) of the mean of x_k = φ x_{k-1} + e_k, in two trials of which the second starts anew."""
    rng, n = np.random.default_rng(0), 20_000
    x = rng.normal(size=(2, n, 3))
    for k in range(1, n):
        x[:, k] += phi * x[:, k - 1]
    counts = count_effective_samples(x.reshape(2 * n, 3), np.repeat([0, 1], n))
    np.testing.assert_allclose(counts, 2 * n * (1.0 - phi) / (1.0 + phi), rtol=0.15)


@pytest.mark.parametrize("posture", ["measured", "computed"])
def test_an_axis_that_was_computed_points_as_its_model_says(posture: str) -> None:
    robot = load_robot("ur10")

    def turned(trial: Trial) -> Trial:
        signs = np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
        return replace(trial, q=trial.q * signs, tau=trial.tau * signs)

    log = changed(arm_log(robot), turned, posture=posture)
    kinds = {found.kind for found in doctor(log, robot).findings}
    recorded = {"direction", "order", "position_sign", "zero_position", "degrees", "revolutions"}
    assert bool(kinds & recorded) == (posture == "measured")


def test_what_was_inferred_is_never_certain() -> None:
    robot = load_robot("ur10")
    chart = doctor(changed(arm_log(robot), lambda t: replace(t, tau=-t.tau)), robot)
    (found,) = chart.findings
    assert found.kind == "torque_sign" and 0.99 < found.sure < 1.0 and "99 % sure" in chart.summary()
