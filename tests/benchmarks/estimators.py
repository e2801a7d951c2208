"""How long constrained estimators take for thirty bodies once the rows have been condensed, and base parameters."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from excite.identification.estimators.conic import (
    Cls2Settings,
    Cls3Settings,
    DensityRealisable,
    LmiSettings,
    PhysicallyConsistent,
    PhysicallyFeasible,
)
from excite.identification.estimators.estimator import Estimate
from excite.identification.estimators.hqp import HierarchicalProgram, HqpSettings
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.inertia import inertia_matrices, pseudo_inertia_matrices
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights
from excite.regressor.base_parameters import structural_base_parameters
from excite.robot.loading import load_robot
from tests.benchmarks.table import Row
from tests.identification.outside_cone import outside_cone
from tests.identification.synthetic import modified_g1_parameters, wrench_problem

_SAMPLES_A_TRIAL = 5000
_TRIALS = 4
Result = TypeVar("Result")
_REPEATS = 5


def rows() -> list[Row]:
    """Seconds after the rows exist, the processor's against the bar, and what the answers are worth."""
    # First, while no kernel has been loaded.
    base = _base_parameters()
    robot = load_robot("g1")
    problem = wrench_problem(
        robot,
        modified_g1_parameters(robot),
        seed=0,
        trials=_TRIALS,
        duration=_SAMPLES_A_TRIAL / 50.0,
        rate=50.0,
    )
    condensed = iterate_weights(condense_problem(problem))
    size = f"{len(robot.segments)} bodies, {problem.n_rows} rows"
    table = [*base, *_hierarchical(problem, condensed, size)]
    for name, solve, settings in (
        ("cls2", PhysicallyFeasible().solve, Cls2Settings()),
        ("cls3", DensityRealisable().solve, Cls3Settings()),
        ("lmi", PhysicallyConsistent().solve, LmiSettings()),
        ("lmi, pullback", PhysicallyConsistent().solve, LmiSettings(regulariser="pullback")),
        ("lmi, pullback", PhysicallyConsistent().solve, LmiSettings(regulariser="pullback")),
    ):
        seconds, estimate = _fastest(solve, condensed, settings)
        if name == "cls2":
            table.append(Row(f"{name}: {size}", "", str(seconds), None))
            continue
        table.append(seconds.row(f"{name}: {size}", 0.2))
        least = float(np.linalg.eigvalsh(pseudo_inertia_matrices(estimate.parameters)).min())
        table.append(Row.at_least(f"{name}: least eigenvalue of a pseudo-inertia", least, -1e-9))
    return table


def _hierarchical(problem: IdentificationProblem, condensed: Regression, size: str) -> list[Row]:
    names = tuple(segment.link for segment in problem.robot.segments)
    table = []
    for share in (0.35, 0.05):
        settings = HqpSettings(mass_range=share)
        seconds, estimate = _fastest(HierarchicalProgram().solve, condensed, settings)
        moving = [k for k in range(len(names)) if k not in problem.unmeasured]
        least = np.linalg.eigvalsh(inertia_matrices(estimate.parameters[: problem.n_inertial]))[moving, 0]
        worst = max(0.0, settings.sphere_epsilon - float(least.min()))
        table += [
            seconds.row(f"hqp, β = {share:g}: {size}, all vectors of a body", 2.0),
            Row.at_most(f"hqp, β = {share:g}: largest violation of a vector's row", worst, 1e-7, "kg·m²"),
        ]
        left = outside_cone(estimate.parameters, names)
        text = f"{left.count} of {left.n_segments}"
        table.append(Row(f"hqp, β = {share:g}: bodies that cannot exist", "", text, None))
    return table


def _base_parameters() -> list[Row]:
    """Base parameters of TALOS: the kernels read from their cache, and again."""
    robot = load_robot("talos")
    first, found = _timed(lambda: structural_base_parameters(robot, ()), 1)
    again, _ = _timed(lambda: structural_base_parameters(robot, ()), _REPEATS)
    what = f"base parameters of TALOS ({found.rank} of {len(found.names)})"
    return [first.row(f"{what}, first in a process", 0.5), again.row(f"{what}, again", 0.5)]


@dataclass(frozen=True)
class Seconds:
    """Least time of several runs.

    Attributes:
        processor: [s].
        wall: [s]; on a machine that others use as well it says little.
    """

    processor: float
    wall: float

    def __str__(self) -> str:
        return f"{self.processor:.3g} s (wall {self.wall:.3g} s)"

    def row(self, what: str, limit: float) -> Row:
        """The processor's seconds against a limit."""
        return Row.holds(what, f"≤ {limit:g} s", str(self), self.processor <= limit)


def _timed(run: Callable[[], Result], repeats: int) -> tuple[Seconds, Result]:
    processor, wall = [], []
    for _ in range(repeats):
        starts = time.process_time(), time.perf_counter()
        result = run()
        processor.append(time.process_time() - starts[0])
        wall.append(time.perf_counter() - starts[1])
    return Seconds(min(processor), min(wall)), result


def _fastest(
    solve: Callable[[Regression, Any], Estimate],
    condensed: Regression,
    settings: EstimatorSettings,
) -> tuple[Seconds, Estimate]:
    """Least time of several runs and the estimate, the factor being at hand."""
    _ = condensed.factor
    return _timed(lambda: solve(condensed, settings), _REPEATS)
