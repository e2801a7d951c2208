"""Cone programs: projections, derivatives, refinement, certificates, and solvers that lie."""

from __future__ import annotations

import numpy as np
import pytest

from excite.errors import InputError, NoSolutionError
from excite.identification.constraints.cones import body_ellipsoids, com_ellipsoids
from excite.identification.constraints.linear import equivalent_boxes
from excite.identification.estimators.conic import (
    Cls3Settings,
    ConicProblem,
    DensityRealisable,
    PhysicallyConsistent,
    PhysicallyFeasible,
    QuadraticProgram,
    interior_point,
)
from excite.identification.estimators.estimator import SolveStatus
from excite.identification.estimators.projection import ProjectionAnswer
from excite.identification.estimators.scaled_problem import pullback_metric
from excite.identification.inertia import central_inertia_matrices, inertia_matrices, pseudo_inertia_matrices
from excite.identification.judgement import check_consistency
from excite.identification.problem import IdentificationProblem
from excite.robot.loading import load_robot
from tests.identification.estimated import estimated
from tests.identification.synthetic import arm_problem, segment_index, wrench_problem

CONIC = (PhysicallyConsistent, DensityRealisable, PhysicallyFeasible, QuadraticProgram)
# A weak pull lets noise push bodies out of what can exist, so that the cones bind.
WEAK = dict(alpha=1e-2, inertia_floor=0.0)


@pytest.fixture(scope="module")
def problem() -> IdentificationProblem:
    return arm_problem(load_robot("panda"), seed=5, duration=2.0, noise=0.3)


class TestGuarantees:
    @pytest.mark.parametrize("kind", CONIC)
    def test_hold_when_recomputed_and_the_cones_bind(self, kind, problem):
        found = estimated(kind(), problem, **WEAK)
        parameters = found.parameters
        assert (parameters[::10] >= -1e-9).all()
        # qp promises them about the joint frames, the others about the centres of mass.
        moments = inertia_matrices if kind is QuadraticProgram else central_inertia_matrices
        assert np.linalg.eigvalsh(moments(parameters)).min() > -1e-9
        least = np.linalg.eigvalsh(pseudo_inertia_matrices(parameters))[:, 0]
        if kind.consistent:
            assert least.min() >= -1e-9
            assert least.min() < 1e-6, "nothing binds: the test shows nothing"
        else:
            assert least.min() < -1e-4, (
                f"{kind.name} does not promise the triangle inequality; here it breaks"
            )

    def test_cls3_centres_and_masses_lie_in_their_ellipsoids(self, problem):
        """Eq. (6) of Golluccio et al. 2020, and tr(J Q) ≥ 0, from the parameters."""
        boxes = equivalent_boxes(problem.robot, growth=0.05)
        settings = dict(WEAK, com_boxes=boxes)
        parameters = estimated(DensityRealisable(), problem, **settings).parameters
        pseudo = pseudo_inertia_matrices(parameters)
        bodies = body_ellipsoids(problem.prior, boxes)
        assert np.einsum("sij,sij->s", pseudo, bodies).min() > -1e-6
        ten = parameters.reshape(-1, 10)
        point = np.column_stack([ten[:, 1:4], ten[:, 0]])
        value = np.einsum("si,sij,sj->s", point, com_ellipsoids(problem.prior, boxes), point)
        assert (value > -1e-6 * ten[:, 0] ** 2).all()
        assert value.min() < 1e-4, "no ellipsoid binds"

    def test_cls2_bounds_hold(self, problem):
        settings = dict(WEAK, bound_width=0.2)
        ten = estimated(PhysicallyFeasible(), problem, **settings).parameters.reshape(-1, 10)
        nominal = problem.prior.reshape(-1, 10)[:, 0]
        assert (np.abs(ten[:, 0] - nominal) <= 0.2 * 0.5 * nominal + 1e-6).all()

    def test_matrix_that_is_no_ellipsoid_is_refused_by_its_link(self, problem):
        wrong = com_ellipsoids(problem.prior, equivalent_boxes(problem.robot))
        wrong[2] = np.eye(4)
        with pytest.raises(InputError, match=r"panda_link3|link3"):
            DensityRealisable().estimate(problem, Cls3Settings(com_ellipsoids=wrong))


