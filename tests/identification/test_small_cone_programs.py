"""Cone programs that are small enough to be solved by hand, and what becomes of answers that are not good enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import NoSolutionError
from excite.identification.constraints.cones import Cones
from excite.identification.constraints.linear import LinearConstraints, stack_constraints
from excite.identification.estimators import conic as module
from excite.identification.estimators.conic import (
    ConicAnswer,
    ConicProblem,
    Program,
    conic_distance,
    conic_estimate,
    conic_violations,
    consistent_or_raised,
    interior_point,
    refine_answer,
)
from excite.identification.estimators.estimator import Estimate, SolveStatus, estimate_at
from excite.identification.estimators.scaled_problem import Ridge, build_ridge
from excite.identification.estimators.settings import PullSettings
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights
from excite.robot.loading import load_robot
from tests.identification.synthetic import arm_problem


def rows(matrix: list, bound: list, n_equal: int = 0) -> LinearConstraints:
    labels = tuple(f"row:{k}" for k in range(len(bound)))
    return LinearConstraints(np.array(matrix, dtype=float), np.array(bound, dtype=float), labels, n_equal)


def arrow(n: int = 4) -> Cones:
    """``z₀ ≥ ‖(z₁, z₂, z₃)‖``."""
    return Cones(0, np.eye(4, n)[None], np.zeros((1, 4)), ("com:a",))


def nothing(problem: ConicProblem) -> ConicAnswer:
    """An answer that knows nothing: some point and no multipliers."""
    count = len(problem.linear.bound) + sum(cones.bound.size for cones in problem.cones)
    return ConicAnswer(problem.target + 100.0, np.zeros(count))


FREE = stack_constraints([], 4)
# Target, and the nearest point of the cone: inside, opposite, and outside at (t + ‖v‖)/2 · (1, v/‖v‖).
ARROWS = [
    ((5.0, 3.0, 0.0, 4.0 - 1e-3), (5.0, 3.0, 0.0, 4.0 - 1e-3)),
    ((-6.0, 3.0, 4.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
    ((1.0, 0.0, 3.0, 4.0), (3.0, 0.0, 1.8, 2.4)),
    ((-1.0, 3.0, 0.0, 4.0), (2.0, 1.2, 0.0, 1.6)),
]


@pytest.mark.parametrize(("target", "expected"), ARROWS)
def test_the_nearest_point_of_an_arrow(target, expected):
    problem = ConicProblem(np.array(target), FREE, (arrow(),))
    for start in (interior_point(problem), interior_point(problem, 1e-3), nothing(problem)):
        found = refine_answer(problem, start)
        assert found.z == pytest.approx(expected, abs=1e-9)
        # Of a cone at the origin, the multiplier is what is missing.
        assert found.multipliers == pytest.approx(np.array(expected) - target, abs=1e-9)
        assert conic_distance(problem, found) < 1e-6
        assert max(conic_violations(problem, found.z).values()) < 1e-9


def test_an_arrow_cut_by_a_plane():
    """``z₀ = 1`` leaves the unit ball: the nearest point is on the ray to the target."""
    problem = ConicProblem(np.array([7.0, 6.0, 0.0, 8.0]), rows([[1, 0, 0, 0]], [1], 1), (arrow(),))
    for start in (interior_point(problem), nothing(problem)):
        found = refine_answer(problem, start)
        assert found.z == pytest.approx([1.0, 0.6, 0.0, 0.8], abs=1e-9)
        # The cone pushes back by what is missing, first entry as long as the others together; the plane does the rest.
        assert found.multipliers == pytest.approx([-6.0 - 9.0, 9.0, -5.4, 0.0, -7.2], abs=1e-7)


def test_bounds_that_are_reached_and_bounds_that_are_not():
    """A box: each coordinate on its own, its multiplier the distance that the bound pushes."""
    box = rows([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, -1]], [1, -1, -2, 3])
    problem = ConicProblem(np.array([0.0, 0.0, 5.0, 5.0]), box, ())
    for start in (interior_point(problem), nothing(problem), interior_point(problem, 1e-2)):
        found = refine_answer(problem, start)
        assert found.z == pytest.approx([1.0, 0.0, 2.0, -3.0], abs=1e-12)
        assert found.multipliers == pytest.approx([1.0, 0.0, 3.0, 8.0], abs=1e-10)


# --- From a program to an estimate


@pytest.fixture(scope="module")
def arm() -> IdentificationProblem:
    return arm_problem(load_robot("panda"), seed=8, duration=1.0, noise=0.02, error=0.01)


@pytest.fixture(scope="module")
def weighted(arm) -> Regression:
    return iterate_weights(condense_problem(arm))


@pytest.fixture(scope="module")
def objective(weighted) -> Ridge:
    return build_ridge(weighted, PullSettings())


def heavier(arm: IdentificationProblem, kg: float) -> LinearConstraints:
    """All segments together at least some kilograms heavier than nominal."""
    row = np.zeros(arm.n_params)
    row[: arm.n_inertial : 10] = 1.0
    return LinearConstraints(row[None], np.array([row @ arm.prior + kg]), ("total_mass:all",))


def moved_by(step: float, scale: float = 1.0):
    """A solver whose answer is off by a step along the first row, with scaled multipliers."""

    def solver(problem: ConicProblem) -> ConicAnswer:
        true = refine_answer(problem, interior_point(problem))
        return ConicAnswer(true.z + step * problem.linear.matrix[0], scale * true.multipliers)

    return solver


class TestEstimates:
    @pytest.fixture(autouse=True)
    def unrefined(self, monkeypatch):
        """Answers stay as the solver gives them."""
        monkeypatch.setattr(module, "refine_answer", lambda problem, answer: answer)

    def solve(self, solver, arm, weighted, objective) -> Estimate:
        return conic_estimate("lmi", weighted, Program(objective, heavier(arm, 1.0), ()), solver)

    def test_a_plane_is_reached_at_the_foot_of_the_perpendicular(self, arm, weighted, objective):
        best = self.solve(moved_by(0.0), arm, weighted, objective)
        row = objective.constraints(heavier(arm, 1.0))
        missing = float(row.bound[0] - row.matrix[0] @ objective.target)
        assert missing > 0.1, "the row binds"
        expected = objective.parameters(objective.target + missing * row.matrix[0])
        assert np.allclose(best.parameters, expected, atol=1e-9)
        assert best.active == ("total_mass:all",) and best.violations == {
            "total_mass": pytest.approx(0.0, abs=1e-9)
        }
        assert best.status is SolveStatus.SOLVED and best.distance < 1e-5

    @pytest.mark.parametrize(
        ("step", "status"),
        [
            (-1e-10, None),
            # Its violation is allowed, its distance is not.
            (-0.5e-5, "not optimal"),
            (-2e-5, "violated"),
            (0.5, "not optimal"),
            (np.nan, "not finite"),
        ],
    )
    def test_an_answer_is_judged_by_itself(self, step, status, arm, weighted, objective):
        solver = moved_by(step)
        if status is None:
            # A hair outside: its violation is allowed.
            best = self.solve(solver, arm, weighted, objective)
            assert best.status is SolveStatus.SOLVED
            assert best.violations["total_mass"] == pytest.approx(-step, abs=1e-9)
            return
        with pytest.raises(NoSolutionError, match=rf"^method lmi found no solution \({status}\)") as caught:
            self.solve(solver, arm, weighted, objective)
        best = caught.value.best
        assert best.method == "lmi" and best.status.name.lower().replace("_", " ") == status
        assert caught.value.remedy == best.status.value
        assert np.isfinite(best.parameters).all() and best.distance == np.inf

    def test_what_is_known_is_better_than_nothing(self, arm, weighted, objective):
        """An answer inside the rows but far: the best point known meets them and is no farther than it."""
        with pytest.raises(NoSolutionError) as caught:
            self.solve(moved_by(3.0), arm, weighted, objective)
        row = objective.constraints(heavier(arm, 1.0))
        z = objective.coordinates(caught.value.best.parameters)
        assert row.violations(z).max() <= 1e-7
        missing = float(row.bound[0] - row.matrix[0] @ objective.target)
        assert np.linalg.norm(z - objective.target) <= missing + 3.0 + 1e-9


class TestBodiesThatExist:
    def body(self, arm, weighted, eigenvalue: float, segment: int) -> Estimate:
        """Nominal bodies, one of them with this least eigenvalue of its pseudo-inertia."""
        parameters = arm.prior.copy()
        # diag(Σ) = (1, 1, e) kg·m² about the joint frame, mass 1: the inertia is tr(Σ)·1 − Σ.
        parameters[10 * segment : 10 * segment + 10] = [
            1,
            0,
            0,
            0,
            1 + eigenvalue,
            0,
            1 + eigenvalue,
            0,
            0,
            2,
        ]
        return estimate_at("lmi", weighted, parameters, SolveStatus.SOLVED)

    @pytest.mark.parametrize("segment", [0, 3])
    def test_rounding_is_let_pass_and_nothing_more(self, segment, arm, weighted):
        for fine in (0.1, 0.0, -0.5e-9):
            best = self.body(arm, weighted, fine, segment)
            assert consistent_or_raised(best) is best
        with pytest.raises(NoSolutionError, match=r"\(violated\)") as caught:
            consistent_or_raised(self.body(arm, weighted, -2e-9, segment))
        assert caught.value.best.status is SolveStatus.VIOLATED

    def test_what_is_not_seen_is_not_judged(self, arm, weighted):
        wrong = self.body(arm, weighted, -1.0, 2)
        unseen = replace(weighted, problem=replace(arm, unmeasured=(2,)))
        assert consistent_or_raised(replace(wrong, regression=unseen)).parameters is wrong.parameters
        with pytest.raises(NoSolutionError):
            consistent_or_raised(replace(self.body(arm, weighted, -1.0, 3), regression=unseen))
