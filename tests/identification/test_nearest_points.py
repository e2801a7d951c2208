"""Nearest points under linear rows: closed forms, multipliers by stationarity, bounds on the distance."""

from __future__ import annotations

import numpy as np
import pytest

from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.least_squares import _deviations
from excite.identification.estimators.projection import (
    ActiveSetProjector,
    ProjectionAnswer,
    Projector,
    distance_to_optimum,
)
from tests.identification.dual_active_set import project


def rows(matrix: list[list[float]], bound: list[float], n_equal: int = 0) -> LinearConstraints:
    """Rows without names."""
    return LinearConstraints(np.array(matrix), np.array(bound), ("row",) * len(bound), n_equal)


SOLVERS = pytest.mark.parametrize(
    "solver", [project, ActiveSetProjector()], ids=["dual_active_set", "kept_active_set"]
)


@SOLVERS
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_equality_pulls_from_either_side(solver: Projector, side: float) -> None:
    """The foot of the perpendicular, whose multiplier is the signed distance over the normal's length."""
    normal, target = np.array([3.0, 4.0]), side * np.array([6.0, 8.0])
    answer = solver(target, rows([list(normal)], [5.0], n_equal=1))
    assert answer is not None
    load = (5.0 - normal @ target) / 25.0
    np.testing.assert_allclose(answer.multipliers, [load], atol=1e-12)
    np.testing.assert_allclose(answer.z, target + load * normal, atol=1e-12)


@SOLVERS
def test_a_row_that_holds_costs_nothing_and_one_that_does_not_is_met(solver: Projector) -> None:
    target = np.array([1.0, -2.0, 0.0])
    answer = solver(target, rows([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]], [1.0, 3.0]))
    assert answer is not None
    np.testing.assert_allclose(answer.z, [1.0, 1.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(answer.multipliers, [0.0, 1.75], atol=1e-12)


@SOLVERS
def test_rows_that_exclude_each_other_have_no_answer(solver: Projector) -> None:
    assert solver(np.zeros(1), rows([[1.0], [-1.0]], [1.0, 0.0])) is None
    after = solver(np.zeros(1), rows([[1.0]], [1.0]))
    assert after is not None, "a failed search leaves nothing behind"
    np.testing.assert_allclose(after.z, [1.0])


def test_equalities_that_say_the_same_twice_are_one() -> None:
    twice = rows([[1.0, 1.0], [2.0, 2.0]], [2.0, 4.0], n_equal=2)
    answer = ActiveSetProjector()(np.array([3.0, 0.0]), twice)
    assert answer is not None
    np.testing.assert_allclose(answer.z, [2.5, -0.5], atol=1e-12)
    against = rows([[1.0, 1.0], [2.0, 2.0]], [2.0, 5.0], n_equal=2)
    assert ActiveSetProjector()(np.array([3.0, 0.0]), against) is None


def test_rows_may_be_added_one_by_one() -> None:
    """Each answer meets Karush, Kuhn and Tucker's conditions and is the other solver's; a new target starts anew."""
    rng, projector = np.random.default_rng(4), ActiveSetProjector()
    matrix, inside = rng.normal(size=(24, 6)), rng.normal(size=6)
    bound = matrix @ inside - rng.uniform(0.0, 0.4, size=24)
    bound[:2] = matrix[:2] @ inside
    for target in (5.0 * rng.normal(size=6), 5.0 * rng.normal(size=6)):
        for count in (2, 3, 8, 16, 24):
            some = LinearConstraints(matrix[:count], bound[:count], ("row",) * count, 2)
            answer, other = projector(target, some), project(target, some)
            assert answer is not None and other is not None
            slack = some.matrix @ answer.z - some.bound
            np.testing.assert_allclose(answer.z, target + some.matrix.T @ answer.multipliers, atol=1e-9)
            np.testing.assert_allclose(slack[:2], 0.0, atol=1e-9)
            assert slack.min() > -1e-9 and answer.multipliers[2:].min(initial=0.0) >= 0.0
            np.testing.assert_allclose(answer.multipliers[2:] * slack[2:], 0.0, atol=1e-8)
            np.testing.assert_allclose(answer.z, other.z, atol=1e-8)
            np.testing.assert_allclose(answer.multipliers, other.multipliers, atol=1e-7)
            assert distance_to_optimum(target, some, answer) < 1e-6


def test_a_row_that_is_changed_or_taken_away_is_not_remembered() -> None:
    projector, target = ActiveSetProjector(), np.zeros(2)
    for bound in ([1.0, 2.0], [1.0, 0.5], [1.0], [3.0]):
        answer = projector(target, rows([[1.0, 0.0], [0.0, 1.0]][: len(bound)], bound))
        assert answer is not None
        np.testing.assert_allclose(answer.z, [*bound, 0.0][:2], atol=1e-12)
    equal = projector(np.array([5.0, 0.0]), rows([[1.0, 0.0]], [3.0]))
    assert equal is not None
    np.testing.assert_allclose(equal.z, [5.0, 0.0])
    equal = projector(np.array([5.0, 0.0]), rows([[1.0, 0.0]], [3.0], n_equal=1))
    assert equal is not None
    np.testing.assert_allclose(equal.z, [3.0, 0.0])


def test_without_rows_the_target_is_the_answer_and_a_copy() -> None:
    target = np.array([1.0, 2.0])
    answer = project(target, LinearConstraints(np.zeros((0, 2)), np.zeros(0), ()))
    assert answer is not None and answer.z is not target
    np.testing.assert_array_equal(answer.z, target)
    assert answer.multipliers.shape == (0,)


def test_the_duality_gap_bounds_the_distance_by_its_formula() -> None:
    """One row x ≥ 1 and the target 0: the answer is 1 with multiplier 1."""
    one, target = rows([[1.0]], [1.0]), np.zeros(1)

    def bound(z: float, multiplier: float) -> float:
        return distance_to_optimum(target, one, ProjectionAnswer(np.array([z]), np.array([multiplier])))

    assert bound(1.0, 1.0) == 0.0
    assert bound(1.5, 1.0) == pytest.approx(np.sqrt(2.0 * (0.125 + 0.5)))
    assert bound(1.0, 0.5) == pytest.approx(0.5)
    assert bound(1.0, -3.0) == pytest.approx(1.0), "a negative multiplier of an inequality counts as none"
    equal = rows([[1.0]], [1.0], n_equal=1)
    held = ProjectionAnswer(np.array([1.0]), np.array([-2.0]))
    assert distance_to_optimum(np.array([3.0]), equal, held) == 0.0, "of an equality it may be negative"


class Channels:
    """What the deviations need of a problem."""

    channel = np.array([0, 0, 0, 1, 1, 1])


def test_deviations_are_median_residuals_and_never_zero() -> None:
    residual = np.array([1.0, -2.0, 50.0, 0.0, 0.0, 3.0])
    found = _deviations(Channels(), residual, np.array([7.0, 7.0, 5.0]))
    # 0.6745: the quartile of a normal variable. A channel without rows keeps what it had.
    np.testing.assert_allclose(found, [2.0 / 0.6744897501960817, 5e-6, 5.0])
    all_exact = _deviations(Channels(), np.zeros(6), np.zeros(2))
    np.testing.assert_allclose(all_exact, 1e-18, rtol=1e-12)
