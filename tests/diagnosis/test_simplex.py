"""The simplex search against scipy's and against known minima."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from excite.diagnosis.attribution import nelder_mead


def asked(loss, simplex, evaluations):
    points = []

    def noted(point):
        points.append(point.copy())
        return loss(point)

    nelder_mead(noted, simplex, evaluations, near=0.01, flat=1e-4)
    return np.array(points)


def simplex_at(point, step=0.25):
    return point + np.vstack([np.zeros(len(point)), step * np.eye(len(point))])


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("evaluations", [1, 5, 40])
def test_points_are_scipys(n, evaluations):
    rng = np.random.default_rng(n)
    for _ in range(20):
        a, centre, start = rng.normal(size=(n, n)), rng.normal(size=n), rng.normal(size=n)
        theirs = []

        def bumpy(x, a=a, centre=centre):
            return float(np.abs(a @ (x - centre)).sum() + np.sin(5.0 * x).sum())

        def noted(x, theirs=theirs, bumpy=bumpy):
            theirs.append(x.copy())
            return bumpy(x)

        options = {"maxfev": evaluations, "initial_simplex": simplex_at(start), "xatol": 0.01, "fatol": 1e-4}
        minimize(noted, start, method="Nelder-Mead", options=options)
        np.testing.assert_allclose(asked(bumpy, simplex_at(start), evaluations), theirs, atol=1e-12)


def test_a_bent_valley_is_followed_to_its_end():
    valley = asked(
        lambda x: (1.0 - x[0]) ** 2 + 100.0 * (x[1] - x[0] ** 2) ** 2, simplex_at(np.array([-1.2, 1.0])), 300
    )
    best = min(valley, key=lambda x: (1.0 - x[0]) ** 2 + 100.0 * (x[1] - x[0] ** 2) ** 2)
    np.testing.assert_allclose(best, 1.0, atol=0.02)
    assert len(valley) < 300
