"""A baseline with an accepted effect in it predicts what its own fit says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.attribution import extend_baseline, fit_along_direction
from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.logs.files import load_log
from excite.logs.robot import nominal_robot
from tests.diagnosis.few_trials import few_trials
from tests.diagnosis.hypotheses import fitted


@pytest.fixture(scope="module")
def baseline(gap_dir: Path) -> Baseline:
    log = load_log(gap_dir / "arm" / "case_006")
    samples = arm_samples(nominal_robot(log), log, [*log.trials[:3], log.trials[5]])
    return fit_baseline(samples, log.header.modelled, spectral_floor(samples))


def left(baseline: Baseline) -> np.ndarray:
    """Measured torque less the baseline's prediction at the rows, ``(n_joints, n_rows)`` [N·m]."""
    samples = baseline.samples
    rest = np.concatenate([t.tau for t in samples.trials]) - baseline.total
    return samples.to_rows(samples.by_trial(rest), range(rest.shape[1])).T


def test_a_fit_is_the_one_that_its_predictions_belong_to(baseline: Baseline):
    np.testing.assert_allclose(left(baseline), baseline.plain_residual(baseline.fit.residual), atol=1e-6)


@pytest.mark.parametrize("name", ["torque_bias", "torque_gain"])
def test_predictions_with_an_effect_are_those_of_the_fit_with_it(baseline: Baseline, name: str):
    after = extend_baseline(fitted(baseline, EFFECTS[name], "panda_joint4"))
    scale = baseline.samples.trials[0].tau.std(axis=0)[:, None]
    off = np.abs(left(after) - after.plain_residual(after.fit.residual)) / scale
    assert off.max() < 0.02


def test_a_body_of_which_only_the_size_is_fitted_keeps_its_proportions(baseline: Baseline):
    item = fitted(baseline, EFFECTS["payload"], "panda_link6")
    half_a_decimetre_out = np.array([1.0, 0.05, 0.0, 0.0, 1e-4, 0.0, 2.6e-3, 0.0, 0.0, 2.6e-3])
    made = fit_along_direction(item, half_a_decimetre_out)
    np.testing.assert_allclose(made.fit.extra, made.fit.extra[0] * half_a_decimetre_out)
    free = baseline.solver.fit_columns(item.columns.extra)
    assert np.log(made.fit.sigma).sum() > np.log(free.sigma).sum()
    # Parameters in fixed proportions are no surer than free ones.
    assert (made.fit.extra_std >= item.fit.extra_std).all()
    after = extend_baseline(made)
    scale = baseline.samples.trials[0].tau.std(axis=0)[:, None]
    off = np.abs(left(after) - after.plain_residual(after.fit.residual)) / scale
    assert off.max() < 0.02


def test_a_log_without_validation_trials_is_judged_on_those_it_has(gap_dir: Path):
    log = load_log(gap_dir / "arm" / "case_006")
    result = diagnose(few_trials(log, 1, 0))
    assert [(item.effect, item.location) for item in result.effects] == [("torque_bias", "panda_joint4")]
    assert any("no validation trial" in text for text in result.warnings)
