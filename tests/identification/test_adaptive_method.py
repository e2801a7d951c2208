"""The default method: its settings, what it minimises, what its drives cost, and what its bodies keep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import NoSolutionError
from excite.identification.constraints.cones import segment_scales
from excite.identification.estimators.conic import (
    Adaptive,
    AdaptiveSettings,
    ConicProblem,
    interior_point,
)
from excite.identification.estimators.estimator import Estimate, SolveStatus
from excite.identification.estimators.projection import ProjectionAnswer
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import prior_std
from excite.robot.loading import load_robot
from tests.identification.synthetic import arm_problem

# Standard deviations of the two drive parameters about their prior.
SPREAD = np.array([0.3, 0.05])


@pytest.fixture(scope="module")
def arm() -> IdentificationProblem:
    return arm_problem(load_robot("panda"), seed=8, duration=2.0, noise=0.02, error=0.01)


@pytest.fixture(scope="module")
def driven(arm) -> IdentificationProblem:
    """The first two joints with a term each that no body explains, and that the log hardly shows."""
    rng = np.random.default_rng(3)
    columns = np.zeros((arm.n_rows, 2))
    for k in range(2):
        own = arm.channel == k
        columns[own, k] = 0.05 * rng.normal(size=own.sum())
    return replace(
        arm,
        Y=np.hstack([arm.Y, columns]),
        y=arm.y + columns @ [0.4, -0.2],
        prior=np.concatenate([arm.prior, [0.1, 0.0]]),
        parameter_names=(*arm.parameter_names, "viscous.a", "viscous.b"),
        drive_spread=SPREAD,
    )


def solved(problem: IdentificationProblem, **values) -> Estimate:
    return Adaptive().estimate(problem, AdaptiveSettings(**values))


def most_probable(problem: IdentificationProblem, found: Estimate, alpha: float) -> np.ndarray:
    """``‖W(Yθ − y)‖² + α‖(θ − θ₀)/s‖²`` of bodies, and the drives' own spread whatever α: by numpy alone."""
    rows = found.regression
    weights = 1.0 / (rows.std * np.sqrt(rows.noise.inflation))[problem.channel]
    scales = prior_std(replace(problem, drive_spread=None), 0.5)
    pull = np.sqrt(alpha) / scales
    if problem.drive_spread is not None:
        pull[problem.n_inertial :] = 1.0 / problem.drive_spread
    a = np.vstack([problem.Y * weights[:, None] / pull, np.eye(problem.n_params)])
    b = np.concatenate([problem.residual(problem.prior) * weights, np.zeros(problem.n_params)])
    return problem.prior + np.linalg.lstsq(a, b, rcond=None)[0] / pull


@pytest.mark.parametrize("alpha", [4.0, 25.0, 400.0])
def test_bodies_are_pulled_by_alpha_and_drives_by_their_own_spread(driven, alpha):
    found = solved(driven, alpha=alpha, inertia_floor=0.0)
    assert found.active == () and found.status is SolveStatus.SOLVED
    assert found.distance < 1e-3 and found.method == "adaptive"
    expected = most_probable(driven, found, alpha)
    scales = prior_std(driven, 0.5)
    assert np.allclose((found.parameters - expected) / scales, 0.0, atol=1e-8)
    drives = (expected - driven.prior)[driven.n_inertial :]
    assert (np.abs(drives) > 0.1 * SPREAD).all(), "the drives move: the test shows something"


def test_no_stated_weight_is_a_weight_of_one(arm):
    free, one, two = (solved(arm, alpha=alpha).parameters for alpha in (None, 1.0, 2.0))
    assert np.array_equal(free, one) and not np.allclose(one, two, rtol=1e-6, atol=0.0)


def test_drives_without_a_stated_spread_may_be_anything(driven):
    loose = replace(driven, drive_spread=None)
    found = solved(loose, alpha=4.0, inertia_floor=0.0)
    expected = most_probable(loose, found, 4.0)
    assert np.allclose((found.parameters - expected) / prior_std(loose, 0.5), 0.0, atol=1e-8)


