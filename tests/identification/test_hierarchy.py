"""The lexicographic optimum against a chain of generic programs, and solvers that lie to it."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.estimator import SolveStatus
from excite.identification.estimators.hierarchy import Level, solve_hierarchy
from excite.identification.estimators.projection import ActiveSetProjector
from tests.identification.dual_active_set import project

N = 6


def random_rows(rng: np.random.Generator, n_rows: int, shift: float, n_equal: int = 0) -> LinearConstraints:
    """Rows of unit length that lie ``shift`` from the origin."""
    matrix = rng.normal(size=(n_rows, N))
    matrix /= np.linalg.norm(matrix, axis=1, keepdims=True)
    return LinearConstraints(matrix, shift + 0.3 * rng.normal(size=n_rows), ("row",) * n_rows, n_equal)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), n_equal=st.integers(0, 2))
def test_both_solvers_agree_and_one_goes_on_from_where_it_stood(seed, n_equal):
    rng = np.random.default_rng(seed)
    rows = random_rows(rng, 9, 0.1, n_equal)
    target = rng.normal(size=N)
    expected = project(target, rows)
    mine = ActiveSetProjector()
    part = LinearConstraints(rows.matrix[:5], rows.bound[:5], rows.labels[:5], n_equal)
    mine(target, part)
    found = mine(target, rows)
    assert (found is None) == (expected is None)
    if found is not None:
        np.testing.assert_allclose(found.z, expected.z, atol=1e-9)
        np.testing.assert_allclose(found.multipliers, expected.multipliers, atol=1e-7)


def test_boxes_that_leave_room_are_met_however_badly_the_rows_are_conditioned():
    """Widths from a millionth to ten, conditions up to 1e8: a corner of the box shows that there is room."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        n = int(rng.integers(4, 25))
        m = int(rng.integers(2, n + 1))
        left, right = (np.linalg.qr(rng.normal(size=(k, k)))[0] for k in (m, n))
        matrix = left @ np.diag(np.geomspace(1.0, 10.0 ** -rng.uniform(0.0, 8.0), m)) @ right[:m]
        low = rng.normal(size=n) - 1.0
        high = low + 10.0 ** rng.uniform(-6.0, 1.0, size=n)
        rows = LinearConstraints(
            np.vstack([np.eye(n), -np.eye(n)]), np.concatenate([low, -high]), ("box",) * (2 * n)
        )
        found = solve_hierarchy(
            (Level("box", rows),),
            matrix,
            10.0 * rng.normal(size=m),
            ActiveSetProjector(),
            np.clip(np.zeros(n), low, high),
        )
        assert found.status is not SolveStatus.INFEASIBLE
        assert rows.violations(found.x).max() < 1e-6
