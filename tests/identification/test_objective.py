"""The objective as a distance, scales, projections and what is recomputed of an answer, on a small arm."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from excite.errors import InputError, UnknownNameError
from excite.identification.constraints.cones import pseudo_inertia_cones
from excite.identification.constraints.linear import LinearConstraints, stack_constraints
from excite.identification.estimators.estimator import (
    Estimate,
    SolveStatus,
    best_feasible,
    best_known,
    checked_estimate,
    estimate_at,
    finite_or_raised,
    no_solution,
    plain_models,
)
from excite.identification.estimators.hqp import HqpSettings
from excite.identification.estimators.registry import ESTIMATORS
from excite.identification.estimators.scaled_problem import Ridge, build_ridge, scaled_parameters
from excite.identification.estimators.settings import EstimatorSettings, PullSettings
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights, prior_std
from excite.robot.loading import load_robot
from tests.identification.synthetic import arm_problem


@pytest.fixture(scope="module")
def problem() -> IdentificationProblem:
    whole = arm_problem(load_robot("panda"), seed=5, duration=1.0, noise=0.3)
    rows = whole.Y.copy()
    rows[:, whole.robot.parameter_columns(2)] = 0.0
    return replace(whole, Y=rows, unmeasured=(2,))


@pytest.fixture(scope="module")
def rows(problem) -> Regression:
    return iterate_weights(condense_problem(problem))


SETTINGS = PullSettings(alpha=2.5, prior_spread=0.3)


@pytest.fixture(scope="module")
def objective(rows) -> Ridge:
    return build_ridge(rows, SETTINGS)


def some_parameters(problem: IdentificationProblem, seed: int) -> np.ndarray:
    """Near nominal, but for the segment that is not measured."""
    rng = np.random.default_rng(seed)
    theta = problem.prior * (1.0 + 0.2 * rng.normal(size=problem.n_params))
    columns = problem.robot.parameter_columns(2)
    theta[columns] = problem.prior[columns]
    return theta


def random_constraints(problem: IdentificationProblem, seed: int, n_equal: int = 1) -> LinearConstraints:
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(5, problem.n_params))
    matrix[3] = 0.0
    matrix[3, problem.robot.parameter_columns(2)] = 1.0
    return LinearConstraints(
        matrix, rng.normal(size=5), ("tie:a", "row:b", "row:c", "lost:d", "row:e"), n_equal
    )


# --- Scales


def test_scaled_parameters_count_spreads_from_nominal(problem, rows):
    scaled = scaled_parameters(rows, SETTINGS)
    assert set(range(problem.n_params)) - set(scaled.free) == set(range(20, 30))
    assert np.allclose(scaled.scales, prior_std(problem, 0.3))
    theta = some_parameters(problem, 0)
    x = scaled.coordinates(theta)
    assert np.allclose(x, ((theta - problem.prior) / prior_std(problem, 0.3))[scaled.free])
    assert np.allclose(scaled.parameters(x), theta)
    assert np.array_equal(scaled.parameters(np.zeros(len(x))), problem.prior)
    assert np.allclose(scaled.columns(rows.factor[:, :-1]) @ x, rows.factor[:, :-1] @ (theta - problem.prior))


def test_constraints_mean_the_same_on_scaled_parameters(problem, rows):
    scaled = scaled_parameters(rows, SETTINGS)
    for n_equal in (0, 1, 4):
        constraints = random_constraints(problem, 1, n_equal)
        listed = scaled.constraints(constraints)
        assert listed.n_equal == min(n_equal, 3)
        for seed in (0, 1):
            theta = some_parameters(problem, seed)
            slack = (constraints.matrix @ theta - constraints.bound)[[0, 1, 2, 4]]
            sizes = np.linalg.norm(scaled.columns(constraints.matrix), axis=1)[[0, 1, 2, 4]]
            assert np.allclose(listed.matrix @ scaled.coordinates(theta) - listed.bound, slack / sizes)
            assert listed.labels == ("tie:a", "row:b", "row:c", "row:e")


# --- The objective


def cost(problem: IdentificationProblem, rows: Regression, theta: np.ndarray) -> float:
    """Eq. (4) of Jovic et al. 2015 with rows divided by noise and autocorrelation, parameters by spreads."""
    weights = 1.0 / (rows.std * np.sqrt(rows.noise.inflation))[problem.channel]
    pull = (theta - problem.prior) / prior_std(problem, SETTINGS.prior_spread)
    return float(np.sum((problem.residual(theta) * weights) ** 2) + SETTINGS.alpha * pull @ pull)


def test_the_objective_is_a_squared_distance(problem, rows, objective):
    base = cost(problem, rows, objective.parameters(objective.target))
    for seed in range(4):
        theta = some_parameters(problem, seed)
        z = objective.coordinates(theta)
        assert np.allclose(objective.parameters(z), theta)
        expected = float(np.sum((z - objective.target) ** 2))
        assert cost(problem, rows, theta) - base == pytest.approx(expected, rel=1e-6)
    assert np.array_equal(objective.parameters(np.zeros(len(objective.target))), problem.prior)


def test_constraints_and_cones_mean_the_same_in_its_coordinates(problem, objective):
    for n_equal in (0, 1, 4):
        constraints = random_constraints(problem, 2, n_equal)
        listed = objective.constraints(constraints)
        assert listed.n_equal == min(n_equal, 3)
        assert listed.labels == ("tie:a", "row:b", "row:c", "row:e")
        sizes = np.linalg.norm(objective.rotate(constraints.matrix), axis=1)[[0, 1, 2, 4]]
        assert np.allclose(np.linalg.norm(listed.matrix, axis=1), 1.0)
        for seed in (0, 1):
            theta = some_parameters(problem, seed)
            slack = (constraints.matrix @ theta - constraints.bound)[[0, 1, 2, 4]]
            assert np.allclose(listed.matrix @ objective.coordinates(theta) - listed.bound, slack / sizes)
    cones = pseudo_inertia_cones(problem, 0.01)
    turned = objective.cones(cones)
    assert (turned.order, turned.labels) == (cones.order, cones.labels)
    theta = some_parameters(problem, 3)
    flat = cones.matrix @ theta + cones.bound
    values = turned.values(objective.coordinates(theta))
    ratio = values / np.where(np.abs(flat) > 1e-12, flat, 1.0)
    for block, value in zip(ratio, flat, strict=True):
        seen = block[np.abs(value) > 1e-12]
        assert (seen > 0.0).all() and np.allclose(seen, seen[0])
    assert np.allclose(np.linalg.norm(turned.matrix, axis=(1, 2)), 1.0)


# --- What is recomputed of an answer


def judge(
    rows: Regression, objective: Ridge, offset: float, distance: float = 0.0, bound: float = 0.0
) -> Estimate:
    """An answer that lies ``offset`` from the target along a direction in which one row says at least ``bound``."""
    n = len(objective.target)
    direction = np.eye(n)[[0, 1]]
    constraints = LinearConstraints(
        direction, direction @ objective.target + np.array([bound, -5.0]), ("kind:first", "other:second")
    )
    z = objective.target + offset * direction[0]
    worst = constraints.worst_violations(z) if np.isfinite(offset) else {}
    return checked_estimate("qp", rows, objective, z, distance, worst)


@pytest.mark.parametrize(
    ("offset", "distance", "bound", "status"),
    [
        (0.0, 0.0, 0.0, SolveStatus.SOLVED),
        (0.0, 0.99e-3, 0.0, SolveStatus.SOLVED),
        (0.0, 1.01e-3, 0.0, SolveStatus.NOT_OPTIMAL),
        (0.5, 1.01e-3, 0.0, SolveStatus.NOT_OPTIMAL),
        (50.0, 0.049, 0.0, SolveStatus.SOLVED),
        (50.0, 0.051, 0.0, SolveStatus.NOT_OPTIMAL),
        (0.0, 0.0, 0.99e-5, SolveStatus.SOLVED),
        (0.0, 0.0, 1.01e-5, SolveStatus.VIOLATED),
        (0.0, 1.0, 1.0, SolveStatus.VIOLATED),
        (0.0, np.inf, 0.0, SolveStatus.NOT_FINITE),
        (np.nan, 0.0, 0.0, SolveStatus.NOT_FINITE),
    ],
)
def test_the_status_comes_from_the_answer(rows, objective, offset, distance, bound, status):
    found = judge(rows, objective, offset, distance, bound)
    assert found.status is status
    if np.isfinite(offset):
        assert found.violations == {"kind": pytest.approx(max(0.0, bound - offset)), "other": 0.0}
        assert found.distance == distance


def test_the_largest_violation_of_a_kind_is_kept(rows, objective):
    n = len(objective.target)
    matrix = np.eye(n)[:3]
    bound = matrix @ objective.target + [0.2, 0.5, -1.0]
    constraints = LinearConstraints(matrix, bound, ("kind:a", "kind:b", "kind:c"))
    assert constraints.worst_violations(objective.target) == {"kind": pytest.approx(0.5)}
    assert constraints.labels_reached(objective.target, 1e-5) == ("kind:a", "kind:b")


def test_the_residual_is_weighted_by_the_noise(problem, rows, objective):
    found = judge(rows, objective, 3.0)
    theta = objective.parameters(objective.target + 3.0 * np.eye(len(objective.target))[0])
    weighted = problem.residual(theta) / rows.std[problem.channel]
    expected = np.sqrt(np.mean(weighted**2))
    assert found.residual == pytest.approx(expected)
    assert estimate_at("qp", rows, theta, SolveStatus.NOT_OPTIMAL).residual == pytest.approx(expected)
    assert estimate_at("qp", rows, theta, SolveStatus.NOT_OPTIMAL).distance == np.inf


def test_errors_carry_the_best_estimate_and_advice(problem, rows, objective):
    lost = judge(rows, objective, np.nan)
    with pytest.raises(Exception, match="qp found no solution \\(not finite\\)") as caught:
        finite_or_raised(lost)
    assert np.array_equal(caught.value.best.parameters, problem.prior)
    fine = judge(rows, objective, 0.0)
    assert finite_or_raised(fine) is fine
    error = no_solution(SolveStatus.CUT_LIMIT, fine)
    assert error.best is fine and "cut limit" in str(error) and error.remedy == SolveStatus.CUT_LIMIT.value


# --- The best that is known


def test_the_best_point_is_the_last_that_does_not_violate():
    def violation(z: np.ndarray) -> float:
        return max(float(z[0]) - 1.0, 0.0)

    def far(z: np.ndarray) -> float:
        return float(np.linalg.norm(z - [3.0, 0.0]))

    start, goal = np.array([0.0, 0.0]), np.array([3.0, 0.0])
    found = best_feasible([start], [goal], violation, far)
    assert found == pytest.approx([1.0, 0.0], abs=2e-8)
    assert violation(found) <= 1e-8
    assert np.array_equal(best_feasible([start], [goal], lambda z: 0.0, far), goal)
    assert best_feasible([goal], [start], violation, far) is None, "no start is feasible"
    lost = np.array([np.nan, 0.0])
    assert np.array_equal(best_feasible([start], [lost], violation, far), start)
    near = best_feasible([start, np.array([0.5, 4.0])], [goal], violation, far)
    assert near == pytest.approx([1.0, 0.0], abs=2e-8), "of several the cheapest"


def test_plain_models_meet_the_total_mass(problem):
    masses = np.zeros(problem.n_params)
    masses[: problem.n_inertial : 10] = 1.0
    nominal = masses @ problem.prior
    unmeasured = problem.prior[20]
    for wanted in (0.7 * nominal, 1.4 * nominal):
        linear = LinearConstraints(masses[None], np.array([wanted]), ("total_mass:all",), 1)
        plain, scaled = plain_models(problem, linear)
        assert np.array_equal(plain, problem.prior)
        assert masses @ scaled == pytest.approx(wanted)
        factor = (wanted - unmeasured) / (nominal - unmeasured)
        moving = np.r_[0:20, 30 : problem.n_inertial]
        assert np.allclose(scaled[moving], factor * problem.prior[moving])
        assert np.array_equal(scaled[20:30], problem.prior[20:30])
    other = LinearConstraints(masses[None], np.array([wanted]), ("mass:all",), 1)
    assert len(plain_models(problem, other)) == 1
    impossible = LinearConstraints(masses[None], np.array([0.5 * unmeasured]), ("total_mass:all",), 1)
    assert len(plain_models(problem, impossible)) == 1


def test_what_is_known_is_feasible_or_said_not_to_be(problem, rows, objective):
    def within(z: np.ndarray) -> dict[str, float]:
        return {"away": max(float(np.linalg.norm(z)) - 1e-3, 0.0)}

    nothing = stack_constraints([], problem.n_params)
    best = best_known("qp", rows, objective, nothing, [], within)
    assert best.status is SolveStatus.NOT_OPTIMAL
    assert np.linalg.norm(objective.coordinates(best.parameters)) == pytest.approx(1e-3, abs=1e-7)
    assert best.violations["away"] <= 1e-8
    none = best_known("qp", rows, objective, nothing, [], lambda z: {"never": 1.0})
    assert none.status is SolveStatus.INFEASIBLE
    assert np.allclose(none.parameters, objective.parameters(objective.target))
    assert none.violations == {"never": 1.0}


# --- Settings


DECLARED = {item.name: (item, kind) for kind in ESTIMATORS.values() for item in fields(kind.settings_class)}
NUMBERS = [item for item, _ in DECLARED.values() if "low" in item.metadata]


def settings_with(name: str, value: object) -> EstimatorSettings:
    """Settings of a method that knows one of them, with this value."""
    return DECLARED[name][1].settings_class(**{name: value})


@pytest.mark.parametrize("item", NUMBERS, ids=lambda item: item.name)
def test_numbers_keep_to_their_bounds(item):
    low, high, unit = (item.metadata[key] for key in ("low", "high", "unit"))
    assert low < high and item.metadata["what"]
    for value in (low, high):
        assert getattr(settings_with(item.name, value), item.name) == value
    for value in (low - max(1e-9, 1e-6 * abs(low)), high * (1.0 + 1e-9), np.inf, np.nan, "1", True, [1.0]):
        with pytest.raises(InputError) as caught:
            settings_with(item.name, value)
        assert caught.value.field == item.name
        assert caught.value.remedy == f"choose {low:g} … {high:g}" + ("" if unit == "1" else f" {unit}")
    if item.name in ("total_mass", "symmetry", "mirror"):
        assert getattr(settings_with(item.name, None), item.name) is None
    else:
        with pytest.raises(InputError, match=item.name):
            settings_with(item.name, None)


def test_single_segments_have_their_own_spread_and_range(g1):
    links = [segment.link for segment in g1.segments]
    settings = HqpSettings(
        prior_spread=0.2, segment_spread={links[3]: 0.7}, mass_range=0.1, segment_mass_range={links[5]: 0.4}
    )
    expected = np.full(len(links), 0.2)
    expected[3] = 0.7
    assert np.array_equal(settings.spreads(g1), expected)
    expected = np.full(len(links), 0.1)
    expected[5] = 0.4
    assert np.array_equal(settings.mass_ranges(g1), expected)
    assert replace(settings, asymmetric=(links[4], links[2])).free_of_symmetry(g1) == (4, 2)
    for wrong in ({"segment_mass_range": {"nose": 0.1}}, {"asymmetric": ("nose",)}):
        with pytest.raises(UnknownNameError, match="nose"):
            odd = replace(settings, **wrong)
            odd.mass_ranges(g1)
            odd.free_of_symmetry(g1)
