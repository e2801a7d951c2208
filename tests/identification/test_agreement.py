"""Estimators agree to 1e-8 where theory says that they do, whatever way each of them takes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from excite.identification.constraints.cones import ellipsoid_matrix
from excite.identification.constraints.linear import equivalent_boxes
from excite.identification.estimators.conic import (
    DensityRealisable,
    PhysicallyConsistent,
    PhysicallyFeasible,
    QuadraticProgram,
)
from excite.identification.estimators.hqp import BoundedNearBase, HierarchicalProgram
from excite.identification.estimators.least_squares import (
    LeastSquares,
    LsSettings,
    MaximumAPosteriori,
    WeightedLeastSquares,
    WlsSettings,
)
from excite.identification.estimators.physical import PhysicalRetrieval
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import prior_std
from excite.identification.statistics import base_statistics
from excite.robot.loading import load_robot
from tests.identification.estimated import estimated
from tests.identification.synthetic import arm_problem, wrench_problem

AGREE = 1e-8


@pytest.fixture(scope="module", params=[0, 1, 2])
def problem(request) -> IdentificationProblem:
    """An arm whose bodies differ from the model by a tenth, in three random motions."""
    return arm_problem(load_robot("panda"), seed=request.param)


def no_levels(rows, settings, scaled):
    """A hierarchy of the fit and the nearest point alone."""
    return ()


def in_spreads(problem: IdentificationProblem, settings: dict[str, Any], difference: np.ndarray) -> float:
    """Largest difference in units of the spreads."""
    return float(np.abs(difference / prior_std(problem, settings.get("prior_spread", 0.5))).max())


class TestLeastSquares:
    def test_ls_is_wls_with_unit_weights(self, problem):
        unit = replace(problem, weights=np.ones(problem.n_rows))
        settings = dict(ls_reference="nominal", weight_iterations=0)
        a = estimated(LeastSquares(), unit, **settings).parameters
        b = estimated(WeightedLeastSquares(), unit, **settings).parameters
        assert in_spreads(problem, settings, a - b) < AGREE

    def test_both_norms_fit_alike(self, problem):
        zero = LeastSquares().estimate(problem, LsSettings())
        nominal = LeastSquares().estimate(problem, LsSettings(ls_reference="nominal"))
        assert zero.residual == pytest.approx(nominal.residual, rel=1e-9)
        assert np.linalg.norm(zero.parameters) < np.linalg.norm(nominal.parameters)

    def test_wls_with_stated_weights_is_ls_on_rows_multiplied_by_them(self, problem):
        settings = dict(ls_reference="nominal", weight_iterations=0)
        weight = problem.weights
        scaled = replace(
            problem, Y=problem.Y * weight[:, None], y=problem.y * weight, weights=np.ones(problem.n_rows)
        )
        a = estimated(LeastSquares(), scaled, **settings).parameters
        b = estimated(WeightedLeastSquares(), problem, **settings).parameters
        assert in_spreads(problem, settings, a - b) < AGREE

    def test_base_parameters_of_wls_are_the_least_squares_base_parameters(self, problem):
        found = WeightedLeastSquares().estimate(problem, WlsSettings())
        statistics = base_statistics(found.regression)
        difference = statistics.base.values(found.parameters) - statistics.estimate
        assert np.abs(difference / statistics.std).max() < AGREE

    def test_hqp_whose_levels_do_not_bind_is_wls(self):
        problem = arm_problem(load_robot("panda"), seed=0, error=0.02, noise=1e-3)
        wide = equivalent_boxes(problem.robot, growth=40.0)
        settings = dict(sphere_epsilon=0.0, mirror=None, mass_range=1e6, com_boxes=wide)
        found = estimated(HierarchicalProgram(), problem, **settings)
        expected = estimated(WeightedLeastSquares(), problem, **settings).parameters
        assert not found.active
        assert in_spreads(problem, settings, found.parameters - expected) < AGREE

    def test_physical_whose_bounds_do_not_bind_leaves_what_ls_leaves(self):
        """Eq. (15) of Xu et al. 2020 over all base parameters: its least value is that of least squares."""
        problem = arm_problem(load_robot("panda"), seed=0, error=0.02)
        settings = dict(ls_reference="nominal")
        physical = estimated(PhysicalRetrieval(essential=False), problem, **settings)
        plain = estimated(LeastSquares(), problem, **settings)
        assert physical.residual == pytest.approx(plain.residual, rel=AGREE)
        difference = problem.Y @ (physical.parameters - plain.parameters)
        assert np.linalg.norm(difference) < AGREE * np.linalg.norm(problem.y)

    def test_hqp_without_constraint_levels_is_the_least_squares_solution_nearest_to_nominal(self, problem):
        settings = dict()
        found = estimated(HierarchicalProgram(levels=no_levels), problem, **settings)
        scales = prior_std(problem, 0.5)
        weights = 1.0 / found.regression.std[problem.channel]
        inverse = np.linalg.pinv(problem.Y * weights[:, None] * scales, rcond=1e-8)
        expected = problem.prior + scales * (inverse @ (problem.residual(problem.prior) * weights))
        assert in_spreads(problem, settings, found.parameters - expected) < AGREE

    def test_cls1_with_bounds_that_do_not_bind_is_wls(self, problem):
        limits = np.full((2, problem.n_params), np.inf) * np.array([[-1.0], [1.0]])
        settings = dict(parameter_bounds=limits)
        a = estimated(BoundedNearBase(), problem, **settings).parameters
        b = estimated(WeightedLeastSquares(), problem, **settings).parameters
        assert in_spreads(problem, settings, a - b) < AGREE


class TestConstrained:
    @pytest.mark.parametrize("seed", [0, 1])
    def test_all_are_ridge_regression_where_nothing_binds(self, seed):
        """The model is right and the noise small: all stay near the model, where every constraint holds by far."""
        problem = arm_problem(load_robot("panda"), seed=seed, error=0.0, noise=1e-3)
        wide = equivalent_boxes(problem.robot, growth=40.0)
        settings = dict(prior_spread=0.01, inertia_floor=0.0, com_boxes=wide, bound_width=1e3)
        expected = estimated(MaximumAPosteriori(), problem, **settings).parameters
        for estimator in (
            QuadraticProgram(),
            PhysicallyConsistent(),
            DensityRealisable(),
            PhysicallyFeasible(),
        ):
            found = estimated(estimator, problem, **settings)
            assert in_spreads(problem, settings, found.parameters - expected) < AGREE, found.method

    def test_all_that_know_the_total_mass_agree_where_it_alone_binds(self, g1):
        problem = wrench_problem(g1, g1.nominal_parameters, seed=4, trials=1, duration=6.0, noise=0.05)
        wide = equivalent_boxes(g1, growth=40.0)
        settings = dict(com_boxes=wide, inertia_floor=0.0, prior_spread=0.01)
        expected = estimated(QuadraticProgram(), problem, **settings)
        for estimator in (PhysicallyConsistent(), DensityRealisable()):
            found = estimated(estimator, problem, **settings)
            assert found.active == expected.active == ("total_mass:robot",)
            assert in_spreads(problem, settings, found.parameters - expected.parameters) < AGREE

    def test_cls3_is_lmi_when_ellipsoids_and_boxes_do_not_bind(self, problem):
        n = len(problem.robot.segments)
        huge = ellipsoid_matrix(np.zeros((n, 3)), np.full((n, 3), 50.0))
        boxes = np.tile(np.array([[-40.0] * 3, [40.0] * 3]), (n, 1, 1))
        settings = dict(
            com_boxes=boxes, com_ellipsoids=huge, body_ellipsoids=huge, alpha=0.1, inertia_floor=0.01
        )
        a = estimated(DensityRealisable(), problem, **settings)
        b = estimated(PhysicallyConsistent(), problem, **settings)
        free = estimated(MaximumAPosteriori(), problem, **settings)
        # The cones do bind: otherwise this would only repeat the test above.
        assert in_spreads(problem, settings, b.parameters - free.parameters) > 1e-3
        assert in_spreads(problem, settings, a.parameters - b.parameters) < AGREE
