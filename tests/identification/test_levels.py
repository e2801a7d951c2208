"""The hierarchy with equalities, rows that are too many to list, and the last level; and its estimators' answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from excite.identification.constraints.linear import LinearConstraints, equivalent_boxes, stack_constraints
from excite.identification.estimators.conic import Cls3Settings, DensityRealisable
from excite.identification.estimators.estimator import SolveStatus
from excite.identification.estimators.hierarchy import Level, solve_hierarchy
from excite.identification.estimators.hqp import (
    BoundedNearBase,
    HierarchicalProgram,
    HqpSettings,
    paper_levels,
)
from excite.identification.estimators.projection import ActiveSetProjector
from excite.identification.estimators.scaled_problem import scaled_parameters
from excite.identification.estimators.settings import ParameterBoundsSettings
from excite.identification.physical.bounds import KnownBounds
from excite.identification.physical.default_bounds import bound_rows, parameter_bounds
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import condense_problem, iterate_weights, prior_std
from excite.robot.loading import load_robot
from tests.identification.synthetic import arm_problem

N = 6


def unit_rows(rng: np.random.Generator, count: int, shift: float, n_equal: int = 0) -> LinearConstraints:
    matrix = rng.normal(size=(count, N))
    matrix /= np.linalg.norm(matrix, axis=1, keepdims=True)
    return LinearConstraints(matrix, shift + 0.3 * rng.normal(size=count), ("row:x",) * count, n_equal)


class Listed:
    """Rows handed out a few at a time, as a family does."""

    def __init__(self, rows: LinearConstraints, count: int = 2):
        self.rows, self.count, self.asked = rows, count, 0

    def violated(self, x: np.ndarray) -> LinearConstraints:
        self.asked += 1
        worst = np.argsort(self.rows.matrix @ x - self.rows.bound)[: self.count]
        worst = worst[self.rows.violations(x)[worst] > 1e-9]
        labels = tuple(self.rows.labels[k] for k in worst)
        return LinearConstraints(self.rows.matrix[worst], self.rows.bound[worst], labels)


def lexicographic(levels: list[LinearConstraints], matrix: np.ndarray, measured: np.ndarray):
    """Slack norms, residual norm and length at the optimum, each level by sequential quadratic programming."""
    held: list = []
    slacks, x = [], np.zeros(N)

    def solve(objective, start, constraints):
        options = {"maxiter": 1000, "ftol": 1e-15}
        return minimize(objective, start, constraints=constraints, method="SLSQP", options=options).x

    for rows in levels:
        e = rows.n_equal

        def own(v, rows=rows):
            return rows.matrix @ v[:N] + v[N:] - rows.bound

        start = np.concatenate([x, np.zeros(len(rows.bound))])
        start[N:] = np.where(np.arange(len(rows.bound)) < e, rows.bound - rows.matrix @ x, rows.violations(x))
        constraints = [
            {"type": "eq", "fun": lambda v, own=own, e=e: own(v)[:e]},
            {"type": "ineq", "fun": lambda v, own=own, e=e: own(v)[e:]},
            *({"type": kind, "fun": lambda v, part=part: part(v[:N])} for kind, part in held),
        ]
        v = solve(lambda v: 0.5 * v[N:] @ v[N:], start, [c for c in constraints if len(c["fun"](start))])
        x, w = v[:N], v[N:]
        slacks.append(float(np.linalg.norm(w)))
        held.append(("eq", lambda y, rows=rows, w=w, e=e: (rows.matrix @ y + w - rows.bound)[:e]))
        held.append(("ineq", lambda y, rows=rows, w=w, e=e: (rows.matrix @ y + w - rows.bound)[e:] + 1e-9))
    usable = [{"type": kind, "fun": part} for kind, part in held if len(part(x))]
    x = solve(lambda y: 0.5 * np.sum((matrix @ y - measured) ** 2), x, usable)
    residual = float(np.linalg.norm(matrix @ x - measured))
    reached = matrix @ x
    usable.append({"type": "eq", "fun": lambda y: matrix @ y - reached})
    x = solve(lambda y: 0.5 * y @ y, x, usable)
    return slacks, residual, float(np.linalg.norm(x))


@pytest.mark.parametrize("n_equal", [0, 1])
@pytest.mark.parametrize("shift", [-0.4, 0.3])
def test_every_level_is_the_best_that_those_above_allow(n_equal, shift):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        levels = [unit_rows(rng, 4, shift, n_equal), unit_rows(rng, 5, shift, n_equal)]
        matrix, measured = rng.normal(size=(2, N)), rng.normal(size=2)
        found = solve_hierarchy(
            tuple(Level(str(k), rows) for k, rows in enumerate(levels)),
            matrix,
            measured,
            ActiveSetProjector(),
        )
        slacks, residual, length = lexicographic(levels, matrix, measured)
        assert found.status is SolveStatus.SOLVED
        assert found.slacks == pytest.approx(slacks, abs=1e-4)
        for rows, reached in zip(levels, found.slacks, strict=True):
            assert np.linalg.norm(rows.violations(found.x)) == pytest.approx(reached, abs=1e-7)
        assert np.linalg.norm(matrix @ found.x - measured) == pytest.approx(residual, abs=1e-3)
        assert np.linalg.norm(found.x) <= length + 1e-3
        # A certificate is the root of rounding: 1.5e-4 on one processor, below 1e-4 on others.
        assert found.fit_distance < 3e-4 and found.distance < 3e-4


def test_rows_of_a_family_count_as_if_they_were_listed():
    """Where they can be met, as those of a sphere can."""
    compared = 0
    for seed, shift in ((seed, shift) for seed in range(4) for shift in (-0.4, 0.5)):
        rng = np.random.default_rng(seed)
        first, second = unit_rows(rng, 3, shift), unit_rows(rng, 3, shift)
        many = unit_rows(rng, 40, shift - 1.0)
        matrix, measured = rng.normal(size=(3, N)), 2.0 * rng.normal(size=3)
        for place in (0, 1):
            levels = [Level("1", first), Level("2", second)]
            family = Listed(many)
            whole = list(levels)
            whole[place] = Level("both", stack_constraints([levels[place].constraints, many], N))
            other = solve_hierarchy(tuple(whole), matrix, measured, ActiveSetProjector())
            if other.slacks[place]:
                continue
            compared += 1
            levels[place] = replace(levels[place], family=family)
            one = solve_hierarchy(tuple(levels), matrix, measured, ActiveSetProjector())
            assert one.status is SolveStatus.SOLVED
            assert family.asked > 1
            assert one.slacks == pytest.approx(other.slacks, abs=1e-6)
            assert np.allclose(matrix @ one.x, matrix @ other.x, atol=1e-5)
            assert np.allclose(one.x, other.x, atol=1e-4)
            assert many.violations(one.x).max() < 1e-7
    assert compared >= 8


# --- The hierarchical program


@pytest.fixture(scope="module")
def arm() -> IdentificationProblem:
    return arm_problem(load_robot("panda"), seed=0, duration=2.0)


def test_violations_active_rows_and_residual_are_those_of_the_parameters(arm):
    settings = HqpSettings(sphere_epsilon=1e-3, mass_range=0.02)
    found = HierarchicalProgram().estimate(arm, settings)
    rows = found.regression
    scaled = scaled_parameters(rows, settings)
    x = scaled.coordinates(found.parameters)
    worst: dict[str, float] = {}
    active = []
    for level in paper_levels(rows, settings, scaled):
        slack = level.constraints.matrix @ x - level.constraints.bound
        for label, value, left in zip(
            level.constraints.labels, level.constraints.violations(x), slack, strict=True
        ):
            kind = label.split(":")[0]
            worst[kind] = max(worst.get(kind, 0.0), float(value))
            active += [label] * bool(left < 1e-6)
    assert found.violations == pytest.approx(worst, abs=1e-9)
    assert found.active == tuple(dict.fromkeys(active)) and found.active
    weighted = arm.residual(found.parameters) / rows.std[arm.channel]
    assert found.residual == pytest.approx(np.sqrt(np.mean(weighted**2)))


# --- Bounds of cls1


def test_bounds_are_spreads_about_nominal_or_those_given(arm):
    settings = ParameterBoundsSettings(bound_width=2.0, prior_spread=0.3)
    rows = iterate_weights(condense_problem(arm))
    lower, upper = parameter_bounds(rows, settings)
    spread = prior_std(arm, settings.spreads(arm.robot))
    masses = np.arange(arm.n_params) % 10 == 0
    assert np.allclose(upper, arm.prior + 2.0 * spread)
    assert np.allclose(lower[~masses], (arm.prior - 2.0 * spread)[~masses])
    assert (lower[masses] >= -1e-12).all()
    given = np.array([arm.prior - 1.0, arm.prior + 2.0])
    assert np.array_equal(parameter_bounds(rows, replace(settings, parameter_bounds=given)), given)
    listed = bound_rows(rows, replace(settings, parameter_bounds=given))
    inside = arm.prior + 0.5
    assert listed.violations(inside).max() == 0.0
    for index in (0, 13, arm.n_params - 1):
        outside = arm.prior.copy()
        outside[index] += 2.5
        assert listed.violations(outside).max() > 0.0
    some = bound_rows(rows, settings, (0, 1))
    assert len(some.bound) < len(bound_rows(rows, settings).bound)


def test_active_bounds_are_those_that_are_reached(arm):
    settings = ParameterBoundsSettings(bound_width=0.1)
    found = BoundedNearBase().estimate(arm, settings)
    rows = found.regression
    listed = scaled_parameters(rows, settings).constraints(bound_rows(rows, settings))
    slack = listed.matrix @ scaled_parameters(rows, settings).coordinates(found.parameters) - listed.bound
    reached = {label for label, left in zip(listed.labels, slack, strict=True) if left < 1e-6}
    assert set(found.active) == reached
    assert 0 < len(reached) < len(set(listed.labels))


@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_ellipsoids_reach_as_far_as_a_stated_box(arm, side):
    """A centre of mass that lies 0.1 m off, on either side: found where its box is stated, kept in its own else."""
    boxes = equivalent_boxes(arm.robot, growth=0.05)
    k, link = 3, arm.robot.segments[3].link
    moved = np.zeros(arm.n_params)
    moved[10 * k + 1] = side * arm.prior[10 * k]
    off = replace(arm, y=arm.y + arm.Y @ moved)
    settings = Cls3Settings(com_boxes=boxes)
    nominal = float(arm.prior[10 * k + 1] / arm.prior[10 * k])
    known = KnownBounds({f"{link}.cx": (nominal - 0.4, nominal + 0.4)})
    centres = []
    for given in (settings, replace(settings, bounds=known)):
        ten = DensityRealisable().estimate(off, given).parameters[10 * k : 10 * k + 10]
        centres.append(float(ten[1] / ten[0]) - nominal)
    kept, found = centres
    assert abs(kept) < abs(side) / 2.0
    assert abs(found - side) < 0.05
