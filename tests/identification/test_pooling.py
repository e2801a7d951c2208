"""Random effects: intervals that hold for the next session, whatever lies between the sessions."""

from __future__ import annotations

import numpy as np
import pytest

from excite.errors import InputError
from excite.identification.sessions import between_variance, pool_estimates

K = 6


def simulated(rng: np.random.Generator, n_sessions: int, between: float):
    """True mean, true values of the next session, estimates of the sessions and their covariances."""
    root = rng.standard_normal((n_sessions, K, 2 * K))
    covariances = root @ root.transpose(0, 2, 1) / (2 * K)
    mean = 5.0 * rng.standard_normal(K)
    errors = np.array([rng.multivariate_normal(np.zeros(K), c) for c in covariances])
    values = mean + between * rng.standard_normal((n_sessions, K)) + errors
    return mean, mean + between * rng.standard_normal(K), values, covariances


@pytest.mark.parametrize("between", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("n_sessions", [2, 5])
def test_intervals_hold_the_mean_and_the_next_session(n_sessions, between):
    """At least 95 %, for few sessions and little between them more; a fixed effect holds 11 to 95 %."""
    rng = np.random.default_rng(1)
    of_mean, of_next = [], []
    for _ in range(60):
        mean, following, values, covariances = simulated(rng, n_sessions, between)
        found = pool_estimates(values, covariances)
        of_mean.append((found.mean_interval[0] < mean) & (mean < found.mean_interval[1]))
        of_next.append((found.next_interval[0] < following) & (following < found.next_interval[1]))
    assert np.mean(of_mean) > 0.91
    assert np.mean(of_next) > 0.91
    if between == 3.0 and n_sessions == 5:
        assert np.mean(of_mean) < 0.975
        assert np.mean(of_next) < 0.975


def test_sessions_that_agree_give_the_textbook_mean():
    """Without anything between them, weights are the inverse covariances."""
    rng = np.random.default_rng(2)
    _, _, _, covariances = simulated(rng, 5, 0.0)
    mean = np.arange(K, dtype=float)
    values = mean + 1e-9 * rng.standard_normal((5, K))
    found = pool_estimates(values, covariances)
    assert (found.between == 0.0).all() and (found.inconsistency == 0.0).all()
    information = np.linalg.inv(covariances).sum(axis=0)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(information), rtol=1e-8)
    np.testing.assert_allclose(found.mean, mean, atol=1e-7)


def test_variance_between_sessions_is_the_sample_variance_where_noise_is_nothing():
    values = np.random.default_rng(3).standard_normal((7, 3))
    np.testing.assert_allclose(
        between_variance(values, np.full((7, 3), 1e-12)), values.var(axis=0, ddof=1), rtol=1e-6
    )


def test_variance_between_sessions_is_right_on_average():
    rng = np.random.default_rng(4)
    own = rng.uniform(0.5, 1.5, (20, 500))
    values = 2.0 * rng.standard_normal((20, 500)) + np.sqrt(own) * rng.standard_normal((20, 500))
    assert np.mean(between_variance(values, own)) == pytest.approx(4.0, rel=0.05)


def test_units_do_not_matter():
    rng = np.random.default_rng(5)
    _, _, values, covariances = simulated(rng, 4, 1.0)
    size = 10.0 ** np.arange(-4, 2)
    plain, scaled = (
        pool_estimates(values, covariances),
        pool_estimates(values * size, covariances * np.outer(size, size)),
    )
    np.testing.assert_allclose(scaled.mean, plain.mean * size, rtol=1e-8)
    np.testing.assert_allclose(scaled.next_interval, plain.next_interval * size, rtol=1e-8)


def test_one_session_is_refused():
    with pytest.raises(InputError, match="at least two"):
        pool_estimates(np.zeros((1, K)), np.eye(K)[None])
