"""How long constrained estimators take for thirty bodies once the rows have been condensed."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from excite.identification.constraints.sphere import SphereRows
from excite.identification.estimators.base import Estimate
from excite.identification.estimators.cls2 import PhysicallyFeasible
from excite.identification.estimators.cls3 import DensityRealisable
from excite.identification.estimators.hqp import HierarchicalProgram
from excite.identification.estimators.lmi import PhysicallyConsistent
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.outside_cone import outside_cone
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, iterate_weights, regression
from excite.robot.loading import load_robot
from tests.benchmarks.table import Row
from tests.identification.synthetic import modified_g1_parameters, wrench_problem

_SAMPLES_A_TRIAL = 5000
_TRIALS = 4
_REPEATS = 3


def rows() -> list[Row]:
    """Processor seconds after the rows exist, and what the answers are worth."""
    robot = load_robot("g1")
    problem = wrench_problem(
        robot,
        modified_g1_parameters(robot),
        seed=0,
        trials=_TRIALS,
        duration=_SAMPLES_A_TRIAL / 50.0,
        rate=50.0,
    )
    condensed = iterate_weights(regression(problem))
    size = f"{len(robot.segments)} bodies, {problem.n_rows} rows"
    table = [*_hierarchical(problem, condensed, size)]
    for name, solve, settings in (
        ("cls2", PhysicallyFeasible().solve, EstimatorSettings()),
        ("cls3", DensityRealisable().solve, EstimatorSettings()),
        ("lmi", PhysicallyConsistent().solve, EstimatorSettings()),
        ("lmi, pullback", PhysicallyConsistent().solve, EstimatorSettings(regulariser="pullback")),
        ("lmi, entropic", PhysicallyConsistent().solve, EstimatorSettings(regulariser="entropic")),
    ):
        seconds, estimate = _fastest(solve, condensed, settings)
        if name == "cls2":
            table.append(Row(f"{name}: {size}", "", f"{seconds:.3g} s", None))
            continue
        table.append(Row.at_most(f"{name}: {size}", seconds, 0.2, "s"))
        least = float(np.linalg.eigvalsh(pseudo_inertia_matrices(estimate.parameters)).min())
        table.append(Row.at_least(f"{name}: least eigenvalue of a pseudo-inertia", least, -1e-9))
    return table


def _hierarchical(problem: IdentificationProblem, condensed: Regression, size: str) -> list[Row]:
    names = tuple(segment.link for segment in problem.robot.segments)
    table = []
    for share in (0.35, 0.05):
        settings = EstimatorSettings(mass_range=share)
        seconds, estimate = _fastest(HierarchicalProgram().solve, condensed, settings)
        sphere = SphereRows(problem, settings.sphere_epsilon, settings.sphere_subdivisions)
        worst = float(sphere.violations(estimate.parameters).max())
        table += [
            Row.at_most(f"hqp, β = {share:g}: {size}, 10 242 vectors a body", seconds, 2.0, "s"),
            Row.at_most(f"hqp, β = {share:g}: largest violation of a vector's row", worst, 1e-7, "kg·m²"),
        ]
        left = outside_cone(estimate.parameters, names)
        text = f"{left.count} of {left.n_segments}"
        table.append(Row(f"hqp, β = {share:g}: bodies that cannot exist", "", text, None))
    return table


def _fastest(
    solve: Callable[[Regression, EstimatorSettings], Estimate],
    condensed: Regression,
    settings: EstimatorSettings,
) -> tuple[float, Estimate]:
    """Least processor time of several runs [s] and the estimate, the factor being at hand."""
    _ = condensed.factor
    times = []
    for _ in range(_REPEATS):
        start = time.process_time()
        estimate = solve(condensed, settings)
        times.append(time.process_time() - start)
    return min(times), estimate