def test_nominal_bodies_fit_into_their_ellipsoids(g1):
    """However small the boxes are."""
    nominal = g1.nominal_parameters
    boxes = equivalent_boxes(g1, growth=0.1)
    pseudo = pseudo_inertia_matrices(nominal)
    assert (np.einsum("sij,sij->s", pseudo, body_ellipsoids(nominal, boxes)) > 0.0).all()
    ten = nominal.reshape(-1, 10)
    point = np.column_stack([ten[:, 1:4] / ten[:, :1], np.ones(len(ten))])
    assert (np.einsum("si,sij,sj->s", point, com_ellipsoids(nominal, boxes), point) > 0.0).all()


class TestLyingSolvers:
    """The answer is right or refused; refinement may turn a bad answer into the right one."""

    @pytest.mark.parametrize("kind", CONIC)
    @pytest.mark.parametrize("lie", ["ignores", "far", "nan", "infeasible"])
    def test_is_caught(self, kind, lie, problem):
        honest = estimated(kind(), problem, **WEAK)

        def liar(conic: ConicProblem) -> ProjectionAnswer:
            true = interior_point(conic)
            if lie == "ignores":
                return ProjectionAnswer(conic.target.copy(), np.zeros_like(true.multipliers))
            if lie == "far":
                return ProjectionAnswer(true.z + 10.0, 3.0 * np.abs(true.multipliers) + 1.0)
            if lie == "nan":
                return ProjectionAnswer(np.full_like(true.z, np.nan), true.multipliers)
            return ProjectionAnswer(true.z, true.multipliers, infeasible=True)

        try:
            found = estimated(kind(liar), problem, **WEAK)
        except NoSolutionError as error:
            assert (error.exit_code == 3 and np.isfinite(error.best.residual)) or lie == "nan"
            assert error.best.status is not SolveStatus.SOLVED or lie == "infeasible"
            return
        assert lie in ("ignores", "far")
        np.testing.assert_allclose(found.parameters, honest.parameters, atol=1e-5)


@pytest.mark.parametrize("kind", [PhysicallyConsistent, DensityRealisable, QuadraticProgram])
@pytest.mark.parametrize("regulariser", ["euclidean", "pullback"])
def test_contradiction_is_reported(kind, regulariser, g1):
    """A total mass below that of the feet, which stay nominal."""
    feet = tuple(segment_index(g1, link) for link in ("left_ankle_roll_link", "right_ankle_roll_link"))
    standing = wrench_problem(g1, g1.nominal_parameters, seed=0, trials=1, duration=4.0, unmeasured=feet)
    settings = dict(total_mass=0.5, regulariser=regulariser)
    with pytest.raises(NoSolutionError, match="infeasible") as caught:
        estimated(kind(), standing, **settings)
    assert np.isfinite(caught.value.best.parameters).all()


class TestGeometricDistances:
    def test_pullback_is_its_trace(self, problem):
        """‖B (θ − θ₀)/s‖² = tr((P₀⁻¹ΔP)²)/(4σ²), with the trace taken directly."""
        n = len(problem.robot.segments)
        spreads, scales = np.linspace(0.2, 1.0, n), np.full(problem.n_params, 2.0)
        change = 0.01 * np.random.default_rng(0).normal(size=problem.n_params) * np.abs(problem.prior)
        metric = pullback_metric(problem, spreads, scales)
        nominal = pseudo_inertia_matrices(problem.prior)
        ratio = np.linalg.solve(nominal, pseudo_inertia_matrices(change))
        expected = (np.einsum("sij,sji->s", ratio, ratio) / (4.0 * spreads**2)).sum()
        assert np.sum((metric @ (change / scales)) ** 2) == pytest.approx(expected, rel=1e-6)

    @pytest.mark.parametrize("regulariser", ["euclidean", "pullback"])
    @pytest.mark.parametrize("alpha", [1e-4, 1.0, 1e3])
    def test_bodies_can_exist_whatever_the_weight(self, regulariser, alpha, problem):
        settings = dict(regulariser=regulariser, alpha=alpha)
        found = estimated(PhysicallyConsistent(), problem, **settings)
        names = tuple(segment.link for segment in problem.robot.segments)
        assert check_consistency(found.parameters, names).pseudo_inertia_min_eigenvalue >= -1e-9