def test_spreads_of_segments_are_used(arm):
    """A segment that is believed exactly stays; so do all where nothing may differ."""
    links = [segment.link for segment in arm.robot.segments]
    found = solved(arm, segment_spread={links[3]: 1e-6}).parameters
    change = np.abs(found - arm.prior) / prior_std(arm, 0.5)
    assert change[30:40].max() < 1e-4 < change[40:50].max()
    still = solved(arm, prior_spread=1e-6).parameters
    assert (np.abs(still - arm.prior) / prior_std(arm, 0.5)).max() < 1e-4


@pytest.mark.parametrize("floor", [0.0, 0.2])
def test_least_eigenvalues_stay_above_their_share_of_nominal(floor):
    """Noise pushes bodies out; they stop where the share says, and some reach it."""
    noisy = arm_problem(load_robot("panda"), seed=5, duration=2.0, noise=0.3)
    found = solved(noisy, alpha=1e-2, inertia_floor=floor)
    scales = segment_scales(noisy)[:, :, None] * segment_scales(noisy)[:, None, :]
    least, usual = (
        np.linalg.eigvalsh(pseudo_inertia_matrices(bodies) * scales)[:, 0]
        for bodies in (found.parameters, noisy.prior)
    )
    shares = least / usual
    assert shares.min() == pytest.approx(floor, abs=1e-4)
    assert found.violations["pseudo_inertia"] < 1e-5


class TestTotalMass:
    def test_a_weighed_mass_is_met_and_said(self, arm):
        nominal = float(arm.prior[::10].sum())
        for mass in (0.9 * nominal, 1.1 * nominal):
            found = solved(arm, total_mass=mass)
            assert found.total_mass == mass
            assert found.parameters[::10].sum() == pytest.approx(mass, abs=1e-7)
            assert [label.split(":")[0] for label in found.active] == ["total_mass"]

    def test_joint_torques_alone_weigh_nothing(self, arm):
        assert solved(arm).total_mass is None

    def test_a_mass_that_is_not_left_is_no_solution(self, arm):
        """All but one segment are not seen and heavier than the whole is said to be."""
        hidden = tuple(range(1, len(arm.robot.segments)))
        Y = arm.Y.copy()
        Y[:, 10:] = 0.0
        blind = replace(arm, Y=Y, unmeasured=hidden)
        with pytest.raises(
            NoSolutionError, match=r"method adaptive found no solution \(infeasible\)"
        ) as caught:
            solved(blind, total_mass=0.5)
        best = caught.value.best
        assert best.status is SolveStatus.INFEASIBLE and np.isfinite(best.parameters).all()
        assert caught.value.remedy == SolveStatus.INFEASIBLE.value
        assert best.violations["total_mass"] > 0.1


class TestSolversThatLie:
    def test_a_false_no_is_not_believed(self, arm):
        def pessimist(problem: ConicProblem) -> ProjectionAnswer:
            return replace(interior_point(problem), infeasible=True)

        with pytest.raises(NoSolutionError, match=r"\(not optimal\)") as caught:
            Adaptive(pessimist).estimate(arm, AdaptiveSettings(inertia_floor=0.0))
        best = caught.value.best
        assert best.status is SolveStatus.NOT_OPTIMAL
        # The optimum without constraints meets them here: nothing better is known.
        assert np.allclose(best.parameters, solved(arm, inertia_floor=0.0).parameters, rtol=1e-5, atol=1e-7)

    def test_what_is_not_a_number_is_said_to_be(self, arm):
        def dumb(problem: ConicProblem) -> ProjectionAnswer:
            true = interior_point(problem)
            return ProjectionAnswer(true.z, np.full_like(true.multipliers, np.nan))

        with pytest.raises(NoSolutionError, match=r"\(not finite\)") as caught:
            Adaptive(dumb).estimate(arm, AdaptiveSettings())
        assert np.isfinite(caught.value.best.parameters).all()
        assert caught.value.best.status is SolveStatus.NOT_FINITE


def test_defaults():
    settings = AdaptiveSettings()
    assert (settings.alpha, settings.terms, settings.inertia_floor) == (None, "chosen", 0.01)
    assert Adaptive.adapts and Adaptive.consistent and Adaptive.name == "adaptive"
    assert AdaptiveSettings(terms="stated").terms == "stated"
