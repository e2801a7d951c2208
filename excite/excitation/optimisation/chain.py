"""One start of the search: draw, solve, then kick the best and solve again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.excitation.optimisation.amplitudes import AmplitudeSums
from excite.excitation.optimisation.augmented import AugmentedLagrangian
from excite.excitation.optimisation.clearance import Clearance
from excite.excitation.optimisation.criterion import make_criterion
from excite.excitation.optimisation.limits import LinearRows, linear_rows, peak_shares
from excite.excitation.optimisation.objective import Layout, Objective
from excite.excitation.optimisation.program import solve_program
from excite.excitation.optimisation.task import ExcitationTask
from excite.excitation.optimisation.torques import TorqueLimits
from excite.threads import one_blas_thread

# Samples in a cycle of the fastest harmonic while searching, for limits, and at the end.
_SEARCH, _LIMITS, _FINE = 16.0, 20.0, 24.0
# Sharpness of the smooth criterion and iterations, stage by stage; of the kicks; of the end.
_STAGES = ((4.0, 80), (32.0, 100), (32.0, 100))
_KICK_STAGES = ((4.0, 25), (32.0, 60), (32.0, 60))
_LAST = ((64.0, 40), (64.0, 40))
_MERIT = 64.0
# Weight of the augmented Lagrangian's penalty, on violations in shares of limits.
_WEIGHT = 60.0
# Starts drawn for each one that is solved, and how many of them have their collisions looked at.
_DRAWS, _JUDGED = 60, 12
# Standard deviation of a kick, in units of the variables.
_KICK = 0.25
# Distance beyond the collision margin while searching and at the end, for what happens between samples [m].
_EXTRA, _EXTRA_FINE = 0.012, 0.006
# Clearance that counts as much as a whole limit [m].
_CLEARANCE_UNIT = 0.05
# Torque limits enter for joints that come this near to them.
_TORQUE_SHARE = 0.7


@dataclass(frozen=True, eq=False)
class Point:
    """Where a start has got to.

    Attributes:
        x: variables ``(size,)``.
        value: smoothed criterion and a penalty on what is violated, by which points are compared.
        multipliers: of the nonlinear rows.
        evaluations: of the objective so far.
    """

    x: Array
    value: float
    multipliers: Array
    evaluations: int


class Chain:
    """The task's program on a coarse and on a fine grid, and the steps of the search.

    Args:
        task: the task.
        effort: factor on the iterations of every solve.

    Raises:
        NoSolutionError: limits leave no room.
        InputError: the criterion needs noise that the robot does not state, or columns do not fit.
    """

    def __init__(self, task: ExcitationTask, effort: float = 1.0) -> None:
        self.task, self._effort = task, effort
        self.layout: Layout = task.layout()
        self._sums = AmplitudeSums(self.layout, task.joint_limits) if task.amplitude_sums else None

    @cached_property
    def _coarse(self) -> _Grid:
        return _Grid(self.task, self.layout, self._sums, _SEARCH, _EXTRA)

    @cached_property
    def _fine(self) -> _Grid:
        return _Grid(self.task, self.layout, self._sums, _FINE, _EXTRA_FINE)

    @cached_property
    def _judge(self) -> Objective:
        criterion = make_criterion(self.task.criterion)
        time = self.task.family.grid(200.0)
        return Objective(self.layout, criterion, time, self.task.drives, self.task.independent)

    @property
    def n_base(self) -> int:
        """Number of base parameters."""
        return self._coarse.objective.n_base

    def value(self, x: Array) -> float:
        """The criterion itself, finely sampled."""
        return self._judge.value(x)

    def shares(self, x: Array) -> Array:
        """Largest share of its limits that each moved joint uses, ``(n_moved,)``."""
        if self._sums is not None:
            return self._sums.shares(x)
        return peak_shares(self.layout, self.task.joint_limits, x)

    def scaled(self, x: Array, factors: Array | float) -> Array:
        """Variables with the coefficients of each moved joint multiplied."""
        n = self.layout.n_offsets
        table = x[n:].reshape(len(self.layout.joints), -1)
        return np.concatenate([x[:n], (np.reshape(factors, (-1, 1)) * table).ravel()])

    @one_blas_thread
    def begin(self, rng: np.random.Generator) -> Point:
        """The best of some random motions, solved."""
        draws = [self._draw(rng) for _ in range(_DRAWS)]
        best = self._coarse.choose(draws)
        return self._staged(best, np.zeros(self._coarse.n_rows), self._coarse, _STAGES)

    @one_blas_thread
    def kick(self, best: Point, rng: np.random.Generator) -> Point:
        """Solved anew from a random step away; the better of the two."""
        x = best.x + _KICK * rng.standard_normal(len(best.x))
        x[: self.layout.n_offsets] = np.clip(x[: self.layout.n_offsets], -0.9, 0.9)
        x = self.scaled(x, 1.0 / np.maximum(self.shares(x), 1.0))
        found = self._staged(x, best.multipliers, self._coarse, _KICK_STAGES)
        chosen = found if found.value < best.value else best
        return replace(chosen, evaluations=best.evaluations + found.evaluations)

    @one_blas_thread
    def finish(self, best: Point) -> Point:
        """Solved once more on the fine grid."""
        found = self._staged(best.x, best.multipliers, self._fine, _LAST)
        return replace(found, evaluations=best.evaluations + found.evaluations)

    def _draw(self, rng: np.random.Generator) -> Array:
        x = rng.standard_normal(self.layout.size)
        x[: self.layout.n_offsets] = rng.uniform(-0.3, 0.3, self.layout.n_offsets)
        return self.scaled(x, 0.98 / self.shares(x))

    def _staged(
        self, x: Array, multipliers: Array, grid: _Grid, stages: tuple[tuple[float, int], ...]
    ) -> Point:
        evaluations = 0
        for sharpness, iterations in stages:
            program = grid.program(x, sharpness, multipliers)
            found = solve_program(
                program, grid.linear, x, iterations=max(1, round(self._effort * iterations))
            )
            evaluations += found.evaluations
            if found.feasible:
                x, multipliers = found.x, program.updated(found.x)
        return Point(x, grid.merit(x), multipliers, evaluations)


class _Grid:
    """The program's parts at one density of samples."""

    def __init__(
        self, task: ExcitationTask, layout: Layout, sums: AmplitudeSums | None, per_cycle: float, extra: float
    ) -> None:
        time = task.family.grid(per_cycle)
        limits = task.joint_limits
        criterion = make_criterion(task.criterion)
        self.objective = Objective(layout, criterion, time, task.drives, task.independent)
        self._sums = sums
        if sums is None:
            self.linear = linear_rows(layout, limits, task.family.grid(max(per_cycle, _LIMITS)))
        else:
            self.linear = LinearRows(
                np.eye(layout.size), np.full(layout.size, -50.0), np.full(layout.size, 50.0)
            )
        self._clearance = Clearance(layout, time, extra) if task.avoid_collisions else None
        self._torques = TorqueLimits(layout, limits, time)
        self._n_moved = len(layout.joints)

    def choose(self, draws: list[Array]) -> Array:
        """The draw with the best criterion, less what it collides by; of all but the best few the first alone."""
        values = np.array([self.objective.smooth(x, 1.0)[0] for x in draws])
        order = np.argsort(values, kind="stable")[:_JUDGED]
        lack = np.zeros(len(order))
        if self._clearance is not None:
            lack = np.array([min(0.0, self._clearance.least(draws[k])) for k in order])
        return draws[int(order[np.argmin(values[order] - 10.0 * lack)])]

    @property
    def n_rows(self) -> int:
        """Number of nonlinear rows: amplitude sums, torques, pairs of bodies."""
        n_pairs = 0 if self._clearance is None else self._clearance.n_pairs
        return (0 if self._sums is None else 2 * self._n_moved) + self._n_moved + n_pairs

    def program(self, x: Array, sharpness: float, multipliers: Array) -> AugmentedLagrangian:
        """What is minimised near ``x``."""
        strained = np.flatnonzero(self._torques.peaks(x) > _TORQUE_SHARE)
        objective = partial(self.objective.smooth, sharpness=sharpness)
        return AugmentedLagrangian(objective, partial(self._rows, strained=strained), multipliers, _WEIGHT)

    def merit(self, x: Array) -> float:
        """Criterion and penalty by which points are compared."""
        return self.program(x, _MERIT, np.zeros(self.n_rows))(x)[0]

    def _rows(self, x: Array, strained: NDArray[np.intp]) -> tuple[Array, Array]:
        """What is left of each nonlinear limit, and the Jacobian; joints that are not strained have all of theirs."""
        torque, slope = np.ones(self._n_moved), np.zeros((self._n_moved, len(x)))
        if len(strained):
            torque[strained], slope[strained] = self._torques.rows(x, strained)
        left, slopes = [torque], [slope]
        if self._sums is not None:
            sums, slope = self._sums.rows(x)
            left.append(sums)
            slopes.append(slope)
        if self._clearance is not None:
            apart, slope = self._clearance.smooth(x)
            left.append(apart / _CLEARANCE_UNIT)
            slopes.append(slope / _CLEARANCE_UNIT)
        return np.concatenate(left), np.vstack(slopes)
