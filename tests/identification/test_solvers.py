"""The solvers behind the estimators, each against finite differences, general solvers or algebra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.identification.constraints.cones import Cones, triangle_of
from excite.identification.constraints.linear import LinearConstraints, stack_constraints
from excite.identification.estimators.conic import (
    ConicAnswer,
    ConicProblem,
    _is_ray,
    conic_distance,
    conic_violations,
    interior_point,
    refine_answer,
    stack_rows,
)
from excite.identification.estimators.estimator import SolveStatus
from excite.identification.estimators.hierarchy import LevelFailed, SemiProjection, semi_project
from excite.identification.estimators.projection import ActiveSetProjector
from excite.robot.loading import load_robot
from tests.identification.dual_active_set import project
from tests.identification.synthetic import arm_problem

# --- Distances between bodies


@pytest.fixture(scope="module")
def problem():
    return arm_problem(load_robot("panda"), seed=5, duration=1.0)


# --- Cone programs


def conic_problem(seed: int, n_equal: int = 1) -> ConicProblem:
    """Nine coordinates, two matrices, a second-order cone and four rows, with a point inside all."""
    rng = np.random.default_rng(seed)
    n, inside = 9, rng.normal(size=9)
    shape = triangle_of(3)
    matrices = 0.5 * rng.normal(size=(2, 6, n))
    centre = shape.vectors(np.array([np.eye(3), 2.0 * np.eye(3)]))
    blocks = Cones(3, matrices, centre - matrices @ inside, ("body:a", "body:b"))
    arrows = 0.5 * rng.normal(size=(1, 4, n))
    arrow = Cones(0, arrows, np.array([[1.0, 0.0, 0.0, 0.0]]) - arrows @ inside, ("com:a",))
    rows = rng.normal(size=(4, n))
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    bound = rows @ inside - np.r_[np.zeros(n_equal), 0.3 * np.ones(4 - n_equal)]
    labels = ("tie:x", "row:x", "row:y", "row:z")
    target = inside + 4.0 * rng.normal(size=n)
    return ConicProblem(target, LinearConstraints(rows, bound, labels, n_equal), (blocks, arrow))


@pytest.mark.parametrize("n_equal", [0, 1, 2])
def test_refined_answers_are_stationary_feasible_and_complementary(n_equal):
    for seed in range(4):
        problem = conic_problem(seed, n_equal)
        answer = refine_answer(problem, interior_point(problem, 1e-6))
        matrix, offset = stack_rows(problem)
        dual = answer.multipliers
        assert np.allclose(answer.z - problem.target, matrix.T @ dual, atol=1e-11)
        values = matrix @ answer.z + offset
        assert np.abs(values[:n_equal]).max(initial=0.0) < 1e-9
        assert max(conic_violations(problem, answer.z).values()) < 1e-9
        assert abs(dual @ values) < 1e-9
        place = len(problem.linear.bound)
        assert dual[n_equal:place].min(initial=0.0) >= 0.0
        for cones in problem.cones:
            part = dual[place : place + cones.bound.size].reshape(cones.bound.shape)
            assert cones.margin(part).min() > -1e-10
            place += cones.bound.size
        assert np.linalg.norm(dual) > 0.1, "the constraints bind"
        assert conic_distance(problem, answer) < 1e-5


def test_an_unconstrained_optimum_is_left_where_it_is():
    problem = conic_problem(0, 0)
    matrix, offset = stack_rows(problem)
    inside = problem.target.copy()
    for cones in problem.cones:
        assert cones.margin(cones.values(inside)).shape == (len(cones.labels),)
    free = replace(problem, linear=stack_constraints([], 9), cones=())
    assert np.allclose(interior_point(free).z, problem.target)
    assert conic_distance(free, ConicAnswer(problem.target + 0.5, np.zeros(0))) == pytest.approx(1.5)
    assert matrix.shape == (4 + 12 + 4, 9) and offset.shape == (20,)


def test_violations_are_named_by_kind():
    problem = conic_problem(1)
    z = problem.target + 3.0
    worst = conic_violations(problem, z)
    assert set(worst) == {"tie", "row", "body", "com"}
    rows = problem.linear.matrix @ z - problem.linear.bound
    assert worst["tie"] == pytest.approx(abs(rows[0]))
    assert worst["row"] == pytest.approx(max(0.0, *(-rows[1:])))
    bodies, com = problem.cones
    assert worst["body"] == pytest.approx(max(0.0, *(-bodies.margin(bodies.values(z)))))
    assert worst["com"] == pytest.approx(max(0.0, *(-com.margin(com.values(z)))))


def test_only_a_ray_proves_that_there_is_no_point():
    """``x ≥ 1`` and ``−x ≥ 1``: the sum of both says 0 ≥ 2."""
    matrix = np.array([[1.0, 0.0], [-1.0, 0.0]])
    rows = LinearConstraints(matrix, np.array([1.0, 1.0]), ("a:x", "b:x"))
    problem = ConicProblem(np.zeros(2), rows, ())
    answer = interior_point(problem)
    assert answer.infeasible and _is_ray(problem, answer)

    def ray(*multipliers: float) -> bool:
        return _is_ray(problem, ConicAnswer(np.zeros(2), np.array(multipliers), infeasible=True))

    assert ray(1.0, 1.0) and ray(5.0, 5.0 + 0.9e-5)
    assert not ray(1.0, 1.0 + 1e-5)
    assert not ray(-1.0, -1.0)
    assert not ray(0.0, 0.0)
    assert not ray(np.nan, 1.0)
    fine = ConicProblem(np.zeros(2), LinearConstraints(matrix, np.array([-1.0, -1.0]), ("a:x", "b:x")), ())
    assert not interior_point(fine).infeasible
    assert not _is_ray(fine, ConicAnswer(np.zeros(2), np.array([1.0, 1.0]), infeasible=True))


# --- Projections where some coordinates do not count


def test_free_rows_that_exclude_each_other_and_a_projector_that_finds_nothing_have_no_answer():
    shut = SemiProjection(np.zeros(1), np.zeros((2, 1)), np.array([[1.0], [-1.0]]), np.array([1.0, 0.0]), 0)
    open_to_one = replace(shut, bound=np.array([1.0, -2.0]))
    for problem, projector in (
        (shut, project),
        (shut, ActiveSetProjector()),
        (open_to_one, lambda target, rows: None),
    ):
        with pytest.raises(LevelFailed) as caught:
            semi_project(problem, np.zeros(1), projector)
        assert caught.value.status is SolveStatus.INFEASIBLE
    assert semi_project(open_to_one, np.zeros(1), ActiveSetProjector()).p == pytest.approx([0.0])


# --- Active sets that grow


def rows_of(rng: np.random.Generator, count: int, n_equal: int = 0) -> LinearConstraints:
    matrix = rng.normal(size=(count, 5))
    matrix /= np.linalg.norm(matrix, axis=1, keepdims=True)
    return LinearConstraints(matrix, 0.2 + 0.2 * rng.normal(size=count), ("row:x",) * count, n_equal)


def test_repeated_and_implied_rows_change_nothing():
    rng = np.random.default_rng(0)
    for seed in range(6):
        rows = rows_of(np.random.default_rng(seed), 6, 2)
        target = 2.0 * rng.normal(size=5)
        plain = project(target, rows)
        if plain is None:
            continue
        twice = stack_constraints(
            [rows, LinearConstraints(rows.matrix[:1], rows.bound[:1], ("tie:x",), 1)], 5
        )
        twice = stack_constraints(
            [twice, LinearConstraints(rows.matrix[2:], rows.bound[2:], rows.labels[2:])], 5
        )
        found = ActiveSetProjector()(target, twice)
        assert found is not None
        assert np.allclose(found.z, plain.z, atol=1e-9)
        assert np.allclose(found.z - target, twice.matrix.T @ found.multipliers, atol=1e-9)
        assert (found.multipliers[twice.n_equal :] >= -1e-12).all()


def test_equalities_that_contradict_each_other_have_no_point():
    row = np.eye(5)[:1]
    apart = LinearConstraints(np.vstack([row, row]), np.array([1.0, 1.0 + 1e-6]), ("tie:a", "tie:b"), 2)
    assert ActiveSetProjector()(np.zeros(5), apart) is None
    same = LinearConstraints(np.vstack([row, row]), np.array([1.0, 1.0]), ("tie:a", "tie:b"), 2)
    found = ActiveSetProjector()(np.zeros(5), same)
    assert found is not None and found.z == pytest.approx([1.0, 0.0, 0.0, 0.0, 0.0])


def test_other_rows_or_another_target_start_anew():
    """One projector through many problems gives what a new one gives for each."""
    keeper, rng = ActiveSetProjector(), np.random.default_rng(7)
    target = rng.normal(size=5)
    rows = rows_of(rng, 8, 1)
    cases = [
        (target, rows),
        (target, LinearConstraints(rows.matrix, rows.bound + 0.1, rows.labels, 1)),
        (target, LinearConstraints(-rows.matrix, rows.bound, rows.labels, 1)),
        (target, LinearConstraints(rows.matrix[:4], rows.bound[:4], rows.labels[:4], 1)),
        (target, LinearConstraints(rows.matrix, rows.bound, rows.labels, 0)),
        (target + 1.0, rows),
        (target + 1.0, rows),
        (target[:4], LinearConstraints(rows.matrix[:, :4], rows.bound, rows.labels, 1)),
    ]
    for goal, given in cases:
        kept, fresh = keeper(goal, given), project(goal, given)
        assert (kept is None) == (fresh is None)
        if kept is not None and fresh is not None:
            assert np.allclose(kept.z, fresh.z, atol=1e-9)
            assert np.allclose(kept.multipliers, fresh.multipliers, atol=1e-7)


def test_after_a_failure_it_starts_anew():
    row = np.eye(5)[:1]
    apart = LinearConstraints(np.vstack([row, -row]), np.array([1.0, 1.0]), ("a:x", "b:x"))
    projector = ActiveSetProjector()
    assert projector(np.zeros(5), apart) is None
    one = LinearConstraints(row, np.array([1.0]), ("a:x",))
    found = projector(np.zeros(5), one)
    assert found is not None and found.z == pytest.approx([1.0, 0.0, 0.0, 0.0, 0.0])
    assert projector(np.zeros(5), apart) is None
