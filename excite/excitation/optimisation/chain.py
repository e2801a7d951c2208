"""One start of the search: draw, solve, then kick the best and solve again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError
from excite.excitation.optimisation.limits import JointLimits, LinearRows, linear_rows, peak_shares
from excite.excitation.optimisation.near_bodies import NearBodies, NearPairs
from excite.excitation.optimisation.objective import Layout, Objective, Sampling, make_criterion
from excite.excitation.optimisation.program import AugmentedLagrangian, TorqueLimits, solve_program
from excite.excitation.optimisation.task import ExcitationTask
from excite.motion.generators.curves import FourierCurve
from excite.motion.generators.joint_motions import amplitude_scale
from excite.regressor.kernels import Placements
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


# The papers' own limits of Fourier series: sums of amplitudes instead of the motion's peaks.

# Keeps the root's derivative finite where an amplitude vanishes, as a share of the velocity limit.
_ROUNDING = 1e-4


class AmplitudeSums:
    """Sums of amplitudes of eq. (10) of Xu et al. 2020, in shares of the limits, two rows a joint.

    Args:
        layout: of a Fourier family.
        limits: joint limits; positions are counted from the offset to the nearer end.

    Raises:
        InputError: another family, or a start that is to be chosen (the sums are about a given one).
    """

    def __init__(self, layout: Layout, limits: JointLimits) -> None:
        still = layout.family.curve(np.zeros(1), np.zeros((1, layout.family.n_coefficients)))
        if not isinstance(still, FourierCurve) or layout.free_offset:
            raise InputError(
                "sums of amplitudes of a motion that is no series about a given start",
                field="amplitude_sums",
                remedy="use a Fourier family and a fixed start",
            )
        self._layout, self._omega = layout, still.omega
        unit = layout.family.curve(
            np.zeros(layout.family.n_coefficients), np.eye(layout.family.n_coefficients)
        )
        if not isinstance(unit, FourierCurve):
            raise InputError("no Fourier series", field="amplitude_sums")
        self._a, self._b = unit.a, unit.b
        joints = layout.joints
        self._reach = np.minimum(limits.upper[joints] - layout.start, layout.start - limits.lower[joints])
        self._speed = limits.velocity[joints]

    def rows(self, x: Array) -> tuple[Array, Array]:
        """What is left of each limit, ``(2·n_moved,)``, and its gradient ``(2·n_moved, size)``."""
        table = self._layout.parts(x)[1]
        a, b = table @ self._a, table @ self._b
        number = np.arange(1, a.shape[1] + 1)
        size = np.sqrt(a**2 + b**2 + (_ROUNDING * self._speed[:, None]) ** 2)
        n = len(self._speed)
        by_table = np.zeros((2 * n, *table.shape))
        left = np.empty(2 * n)
        for k, weight in enumerate((1.0 / (number * self._omega), np.ones(len(number)))):
            limit = (self._reach, self._speed)[k]
            left[k * n : (k + 1) * n] = 1.0 - (size * weight).sum(axis=1) / limit
            slope = -((a / size * weight) @ self._a.T + (b / size * weight) @ self._b.T) / limit[:, None]
            by_table[k * n + np.arange(n), np.arange(n)] = slope
        return left, self._layout.gathered(np.zeros((2 * n, n)), by_table)

    def shares(self, x: Array) -> Array:
        """Largest share of its limits that each joint uses, ``(n_moved,)``."""
        table = self._layout.parts(x)[1]
        a, b = table @ self._a, table @ self._b
        return 1.0 / amplitude_scale(a, b, self._omega, self._reach, self._speed)


# Distances between a robot's bodies over time as smooth constraints, with their gradients.

# Pairs farther apart than this beyond the margin do not enter [m].
_NEAR = 0.1
# The smooth minimum over time is at most log(n)/SHARPNESS below the minimum [1/m].
_SHARPNESS = 1000.0


class Clearance:
    """For each pair of bodies the smooth minimum of its distance over time, less what is required.

    The smooth minimum ``-log Σ exp(-ρ d)/ρ`` never exceeds the minimum, so that a motion that satisfies it is
    free at the samples.

    Args:
        layout: what the variables stand for.
        time: ``(n,)`` at which distances are taken [s].
        extra: distance beyond the robot's collision margin [m]; pairs that keep less than that keep no more.
    """

    def __init__(self, layout: Layout, time: Array, extra: float) -> None:
        robot = layout.robot
        self._sampling = Sampling(layout, time)
        self._joints = layout.joints + (2 if robot.floating else 1)
        self._bodies = NearBodies(robot, self._joints)
        kept = self._bodies.kept
        self._required = kept + np.where(kept < robot.description.collision.margin, 0.0, extra)
        self.n_pairs = len(kept)

    def smooth(self, x: Array) -> tuple[Array, Array]:
        """Smooth minimum of each pair's clearance ``(n_pairs,)`` [m] and its gradient ``(n_pairs, size)``."""
        poses, close = self._close(x)
        value = close.distance - self._required[close.pair]
        least = np.full(self.n_pairs, _NEAR)
        np.minimum.at(least, close.pair, value)
        weight = np.exp(-_SHARPNESS * (value - least[close.pair]))
        total = np.bincount(close.pair, weights=weight, minlength=self.n_pairs)
        # What is not near weighs as much as at the edge, so that the minimum does not jump when a pair comes near.
        n = len(self._sampling.time)
        count = np.bincount(close.pair, minlength=self.n_pairs)
        total += (n - count) * np.exp(-_SHARPNESS * (_NEAR - least))
        smooth = least - np.log(total) / _SHARPNESS
        pull = (weight / total[close.pair])[:, None] * self._bodies.slopes(poses, close)
        by_offset = np.zeros((self.n_pairs, len(self._joints)))
        np.add.at(by_offset, close.pair, pull)
        basis = self._sampling.bases[0]
        by_table = np.zeros((self.n_pairs, len(self._joints), basis.shape[1]))
        np.add.at(by_table, close.pair, pull[:, :, None] * basis[close.sample][:, None, :])
        return smooth, self._sampling.layout.gathered(by_offset, by_table)

    def least(self, x: Array) -> float:
        """Smallest clearance at the samples [m], at most 0.1."""
        close = self._close(x)[1]
        return float((close.distance - self._required[close.pair]).min(initial=_NEAR))

    def _close(self, x: Array) -> tuple[Placements, NearPairs]:
        return self._bodies.find(self._sampling.whole(x).q, self._required + _NEAR)
