"""Uncertainty of standard parameters where motions show some directions next to nothing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from excite.identification import parameter_statistics
from excite.identification.parameter_statistics import parameter_uncertainty


def test_directions_that_motions_hardly_show_keep_their_prior(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, n = np.random.default_rng(0), 30
    # Rows of humanoids whose feet stay show their legs' parameters in the fifteenth digit.
    factor = np.triu(rng.normal(size=(n, n))) * np.logspace(3, -12, n)[:, None]
    noise = rng.normal(size=(n, n))
    meat = np.eye(n) + 0.1 * noise @ noise.T / n
    mixed = rng.normal(size=(n, n))
    statistics = SimpleNamespace(
        base=SimpleNamespace(matrix=mixed),
        factor=factor,
        meat=meat,
        covariance=np.linalg.inv(factor) @ meat @ np.linalg.inv(factor).T,
    )
    monkeypatch.setattr(parameter_statistics, "prior_std", lambda problem, spread: np.ones(n))
    found = parameter_uncertainty(cast("Any", None), cast("Any", statistics), np.ones(1))
    information = mixed.T @ factor.T @ np.linalg.solve(meat, factor @ mixed)
    known = 1.0 - np.diag(np.linalg.inv(np.eye(n) + information))
    np.testing.assert_allclose(found.determined, known, atol=1e-6)
    np.testing.assert_allclose(found.std, np.sqrt(1.0 - known), atol=1e-3)
