"""The lexicographic optimum against a chain of generic programs, and solvers that lie to it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.estimator import SolveStatus
from excite.identification.estimators.hierarchy import Level, solve_hierarchy
from excite.identification.estimators.projection import ActiveSetProjector, ProjectionAnswer
from excite.identification.regression import row_space
from tests.identification.dual_active_set import project

N = 6


def random_rows(rng: np.random.Generator, n_rows: int, shift: float, n_equal: int = 0) -> LinearConstraints:
    """Rows of unit length that lie ``shift`` from the origin."""
    matrix = rng.normal(size=(n_rows, N))
    matrix /= np.linalg.norm(matrix, axis=1, keepdims=True)
    return LinearConstraints(matrix, shift + 0.3 * rng.normal(size=n_rows), ("row",) * n_rows, n_equal)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_last_level_is_the_nearest_point(seed):
    """With one determined direction and no constraints, what is left stays at the reference."""
    rng = np.random.default_rng(seed)
    row = rng.normal(size=(1, N))
    found = solve_hierarchy((), row, np.array([2.0]), project)
    np.testing.assert_allclose(found.x, 2.0 * row[0] / (row[0] @ row[0]), atol=1e-12)


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


def test_row_space_splits_a_matrix():
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(20, 4)) @ rng.normal(size=(4, 9))
    space = row_space(matrix)
    assert space.rank == 4
    np.testing.assert_allclose(matrix @ space.inverse, space.image, atol=1e-12)
    np.testing.assert_allclose(matrix @ space.null, 0.0, atol=1e-12)
    np.testing.assert_allclose(space.image.T @ space.image, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(space.null.T @ space.null, np.eye(5), atol=1e-12)
    assert row_space(np.zeros((3, 5))).rank == 0


class TestLyingProjector:
    """Whatever a solver says, the answer is right or refused."""

    def problem(self):
        rng = np.random.default_rng(3)
        levels = (Level("1", random_rows(rng, 6, 0.4)), Level("2", random_rows(rng, 8, 0.8)))
        return levels, rng.normal(size=(3, N)), 3.0 * rng.normal(size=3)

    @pytest.mark.parametrize("lie", ["ignores", "far", "nan", "none"])
    def test_is_caught(self, lie):
        levels, matrix, measured = self.problem()
        honest = solve_hierarchy(levels, matrix, measured, project)

        def liar(target, rows):
            true = project(target, rows)
            if true is None or lie == "none":
                return None
            if lie == "ignores":
                return ProjectionAnswer(target.copy(), np.zeros(len(rows.bound)))
            if lie == "far":
                moved = project(target + 3.0, rows)
                return ProjectionAnswer(moved.z, true.multipliers)
            return ProjectionAnswer(np.full_like(true.z, np.nan), true.multipliers)

        found = solve_hierarchy(levels, matrix, measured, liar)
        if found.status is SolveStatus.SOLVED:
            np.testing.assert_allclose(matrix @ found.x, matrix @ honest.x, atol=1e-4)
            assert found.slacks == pytest.approx(honest.slacks, abs=1e-6)
        else:
            assert np.isfinite(found.x).all()


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
