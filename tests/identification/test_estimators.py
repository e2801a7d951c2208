"""Every estimator against closed forms, and the checks that do not trust a solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from excite.errors import InputError, NoSolutionError, UnknownNameError
from excite.identification.constraints.linear import equivalent_boxes
from excite.identification.estimators.conic import QpSettings, QuadraticProgram
from excite.identification.estimators.estimator import Estimate, SolveStatus
from excite.identification.estimators.least_squares import LeastSquares, LsSettings
from excite.identification.estimators.method_settings import estimator_settings
from excite.identification.estimators.registry import ESTIMATORS, find_estimator
from excite.identification.inertia import inertia_matrices
from excite.identification.judgement import check_consistency
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import condense_problem, iterate_weights, prior_std
from tests.identification.icosphere import icosphere_corners
from tests.identification.synthetic import modified_g1_parameters, segment_index, wrench_problem

FEET = ("left_ankle_roll_link", "right_ankle_roll_link")


@pytest.fixture(scope="module")
def problem(g1) -> IdentificationProblem:
    feet = tuple(segment_index(g1, link) for link in FEET)
    return wrench_problem(g1, modified_g1_parameters(g1), seed=1, trials=2, duration=8.0, unmeasured=feet)


@pytest.fixture(scope="module")
def validation(g1) -> IdentificationProblem:
    feet = tuple(segment_index(g1, link) for link in FEET)
    return wrench_problem(g1, modified_g1_parameters(g1), seed=2, trials=1, duration=8.0, unmeasured=feet)


@pytest.fixture(scope="module")
def estimates(problem) -> Callable[[str], Estimate]:
    """The estimate of a method with default settings, computed once."""
    return cache(lambda name: find_estimator(name).estimate(problem, estimator_settings(name)))


@pytest.mark.parametrize("name", sorted(ESTIMATORS))
class TestEveryEstimator:
    def test_says_what_it_is_and_guarantees(self, name):
        estimator = find_estimator(name)
        assert estimator.name == name and estimator.title and estimator.guarantees
        assert all(estimator.exempt.values()), "an exemption needs its reason"

    def test_prediction_reaches_the_noise(self, name, validation, estimates):
        estimator = find_estimator(name)
        if "prediction" in estimator.exempt:
            pytest.skip(f"{name}: {estimator.exempt['prediction']}")
        estimate = estimates(name)
        residual = validation.residual(estimate.parameters) * validation.weights
        assert np.sqrt(np.mean(residual**2)) < 1.6

    def test_residual_is_that_of_the_parameters(self, name, problem, estimates):
        estimate = estimates(name)
        weighted = problem.residual(estimate.parameters) / estimate.regression.std[problem.channel]
        assert estimate.residual == pytest.approx(np.sqrt(np.mean(weighted**2)), rel=1e-12)
        assert estimate.status is SolveStatus.SOLVED

    def test_same_problem_same_bytes_and_nothing_changed(self, name, problem, estimates):
        before = problem.Y.tobytes(), problem.y.tobytes(), problem.prior.tobytes()
        first = estimates(name)
        second = find_estimator(name).estimate(problem, estimator_settings(name))
        assert first.parameters.tobytes() == second.parameters.tobytes()
        assert before == (problem.Y.tobytes(), problem.y.tobytes(), problem.prior.tobytes())

    def test_unmeasured_segments_stay_nominal(self, name, problem, g1, estimates):
        estimate = estimates(name)
        for link in FEET:
            columns = g1.parameter_columns(segment_index(g1, link))
            np.testing.assert_array_equal(estimate.parameters[columns], problem.prior[columns])

    def test_promise_of_consistency_holds(self, name, g1, estimates):
        estimator = find_estimator(name)
        if not estimator.consistent:
            pytest.skip(f"{name} does not promise consistent bodies")
        found = check_consistency(estimates(name).parameters, tuple(s.link for s in g1.segments))
        assert found.triangle_inequality and found.mass_positive and found.inertia_positive_definite
        assert found.pseudo_inertia_min_eigenvalue > 0.0

    def test_rows_that_are_not_finite_are_refused(self, name, problem):
        y = problem.y.copy()
        y[7] = np.nan
        with pytest.raises(InputError, match="finite"):
            find_estimator(name).estimate(replace(problem, y=y), estimator_settings(name))


def test_registry_refuses_unknown_names():
    with pytest.raises(UnknownNameError, match="qp"):
        find_estimator("best")


def test_ls_is_the_pseudo_inverse(problem):
    """Eq. (5) of Jovic et al. 2016: φ = Y⁺ f, against numpy on the rows themselves."""
    seen = np.flatnonzero(np.abs(problem.Y).max(axis=0) > 0.0)
    expected = np.linalg.lstsq(problem.Y[:, seen], problem.y, rcond=1e-8)[0]
    found = LeastSquares().estimate(problem, LsSettings()).parameters[seen]
    np.testing.assert_allclose(problem.Y[:, seen] @ found, problem.Y[:, seen] @ expected, atol=1e-6)
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(expected), rel=1e-3)


def test_qp_without_active_constraints_is_ridge_regression(g1):
    """Eq. (4) of Jovic et al. 2015 with constraints that do not bind has a closed form."""
    problem = wrench_problem(g1, g1.nominal_parameters, seed=4, trials=1, duration=6.0, noise=0.05)
    wide = equivalent_boxes(g1, growth=40.0)
    settings = QpSettings(com_boxes=wide, inertia_floor=0.0, prior_spread=0.01, total_mass=None, alpha=3.0)
    rows = iterate_weights(condense_problem(problem))
    found = QuadraticProgram().estimate(problem, settings)
    scales = prior_std(problem, 0.01)
    weights = 1.0 / (rows.std * np.sqrt(rows.noise.inflation))[problem.channel]
    a = np.vstack([problem.Y * weights[:, None] * scales, np.sqrt(3.0) * np.eye(problem.n_params)])
    b = np.concatenate([problem.residual(problem.prior) * weights, np.zeros(problem.n_params)])
    total = np.zeros(problem.n_params)
    total[: problem.n_inertial : 10] = scales[: problem.n_inertial : 10]
    # The one equality, the total mass, by its Lagrange multiplier.
    free = np.linalg.lstsq(a, b, rcond=None)[0]
    inverse = np.linalg.inv(np.linalg.qr(a, mode="r"))
    direction = inverse @ (inverse.T @ total)
    excess = total @ free - (found.total_mass - problem.prior[: problem.n_inertial : 10].sum())
    expected = free - direction * excess / (total @ direction)
    np.testing.assert_allclose((found.parameters - problem.prior) / scales, expected, atol=1e-8)
    assert set(label.split(":")[0] for label in found.active) == {"total_mass"}


class TestConstraintsOfTheProgram:
    def test_hold_when_recomputed(self, problem, g1):
        boxes = equivalent_boxes(g1)
        settings = QpSettings(total_mass=40.0, com_boxes=boxes, alpha=1e-6, inertia_floor=0.05)
        parameters = QuadraticProgram().estimate(problem, settings).parameters
        mass, first = parameters[::10], parameters.reshape(-1, 10)[:, 1:4]
        assert mass.sum() == pytest.approx(40.0, abs=1e-6)
        assert (mass >= -1e-9).all()
        assert (first >= boxes[:, 0] * mass[:, None] - 1e-7).all()
        assert (first <= boxes[:, 1] * mass[:, None] + 1e-7).all()
        least = np.linalg.eigvalsh(inertia_matrices(parameters))[:, 0]
        nominal = np.linalg.eigvalsh(inertia_matrices(problem.prior))[:, 0]
        assert (least >= 0.05 * nominal * (1 - 1e-6)).all()

    def test_all_sphere_vectors_hold(self, problem):
        """Eq. (13) of Jovic et al. 2016 on its 10 242 vectors, evaluated directly."""
        parameters = QuadraticProgram().estimate(problem, QpSettings()).parameters
        vectors = icosphere_corners(5)
        assert vectors.shape == (10242, 3)
        values = np.einsum("vi,sij,vj->sv", vectors, inertia_matrices(parameters), vectors)
        assert values.min() > 0.0

    def test_symmetry_makes_pairs_equal(self, g1, problem):
        pairs = [(i, s.pair) for i, s in enumerate(g1.segments) if s.pair is not None and s.pair > i]
        assert pairs, "the robot names no pairs"
        parameters = QuadraticProgram().estimate(problem, QpSettings(symmetry=0.0)).parameters
        for left, right in pairs:
            assert parameters[10 * left] == pytest.approx(parameters[10 * right], abs=1e-6)
            mirrored = parameters[10 * left + 1 : 10 * left + 4] * [1, -1, 1]
            nominal = problem.prior[10 * left + 1 : 10 * left + 4] * [1, -1, 1]
            asymmetry = problem.prior[10 * right + 1 : 10 * right + 4] - nominal
            np.testing.assert_allclose(
                parameters[10 * right + 1 : 10 * right + 4], mirrored + asymmetry, atol=1e-5
            )

    def test_contradiction_is_reported_with_the_best_found(self, problem, g1):
        frozen = sum(problem.prior[10 * k] for k in problem.unmeasured)
        with pytest.raises(NoSolutionError, match="infeasible") as caught:
            QuadraticProgram().estimate(problem, QpSettings(total_mass=0.5 * frozen))
        assert np.isfinite(caught.value.best.parameters).all()
