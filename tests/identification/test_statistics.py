"""Intervals that hold, eq. (7) of Xu et al. 2020 where it applies, and essential parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from excite.identification.noise import NoiseModel, estimate_noise, trial_grids, whitened_factor
from excite.identification.parameter_statistics import essential_parameters
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import condense_problem, iterate_weights
from excite.identification.statistics import base_statistics, relative_percent
from tests.identification.coverage import CASES, Case, Experiment

PLAIN, FILTERED = Case(None, 100.0), Case(5.0, 100.0)


def problem_of(case: Case, seed: int) -> IdentificationProblem:
    return Experiment("ur10", case, duration=8.0).problem(seed)


@pytest.mark.slow
@pytest.mark.parametrize("case", [CASES[3], CASES[4], CASES[6]], ids=str)
def test_intervals_cover_the_truth_as_often_as_they_say(case):
    """95 % intervals over 40 draws; the benchmark ``intervals`` has all rows, 200 draws and the humanoid."""
    share = Experiment("panda", case).coverage(range(40))["ours"].mean()
    assert 0.93 <= share <= 0.97


@pytest.mark.slow
def test_intervals_of_a_humanoid_cover_the_truth():
    share = Experiment("g1", Case(5.0, every=10), duration=24.0).coverage(range(4))["ours"].mean()
    assert 0.93 <= share <= 0.97


def test_noise_that_is_coloured_before_the_filter_is_recognised():
    """Noise of first order with a pole at 0.98, 200 Hz: half of its power lies below 0.64 Hz."""

    class Coloured(Experiment):
        def noise(self, rng):
            return lfilter([1.0], [1.0, -0.98], super().noise(rng), axis=0)

    experiment = Coloured("panda", Case(10.0, every=10), duration=30.0)
    inside, as_if_white = [], []
    for seed in range(16):
        found = experiment.statistics(seed)
        error = np.abs(found.estimate - found.base.values(experiment.robot.nominal_parameters))
        inside.append(np.mean(error < found.half_width()))
        as_if_white.append(np.mean(error < 1.96 * found.white_std))
    assert 0.9 <= np.mean(inside) <= 0.98
    assert np.mean(as_if_white) < 0.9


def test_white_noise_gives_the_textbook_formula():
    """Eq. (7) of Xu et al. 2020, evaluated directly on the rows."""
    problem = problem_of(PLAIN, 0)
    found = base_statistics(condense_problem(problem))
    columns = problem.Y[:, found.base.independent]
    residual = problem.y - columns @ np.linalg.lstsq(columns, problem.y, rcond=None)[0]
    variance = residual @ residual / (len(residual) - columns.shape[1])
    expected = np.sqrt(variance * np.diag(np.linalg.inv(columns.T @ columns)))
    np.testing.assert_allclose(found.white_std, expected, rtol=1e-6)
    np.testing.assert_allclose(
        relative_percent(found.std, found.estimate), 100 * found.std / np.abs(found.estimate), rtol=1e-12
    )
    weighted = base_statistics(iterate_weights(condense_problem(problem)))
    np.testing.assert_allclose(weighted.std, weighted.white_std, rtol=0.1)


def test_filtered_noise_widens_the_intervals():
    problem = problem_of(FILTERED, 0)
    found = base_statistics(iterate_weights(condense_problem(problem)))
    assert np.median(found.std / found.white_std) > 2.0
    # Few independent numbers: Student's quantile is wider than the normal one.
    ratio = found.half_width() / found.std
    assert (ratio > 1.96).all() and (ratio < 2.3).all()
    assert (found.degrees_of_freedom < found.factor.shape[0] * 100).all()


def _small_problem(n: int = 60) -> IdentificationProblem:
    rng = np.random.default_rng(3)
    time = np.arange(n) * 0.01
    return IdentificationProblem(
        robot=None,
        Y=rng.standard_normal((2 * n, 3)),
        y=rng.standard_normal(2 * n),
        weights=np.ones(2 * n),
        channel=np.tile([0, 1], n),
        channel_names=("a", "b"),
        channel_units=("N·m", "N·m"),
        time=np.repeat(time, 2),
        trial=np.zeros(2 * n, dtype=np.int64),
        trial_names=("only",),
        parameter_names=("x", "y", "z"),
        prior=np.zeros(3),
        n_inertial=0,
    )


def test_whitening_with_white_noise_changes_nothing():
    problem = _small_problem()
    noise = NoiseModel(np.array([2.0, 0.5]), np.eye(2)[None])
    columns = problem.Y
    factor = whitened_factor(problem, trial_grids(problem), columns, noise)
    scaled = columns / noise.std[problem.channel, None]
    np.testing.assert_allclose(factor.T @ factor, scaled.T @ scaled, rtol=1e-9)


def test_noise_of_known_spectrum_is_found():
    """First-order moving average: autocorrelation 0.5 at lag one, nothing beyond."""
    base = _small_problem(20000)
    white = np.random.default_rng(5).standard_normal((20001, 2))
    residual = ((white[1:] + white[:-1]) * [1.0, 3.0]).ravel()
    noise = estimate_noise(base, trial_grids(base), residual)
    np.testing.assert_allclose(noise.std, np.sqrt(2) * np.array([1.0, 3.0]), rtol=0.03)
    np.testing.assert_allclose(noise.autocovariance[1].diagonal(), 0.5, atol=0.03)
    np.testing.assert_allclose(noise.inflation, 2.0, atol=0.25)


def share_of_signal(statistics, kept, values):
    """What each parameter adds to the weighted channels, as share of all that they add together."""
    return (
        np.linalg.norm(statistics.factor[:, kept], axis=0)
        * np.abs(values)
        / np.linalg.norm(statistics.rotated)
    )


def test_essential_parameters_follow_the_rule_of_the_paper_in_shares_of_the_channels():
    """Xu et al. 2020, end of II.A: below 0.01 and above 40 %, the greatest RSD first, re-estimating."""
    problem = problem_of(PLAIN, 1)
    statistics = base_statistics(iterate_weights(condense_problem(problem)))
    found = essential_parameters(statistics)
    rsd = relative_percent(statistics.std, statistics.estimate)
    everyone = np.arange(len(rsd))
    candidates = (share_of_signal(statistics, everyone, statistics.estimate) < 0.01) & (rsd > 40.0)
    assert found.removed[0] == int(np.argmax(np.where(candidates, rsd, -1.0)))
    left = share_of_signal(statistics, found.kept, found.values)
    assert not ((left < 0.01) & (100.0 * found.std > 40.0 * np.abs(found.values))).any()
    std = iterate_weights(condense_problem(problem)).std
    columns = problem.Y[:, statistics.base.independent[found.kept]] / std[problem.channel, None]
    expected = np.linalg.lstsq(columns, problem.y / std[problem.channel], rcond=None)[0]
    np.testing.assert_allclose(found.values, expected, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("unit", [0.1, 10.0])
def test_which_parameters_are_essential_does_not_depend_on_the_unit_of_mass(unit):
    problem = problem_of(PLAIN, 1)
    other = replace(problem, y=unit * problem.y, prior=unit * problem.prior, weights=problem.weights / unit)
    kept, again = (
        essential_parameters(base_statistics(iterate_weights(condense_problem(one)))).kept
        for one in (problem, other)
    )
    assert 0 < len(kept) < problem.n_params
    np.testing.assert_array_equal(again, kept)
