"""The weighted fit and its evidence against independent truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.diagnosis.attribution import effective_counts
from excite.diagnosis.equations.joint_torque import Equations, Solver
from tests.diagnosis.test_deflection import deflected


def _equations(rng: np.random.Generator) -> tuple[Equations, np.ndarray, np.ndarray]:
    n = 600
    shared = rng.normal(size=(2, n, 3))
    own = tuple(rng.normal(size=(n, 2)) for _ in range(2))
    extra = rng.normal(size=(2, n, 1))
    extra[1] = 0.0
    x = np.array([0.3, -0.2, 0.5])
    y = shared @ x + extra[:, :, 0] * 0.7
    y = y + np.array([own[j] @ [1.0, -2.0] for j in range(2)])
    y = y + rng.normal(size=y.shape) * np.array([[0.01], [1.0]])
    equations = Equations(shared, own, y, np.arange(n) < 400, np.zeros(n, dtype=int), np.full(2, 1e-6))
    return equations, extra, x


def test_fit_recovers_all_kinds_of_columns():
    equations, extra, x = _equations(np.random.default_rng(0))
    fit = Solver(equations).fit_columns(extra)
    assert fit.extra[0] == pytest.approx(0.7, abs=5 * fit.extra_std[0])
    np.testing.assert_allclose(fit.shared, x, atol=5e-3)
    np.testing.assert_allclose(fit.own_coefs[0], [1.0, -2.0], atol=5e-3)
    np.testing.assert_allclose(fit.sigma, [0.01, 1.0], rtol=0.15)
    np.testing.assert_allclose(fit.residual[:, 400:].std(axis=1), [0.01, 1.0], rtol=0.15)


def test_offset_is_the_same_as_taking_it_off_the_measurement():
    equations, extra, _ = _equations(np.random.default_rng(1))
    fit = Solver(equations).fit_columns(offset=0.7 * extra[:, :, 0])
    np.testing.assert_allclose(fit.sigma, Solver(equations).fit_columns(extra).sigma, rtol=0.02)


def test_other_own_columns_leave_the_first_solver_alone():
    equations, extra, _ = _equations(np.random.default_rng(2))
    solver = Solver(equations)
    before = solver.fit_columns(extra).sigma
    poorer = solver.with_own(0, equations.own[0][:, :1]).fit_columns(extra).sigma
    assert poorer[0] > 10 * before[0]
    np.testing.assert_array_equal(solver.fit_columns(extra).sigma, before)


def test_a_direction_that_nothing_shows_takes_no_coefficient():
    """Rounding errors of a column that is none would be fitted with a huge coefficient."""
    equations, extra, _ = _equations(np.random.default_rng(4))
    nothing = 1e-12 * np.random.default_rng(5).normal(size=extra.shape)
    fit = Solver(equations).fit_columns(np.concatenate([nothing, extra], axis=2))
    assert fit.extra[0] == 0.0
    assert fit.extra[1] == pytest.approx(0.7, abs=5 * fit.extra_std[1])


def test_a_direction_that_is_hardly_shown_takes_no_more_than_it_can_have():
    """Noise alone would be fitted with a coefficient of any size; what is shown well is not held back."""
    equations, extra, _ = _equations(np.random.default_rng(6))
    hardly = 1e-5 * np.random.default_rng(7).normal(size=extra.shape)
    columns, widths = np.concatenate([hardly, extra], axis=2), np.array([1.0, 1.0])
    free, held = (Solver(equations).fit_columns(columns, widths=w) for w in (None, widths))
    assert free.extra_std[0] > 10.0
    assert held.extra_std[0] < 1.01
    assert abs(held.extra[0]) < 0.1 * abs(free.extra[0])
    assert held.extra[1] == pytest.approx(free.extra[1], abs=0.1 * free.extra_std[1])


def test_effective_samples_of_an_autoregressive_residual():
    rng, n, rho = np.random.default_rng(3), 20000, 0.8
    noise = rng.normal(size=n)
    series = np.zeros(n)
    for k in range(1, n):
        series[k] = rho * series[k - 1] + noise[k]
    counts = effective_counts(series[None], np.ones(n, dtype=bool), np.zeros(n, dtype=int))
    assert counts[0, 0] == pytest.approx(n * (1 - rho) / (1 + rho), rel=0.2)
    assert counts[0, 1] == 0.0


def test_deflection_of_a_loaded_spring_and_of_play():
    n, dt, load, stiffness, inertia = 400, 0.005, 2.0, 500.0, 0.5
    starts = np.zeros(n, dtype=bool)
    starts[0] = True
    damping = 2.0 * np.sqrt(stiffness * inertia)
    free, rest = np.zeros(n), np.zeros((1, 2))
    arguments = (free, free, np.full(n, inertia), free, free, starts, rest, dt, stiffness, damping)
    still = deflected(np.full(n, load), *arguments, 0.0)
    np.testing.assert_allclose(still[0], -load / stiffness, rtol=1e-9)
    # The load turns over: the link crosses the play and leans on the other side.
    turned = np.where(np.arange(n) < 100, load, -load)
    across = deflected(turned, *arguments, 0.01)
    assert across[0, 50] == pytest.approx(-load / stiffness - 0.01)
    assert across[0, -1] == pytest.approx(load / stiffness + 0.01, rel=1e-3)
    assert across[2, 101] == pytest.approx(load / inertia, rel=0.8)


def test_a_hardening_spring_under_a_constant_load_starts_where_it_stays():
    n, load, stiffness, cubic = 200, 20.0, 265.0, 2500.0
    starts = np.zeros(n, dtype=bool)
    starts[0] = True
    free, rest = np.zeros(n), np.zeros((1, 2))
    behind = (np.full(n, load), free, free, np.full(n, 0.5), free, free)
    x = deflected(*behind, starts, rest, 0.005, stiffness, 1.0, 0.0, cubic)[0]
    np.testing.assert_allclose(stiffness * x * (1.0 + cubic * x**2), -load, rtol=1e-6)


def test_deviations_are_those_by_which_trials_disagree():
    """Where the same model is off by more or less in every trial, white noise's deviations are far too small."""
    rng = np.random.default_rng(8)
    n_trials, length = 6, 200
    trial = np.repeat(np.arange(n_trials), length)
    column = rng.standard_normal(n_trials * length)
    found, told, white = [], [], []
    for _ in range(150):
        differs = 0.1 * rng.standard_normal(n_trials)[trial]
        y = (2.0 + differs) * column + 0.05 * rng.standard_normal(len(column))
        equations = Equations(
            np.zeros((1, len(y), 0)),
            (np.ones((len(y), 1)),),
            y[None],
            np.ones(len(y), dtype=np.bool_),
            trial,
            np.array([1e-6]),
        )
        solver = Solver(equations)
        fit = solver.fit_columns(column[None, :, None])
        found.append(fit.extra[0])
        told.append(solver.std_between_trials(fit)[0])
        white.append(fit.extra_std[0])
    assert np.sqrt(np.mean(np.square(told))) == pytest.approx(np.std(found), rel=0.25)
    assert np.mean(white) < 0.2 * np.std(found)


def test_a_column_that_the_record_does_not_show_has_a_deviation_all_the_same():
    equations, extra, _ = _equations(np.random.default_rng(3))
    equations = replace(equations, trial=np.repeat(np.arange(6), 100))
    solver = Solver(equations)
    widths = np.array([2.0, 3.0, 2.0])
    fit = solver.fit_columns(np.concatenate([extra, np.zeros_like(extra), extra], axis=2), widths=widths)
    told = solver.std_between_trials(fit, widths)
    assert np.isfinite(told[[0, 2]]).all()
    assert (told[[0, 2]] < 1.1 * widths[[0, 2]]).all()
    # Of the one in the middle nothing is known but what was known before.
    assert told[1] == widths[1]
    assert solver.std_between_trials(fit)[1] == np.inf
