"""How many steps solvers take, how coarse an answer may be, and where coordinates that do not count end up."""

from __future__ import annotations

import numpy as np
import pytest

from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators import conic
from excite.identification.estimators.conic import conic_distance, interior_point, refine_answer
from excite.identification.estimators.estimator import SolveStatus
from excite.identification.estimators.hierarchy import (
    HierarchyAnswer,
    Level,
    SemiProjection,
    completed,
    pursue,
    semi_project,
    solve_hierarchy,
)
from excite.identification.estimators.projection import ActiveSetProjector, ProjectionAnswer
from tests.identification.dual_active_set import project
from tests.identification.test_solvers import conic_problem, semi_problem


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-10])
def test_refinement_takes_few_steps(tolerance, monkeypatch):
    """Newton's steps converge quadratically: an answer to three digits needs three of them."""
    steps, jacobian = [], conic._projection_jacobian
    monkeypatch.setattr(conic, "_projection_jacobian", lambda *given: steps.append(0) or jacobian(*given))
    for seed in range(6):
        problem = conic_problem(seed)
        steps.clear()
        found = refine_answer(problem, interior_point(problem, tolerance))
        assert 0 < len(steps) <= 4 and conic_distance(problem, found) < 1e-6


# --- Coordinates that do not count


def test_a_proximal_answer_leads_to_the_optimum():
    reached = 0
    for seed in range(12):
        for n_equal in (0, 1, 2):
            problem = semi_problem(seed, n_equal)
            near = semi_project(problem, np.zeros(3), project)
            if near is None:
                continue
            reached += 1
            found = completed(problem, near)
            assert found.gap < 1e-10 and found.violation < 1e-10
            assert found.distance == pytest.approx(np.sqrt(2.0 * found.gap))
    assert reached > 25, "most of them have a point"


def test_free_coordinates_move_to_the_nearest_point_with_room():
    """``n₁ ≥ 1`` and ``n₁ + n₂ ≥ 4``: of all points of both the nearest to the start, not their corner."""
    counted = np.array([[1.0], [0.0], [0.0]])
    free = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    problem = SemiProjection(np.zeros(1), counted, free, np.array([2.0, 1.0, 4.0]), 0)
    first = np.array([True, False, False])
    for start, end in (([0.0, 0.0], [2.0, 2.0]), ([0.0, 5.0], [1.0, 5.0]), ([3.0, 3.0], [3.0, 3.0])):
        found = pursue(problem, first, np.array(start))
        assert found is not None
        assert found.p == pytest.approx([2.0]) and found.n == pytest.approx(end, abs=1e-9)
        assert found.multipliers == pytest.approx([2.0, 0.0, 0.0]) and found.violation < 1e-10


def test_no_room_where_free_rows_exclude_each_other():
    free = np.array([[1.0], [-1.0]])
    shut = SemiProjection(np.zeros(1), np.zeros((2, 1)), free, np.array([1.0, 0.0]), 0)
    assert pursue(shut, np.zeros(2, bool), np.zeros(1)) is None
    assert semi_project(shut, np.zeros(1), project) is None
    assert semi_project(shut, np.zeros(1), ActiveSetProjector()) is None


def test_a_projector_that_finds_nothing_is_not_asked_again_and_again():
    asked = []
    level = Level("1", LinearConstraints(np.eye(2, 3), np.ones(2), ("row:x", "row:y")))
    answer = solve_hierarchy(
        (level,), np.zeros((0, 3)), np.zeros(0), lambda target, rows: asked.append(target), np.zeros(3)
    )
    assert answer.status is SolveStatus.INFEASIBLE
    assert len(asked) <= 4, "to meet the rows, and to miss them by the least"


# --- How coarse an answer may be


def off_by(step: float):
    """A projector whose answers to a target off the origin lie a step aside, along a direction without rows."""

    def projector(target: np.ndarray, rows: LinearConstraints) -> ProjectionAnswer | None:
        true = project(target, rows)
        if true is None or not target.any():
            return true
        aside = np.zeros(len(target))
        aside[-1] = step
        return ProjectionAnswer(true.z + aside, true.multipliers)

    return projector


def last_level(step: float, size: float) -> HierarchyAnswer:
    """``x₀ ≥ size`` and nothing measured, from a start that is farther out."""
    level = Level("1", LinearConstraints(np.eye(1, 3), np.array([size]), ("row:x",)))
    return solve_hierarchy(
        (level,), np.zeros((0, 3)), np.zeros(0), off_by(step), np.array([size + 0.5, 0.0, 0.0])
    )


@pytest.mark.parametrize(
    ("step", "size", "status"),
    [
        (0.0, 1.0, SolveStatus.SOLVED),
        (0.9e-3, 1.0, SolveStatus.SOLVED),
        (1.1e-3, 1.0, SolveStatus.NOT_OPTIMAL),
        (0.9e-1, 100.0, SolveStatus.SOLVED),
        (1.1e-1, 100.0, SolveStatus.NOT_OPTIMAL),
        (np.nan, 1.0, SolveStatus.NOT_FINITE),
    ],
)
def test_the_last_level_takes_a_thousandth_of_the_way_and_no_more(step, size, status):
    found = last_level(step, size)
    assert found.status is status and found.slacks == pytest.approx((0.0,))
    if status is SolveStatus.SOLVED:
        assert found.x == pytest.approx([size, 0.0, step], abs=1e-9)
        assert found.distance == pytest.approx(step, abs=1e-6)
        assert found.fit_distance == pytest.approx(0.0, abs=1e-9)
    else:
        assert np.isfinite(found.x).all() and found.distance == np.inf
