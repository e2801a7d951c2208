"""The search for a series over several starts, which ends in motions that were found safe, or says why not.

Each start draws motions within the limits, solves the nonlinear program from the best of them, kicks the solution and
solves anew, and solves a last time on a finer grid. What is linear in the variables, limits of position, velocity and
acceleration, stands in the program as it is; torques and distances of bodies are in an augmented Lagrangian.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from importlib.metadata import version
from typing import NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, Moved
from excite.errors import InputError, NoSolutionError
from excite.excitation.near_bodies import NearBodies
from excite.excitation.series import ExcitationTask, Layout, log_condition
from excite.motion.generators.curves import Curve
from excite.motion.generators.generator import child_seed
from excite.motion.motion import Motion, MotionMetadata
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs, at_once, check_jobs
from excite.parallel.worker import Shared
from excite.progress import Progress, silent
from excite.regressor.adjoint import regressor_gradient
from excite.regressor.kernels import Placements
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.threads import one_blas_thread

NAME = "optimised_fourier"

# Samples in a cycle of the fastest harmonic while searching and at the end, at least for limits, and to judge.
_SEARCH, _FINE, _LIMITS, _JUDGE = 16.0, 24.0, 20.0, 200.0
# Sharpness of the smooth criterion and iterations, stage by stage; of the kicks; of the end.
_STAGES = ((4.0, 80), (32.0, 100), (32.0, 100))
_KICK_STAGES = ((4.0, 25), (32.0, 60), (32.0, 60))
_LAST = ((64.0, 40), (64.0, 40))
# Starts drawn for each one that is solved, and how many of them have their collisions looked at.
_DRAWS, _JUDGED = 60, 12
# Standard deviation of a kick, in units of the variables.
_KICK = 0.25
# Distance beyond the collision margin while searching and at the end, for what happens between samples; clearance that
# counts as much as a whole limit; pairs farther apart than this beyond the margin do not enter [m].
_EXTRA, _EXTRA_FINE, _CLEARANCE_UNIT, _NEAR = 0.012, 0.006, 0.05, 0.1
# Torque limits enter for joints that come this near to them.
_TORQUE_SHARE = 0.7
# Weight of the augmented Lagrangian's penalty, on violations in shares of limits; how far linear rows may be outside.
_WEIGHT, _ROOM = 60.0, 1e-3
# The smooth minimum of distances over time is at most log(n)/SHARPNESS below the minimum [1/m]; the norm that stands
# for the largest torque exceeds it by n^(1/EXPONENT) at most; Coulomb's sign is smooth over this share of the speed.
_SHARPNESS, _EXPONENT, _SIGN_WIDTH = 1000.0, 100.0, 0.02
# A motion that just misses its limits or collides between samples is made smaller in steps, down to this share.
_SMALLER, _SMALLEST = 0.98, 0.5


@dataclass(frozen=True, eq=False)
class LinearRows:
    """``lower ≤ matrix @ x ≤ upper``, rows in shares of their limits: ``(m, size)``, ``(m,)``, ``(m,)``."""

    matrix: Array
    lower: Array
    upper: Array

    def excess(self, x: Array) -> float:
        """How far the worst row is outside, zero if none is."""
        value = self.matrix @ x
        return float(np.maximum(self.lower - value, value - self.upper).max(initial=0.0))

    def total_excess(self, x: Array) -> float:
        """How far all rows are outside together."""
        value = self.matrix @ x
        return float(np.maximum(np.maximum(self.lower - value, value - self.upper), 0.0).sum())


def linear_rows(layout: Layout, time: Array) -> LinearRows:
    """Position, velocity and acceleration limits at given times.

    Rows that cannot bind are left out: the derivative of a trigonometric polynomial of order L is at most
    ``ω L`` times its largest value (Bernstein; Zygmund 2002, vol. II, theorem X.3.13), so that a velocity limit
    may imply the acceleration's.
    """
    family, limits = layout.family, layout.limits
    bases, n_joints = [family.basis(time, order) for order in range(3)], len(layout.start)
    half = 0.5 * (limits.position_upper - limits.position_lower)
    middle = 0.5 * (limits.position_upper + limits.position_lower)
    blocks, shifts = [], []
    for i in range(n_joints):
        kinds = [half[i], limits.velocity[i], limits.acceleration[i]]
        implied = 2.0 * np.pi * family.fastest_hz * kinds[1] <= kinds[2]
        for order, limit in enumerate(kinds[:2] if family.is_periodic and implied else kinds):
            by_offset, by_table = (
                np.zeros((len(time), n_joints)),
                np.zeros((len(time), n_joints, family.n_coefficients)),
            )
            by_table[:, i] = bases[order] / limit
            by_offset[:, i] = (order == 0) / limit
            blocks.append(layout.gathered(by_offset, by_table))
            shifts.append(np.full(len(time), (middle[i] - layout.start[i]) / limit if order == 0 else 0.0))
    matrix, shift = np.vstack(blocks), np.concatenate(shifts)
    moving = np.abs(matrix).max(axis=1) > 1e-12
    return LinearRows(matrix[moving], shift[moving] - 1.0, shift[moving] + 1.0)


class Clearances(NamedTuple):
    """Smooth minima over time of pairs' distances less what is required ``(n_pairs,)`` [m], and their slopes.

    Attributes:
        smooth: what they are; never more than the minima.
        least: the smallest distance at a sample, at most 0.1 [m].
        sample: ``(m,)`` where distances pull.
        pair: ``(m,)`` whose.
        slope: ``(m, n_joints)`` in the joints there.
    """

    smooth: Array
    least: float
    sample: NDArray[np.intp]
    pair: NDArray[np.intp]
    slope: Array


class SeriesProgram:
    """The task's program at one density of samples.

    Args:
        task: the task.
        layout: its variables.
        per_cycle: samples in a cycle of the fastest part.
        extra: distance beyond the robot's collision margin [m]; pairs that keep less than that keep no more. None where
            bodies do not matter.
    """

    def __init__(self, task: ExcitationTask, layout: Layout, per_cycle: float, extra: float | None) -> None:
        self._layout, self.rows = layout, task.rows
        robot, family = task.robot, task.family
        time = family.grid(per_cycle)
        self._bases = tuple(family.basis(time, order) for order in range(3))
        self._n_base = len(self.rows.independent)
        self._width = _SIGN_WIDTH * robot.limits.velocity
        self._room = np.maximum(layout.limits.torque - self.rows.drives[1], 1e-6)
        self._bodies, self._required = None, np.zeros(0)
        if task.avoid_collisions and extra is not None:
            self._bodies = NearBodies(robot, np.arange(robot.n_joints) + 1)
            kept = self._bodies.kept
            self._required = kept + np.where(kept < robot.description.collision.margin, 0.0, extra)
        self._further = None if task.further is None else task.further(layout)
        box = np.full(layout.size, 50.0)
        self.linear = (
            linear_rows(layout, family.grid(max(per_cycle, _LIMITS)))
            if self._further is None
            else LinearRows(np.eye(layout.size), -box, box)
        )

    @property
    def shares(self) -> Callable[[Array], Array]:
        """Largest share of its limits that each joint uses, ``(n_joints,)``, of variables."""
        return self._layout.shares if self._further is None else self._further.shares

    def states(self, x: Array) -> Moved:
        """Positions, velocities and accelerations ``(n, n_joints)`` of variables ``(size,)``."""
        offset, table = self._layout.parts(x)
        q, v, a = (basis @ table.T for basis in self._bases)
        return Moved(offset + q, v, a)

    def value(self, x: Array, p: float = np.inf) -> float:
        """Logarithm of the condition number; with Coulomb friction's sign as it is where maxima are."""
        q, v, a = self.states(x)
        sign = np.sign(v) if np.isinf(p) else np.tanh(v / self._width)
        flat = self.rows.weighted(self.rows.regressor(q, v, a), v, a, sign).reshape(-1, self._n_base)
        return log_condition(flat.T @ flat / len(q), p).value

    def evaluate(self, x: Array, p: float, multipliers: Array) -> tuple[float, Array]:
        """The augmented Lagrangian (Nocedal and Wright 2006, 17.4), and its gradient ``(size,)``."""
        rows, (q, v, a) = self.rows, self.states(x)
        sign = np.tanh(v / self._width)
        sign_slope = (1.0 - sign**2) / self._width
        full = rows.regressor(q, v, a)
        flat = rows.weighted(full, v, a, sign).reshape(-1, self._n_base)
        found = log_condition(flat.T @ flat / len(q), p)
        slope = (2.0 / len(q)) * (flat @ found.slope).reshape(*v.shape, self._n_base)
        pulled = rows.pulled(slope, sign_slope, full.shape[2])
        torque, pull = self._torques(full, v, a)
        near = self._clearances(q)
        left = [1.0 - torque, near.smooth / _CLEARANCE_UNIT]
        if self._further is not None:
            further, jacobian = self._further.rows(x)
            left.append(further)
        # Newton's steps from far outside need a slope: a penalty pulls in, multipliers make its bias vanish.
        held = multipliers / _WEIGHT
        lack = np.maximum(0.0, held - np.concatenate(left))
        value = found.value + 0.5 * _WEIGHT * float((lack**2).sum() - (held**2).sum())
        of_torque, of_pairs, of_further = np.split(lack, np.cumsum([len(part) for part in left[:2]]))
        by_torque = _WEIGHT * of_torque * pull
        viscous, _, armature = rows.drives
        weights = pulled.weights + by_torque[:, :, None] * rows.tree.phi
        gradient = regressor_gradient(rows.tree, q, v, a, weights)
        by_q = gradient.q
        np.add.at(by_q, near.sample, (-_WEIGHT / _CLEARANCE_UNIT * of_pairs[near.pair])[:, None] * near.slope)
        by_v = gradient.v + pulled.v + by_torque * viscous
        by_a = gradient.a + pulled.a + by_torque * armature
        zero, one, two = self._bases
        whole = self._layout.gathered(by_q.sum(axis=0), by_q.T @ zero + by_v.T @ one + by_a.T @ two)
        return value, whole if self._further is None else whole - _WEIGHT * (of_further @ jacobian)

    def updated(self, x: Array, multipliers: Array) -> Array:
        """Multipliers for the next solve, from where this one ended."""
        return np.maximum(0.0, multipliers - _WEIGHT * self._left(x))

    def no_multipliers(self, x: Array) -> Array:
        """One a nonlinear row."""
        return np.zeros(len(self._left(x)))

    def _left(self, x: Array) -> Array:
        q, v, a = self.states(x)
        torque, _ = self._torques(self.rows.regressor(q, v, a), v, a)
        left = [1.0 - torque, self._clearances(q).smooth / _CLEARANCE_UNIT]
        return np.concatenate(left if self._further is None else [*left, self._further.rows(x)[0]])

    def choose(self, draws: list[Array]) -> Array:
        """The draw with the best criterion, less what it collides by; of all but the best few the first alone."""
        values = np.array([self.value(x, 1.0) for x in draws])
        order = np.argsort(values, kind="stable")[:_JUDGED]
        lack = np.array([min(0.0, self._clearances(self.states(draws[k])[0]).least) for k in order])
        return draws[int(order[np.argmin(values[order] - 10.0 * lack)])]

    def _torques(self, full: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Smooth maxima over time of the drives' torques, of what limits and Coulomb friction leave ``(n_joints,)``,
        and their slopes in the torques ``(n, n_joints)``; zero for joints that are not strained."""
        share = self.rows.torques(full, v, a, np.zeros(1)) / self._room
        size = np.abs(share)
        top = size.max(axis=0)
        strained = top > _TORQUE_SHARE
        power = (size / np.where(strained, top, 1.0)) ** (_EXPONENT - 1.0)
        total = np.where(strained, (power * size / np.where(strained, top, 1.0)).sum(axis=0), 1.0)
        pull = power * total ** (1.0 / _EXPONENT - 1.0) * np.sign(share) / self._room
        return np.where(strained, top * total ** (1.0 / _EXPONENT), 0.0), np.where(strained, pull, 0.0)

    def _clearances(self, q: Array) -> Clearances:
        if self._bodies is None:
            none = np.zeros(0, dtype=np.intp)
            return Clearances(np.zeros(0), _NEAR, none, none, np.zeros((0, q.shape[1])))
        poses: Placements
        poses, close = self._bodies.find(q, self._required + _NEAR)
        value, n_pairs = close.distance - self._required[close.pair], len(self._required)
        least = np.full(n_pairs, _NEAR)
        np.minimum.at(least, close.pair, value)
        weight = np.exp(-_SHARPNESS * (value - least[close.pair]))
        total = np.bincount(close.pair, weights=weight, minlength=n_pairs)
        # What is not near weighs as much as at the edge, so that the minimum does not jump when a pair comes near.
        count = np.bincount(close.pair, minlength=n_pairs)
        total += (len(q) - count) * np.exp(-_SHARPNESS * (_NEAR - least))
        slope = (weight / total[close.pair])[:, None] * self._bodies.slopes(poses, close)
        smooth = least - np.log(total) / _SHARPNESS
        return Clearances(smooth, float(value.min(initial=_NEAR)), close.sample, close.pair, slope)


ValueAndGradient = Callable[[Array], tuple[float, Array]]


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a solve ended: the best point met at which the rows hold, else where the solver stopped.

    Attributes:
        x: the point.
        feasible: whether they hold there.
    """

    x: Array
    feasible: bool


def solve_program(
    objective: ValueAndGradient, rows: LinearRows, start: Array, *, iterations: int
) -> Solution:
    """Minimise a function under linear rows.

    Sequential quadratic programming (Nocedal and Wright 2006, chapter 18) with a damped BFGS Hessian, each quadratic
    program by DAQP's dual active set (Arnström, Bemporad, Axehill 2022); a step is taken where it beats the worst of
    the last four merits (Grippo, Lampariello, Lucidi 1986). L-BFGS-B on penalties, which designs motions of many
    coefficients (:mod:`~excite.excitation.gradient_design`), ends at half again to twice the condition number in the
    same time.

    Args:
        objective: value and exact gradient.
        rows: linear rows.
        start: ``(size,)``.
        iterations: at most.
    """
    matrix, x = np.ascontiguousarray(rows.matrix), start
    value, slope = objective(x)
    best = (value, x) if rows.excess(x) <= _ROOM else (np.inf, None)
    hessian, kinds, weight = np.eye(len(x)), np.zeros(len(matrix), dtype=np.int32), 0.0
    merits = deque[float](maxlen=4)
    for _ in range(iterations):
        at = matrix @ x
        step, _, ending, told = daqp.solve(hessian, slope, matrix, rows.upper - at, rows.lower - at, kinds)
        if ending < 1:
            break
        step, dual = np.array(step), np.array(told["lam"])
        # The next program begins with the rows that are active now: DAQP's 1 is at the upper end, 3 at the lower.
        kinds = np.where(dual == 0.0, 0, np.where(dual > 0.0, 1, 3)).astype(np.int32)
        if np.abs(slope + matrix.T @ dual).max() < 1e-4 and rows.excess(x) < 1e-6:
            break
        weight = max(weight, 1.01 * float(np.abs(dual).max(initial=0.0)))
        outside = rows.total_excess(x)
        merits.append(value + weight * outside)
        fall, share = float(slope @ step) - weight * outside, 1.0
        for _ in range(8):
            tried = x + share * step
            there, slope_there = objective(tried)
            if there < best[0] and rows.excess(tried) <= _ROOM:
                best = there, tried
            if there + weight * rows.total_excess(tried) <= max(merits) + 1e-4 * share * fall:
                break
            share *= 0.8
        hessian = _updated_hessian(hessian, tried - x, slope_there - slope)
        x, value, slope = tried, there, slope_there
    return Solution(x if best[1] is None else best[1], best[1] is not None)


def _updated_hessian(hessian: Array, step: Array, change: Array) -> Array:
    """BFGS with Powell's damping (Nocedal and Wright 2006, procedure 18.2)."""
    ahead = hessian @ step
    curved, along = float(step @ ahead), float(step @ change)
    if curved <= 0.0:
        return hessian
    if along < 0.2 * curved:
        theta = 0.8 * curved / (curved - along)
        change = theta * change + (1.0 - theta) * ahead
        along = 0.2 * curved
    return np.asarray(hessian + np.outer(change, change) / along - np.outer(ahead, ahead) / curved)


@dataclass(frozen=True)
class SearchSettings:
    """How hard to search; the result depends on these and the seed, and on nothing else.

    Attributes:
        starts: independent starts.
        kicks: times that each start's best is kicked and solved anew.
        effort: factor on the iterations of every solve.
        seed: of all random numbers.
    """

    starts: int = 4
    kicks: int = 3
    effort: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the bounds; raises InputError naming the setting."""
        for name, least in (("starts", 1), ("kicks", 0), ("seed", 0)):
            if getattr(self, name) < least:
                raise InputError(f"is {getattr(self, name)}", field=name, remedy=f"give at least {least}")
        if not 0.0 < self.effort < np.inf:
            raise InputError(f"is {self.effort}", field="effort", remedy="give a positive number")


@dataclass(frozen=True, eq=False)
class Point:
    """Where a start has got to.

    Attributes:
        x: variables ``(size,)``.
        value: smoothed criterion and a penalty on what is violated, by which points are compared.
        multipliers: of the nonlinear rows.
    """

    x: Array
    value: float
    multipliers: Array


class SeriesSearch:
    """The steps of the search, from start to start: draw, kick, finish.

    Args:
        task: the task.
        effort: factor on the iterations of every solve.

    Raises:
        NoSolutionError: limits leave no room.
        InputError: the robot has no gradients.
    """

    def __init__(self, task: ExcitationTask, effort: float = 1.0) -> None:
        # What has no rows is refused here, and not in other processes.
        self.task, self._effort, self.layout, self.rows = task, effort, task.layout(), task.rows

    # What watches bodies does not travel to other processes: each makes its own.
    @cached_property
    def coarse(self) -> SeriesProgram:
        """The program of the search."""
        return SeriesProgram(self.task, self.layout, _SEARCH, _EXTRA)

    @cached_property
    def _fine(self) -> SeriesProgram:
        return SeriesProgram(self.task, self.layout, _FINE, _EXTRA_FINE)

    @cached_property
    def _judge(self) -> SeriesProgram:
        return SeriesProgram(self.task, self.layout, _JUDGE, None)

    def figure(self, x: Array) -> float:
        """The condition number, finely sampled."""
        return float(np.exp(self._judge.value(x)))

    @one_blas_thread
    def step(self, point: Point | None, number: int, rounds: int, seed: int) -> Point:
        """One round of a start: its first solve, a kick, or the end on the fine grid."""
        rng = np.random.default_rng(seed)
        if point is None:
            best = self.coarse.choose([self._draw(rng) for _ in range(_DRAWS)])
            return self._staged(best, self.coarse.no_multipliers(best), self.coarse, _STAGES)
        if number == rounds - 1:
            return self._staged(point.x, point.multipliers, self._fine, _LAST)
        x = point.x + _KICK * rng.standard_normal(len(point.x))
        n = len(self.layout.reach)
        x[:n] = np.clip(x[:n], -0.9, 0.9)
        found = self._staged(self.fitted(x), point.multipliers, self.coarse, _KICK_STAGES)
        return found if found.value < point.value else point

    def fitted(self, x: Array) -> Array:
        """Variables made smaller where they pass limits."""
        return self.layout.scaled(x, 1.0 / np.maximum(self.coarse.shares(x), 1.0))

    def _draw(self, rng: np.random.Generator) -> Array:
        x, n = rng.standard_normal(self.layout.size), len(self.layout.reach)
        x[:n] = rng.uniform(-0.3, 0.3, n)
        return self.layout.scaled(x, 0.98 / self.coarse.shares(x))

    def _staged(
        self, x: Array, multipliers: Array, program: SeriesProgram, stages: tuple[tuple[float, int], ...]
    ) -> Point:
        for p, iterations in stages:
            found = solve_program(
                partial(program.evaluate, p=p, multipliers=multipliers),
                program.linear,
                x,
                iterations=max(1, round(self._effort * iterations)),
            )
            if found.feasible:
                x, multipliers = found.x, program.updated(found.x, multipliers)
        value = program.evaluate(x, _LAST[-1][0], np.zeros_like(multipliers))[0]
        return Point(x, value, multipliers)


@dataclass(frozen=True, eq=False)
class OptimisedMotion:
    """One start's end.

    Attributes:
        start: number of the start.
        curve: of all joints.
        motion: the same as samples at the robot's rate.
        value: the condition number, finely sampled.
    """

    start: int
    curve: Curve
    motion: Motion
    value: float


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What the search found.

    Attributes:
        found: safe motions, the best first.
        interrupted: whether the user broke off; the motions are then the best until then.
    """

    found: tuple[OptimisedMotion, ...]
    interrupted: bool

    @property
    def best(self) -> OptimisedMotion:
        """The best motion."""
        return self.found[0]


def optimise_excitation(
    task: ExcitationTask,
    settings: SearchSettings | None = None,
    *,
    jobs: Jobs = 1,
    progress: Progress = silent,
) -> SearchResult:
    """Search for the best motion of a task.

    What comes out is scaled into its limits exactly and judged by the independent check; what that refuses is made
    smaller until it passes.

    Args:
        task: what to optimise.
        settings: how hard to search.
        jobs: number of processes, or an executor; the result does not depend on it.
        progress: told after each solve, stage ``optimise``.

    Returns:
        The safe motions. Ctrl-C ends the search with the best until then.

    Raises:
        NoSolutionError: limits leave no room, or no start ended in a safe motion; the error counts the reasons.
        InputError: settings or columns do not fit, or the robot has no gradients.
    """
    settings = settings or SearchSettings()
    check_jobs(jobs)
    search = SeriesSearch(task, settings.effort)
    shared = Shared(search)
    points: list[Point | None] = [None] * settings.starts
    rounds, done, interrupted = settings.kicks + 2, 0, False
    root = np.random.SeedSequence(settings.seed)
    try:
        for number in range(rounds):
            steps = [
                (point, number, rounds, child_seed(root, index * rounds + number))
                for index, point in enumerate(points)
            ]
            solved = in_order(_run_step, steps, jobs=at_once(jobs), shared=shared, stage="optimise")
            for index, point in enumerate(solved):
                points[index] = point
                done += 1
                progress("optimise", done, rounds * settings.starts)
    except KeyboardInterrupt:
        interrupted = True
        if not any(point is not None for point in points):
            raise
    ends = [_made_safe(search, index, point) for index, point in enumerate(points) if point is not None]
    found = [end for end in ends if isinstance(end, OptimisedMotion)]
    if not found:
        counted = Counter(end for end in ends if isinstance(end, str))
        reasons = ", ".join(f"{count} {reason}" for reason, count in counted.items())
        raise NoSolutionError(
            f"none of {len(points)} starts ends in a safe motion of {task.robot.name} ({reasons})",
            remedy="give more room to the joints, more starts, or another rest posture",
        )
    found.sort(key=lambda motion: (motion.value, motion.start))
    return SearchResult(tuple(found), interrupted)


def _run_step(search: SeriesSearch, step: tuple[Point | None, int, int, int]) -> Point:
    return search.step(*step)


def _made_safe(search: SeriesSearch, index: int, point: Point) -> OptimisedMotion | str:
    """A start's end, scaled into its limits and made smaller until it is safe; or the reason why it is not.

    Collisions count only where they are to be avoided.
    """
    task, x = search.task, search.fitted(point.x)
    share, reason = 1.0, "no_motion"
    while share >= _SMALLEST:
        smaller = search.layout.scaled(x, share)
        curve = search.layout.curve(smaller)
        motion = sample_curve(task.robot, curve, f"{NAME}_{index:03d}", index)
        kinds = [one.kind for one in check_motion(task.robot, motion).violations]
        refused = [kind for kind in kinds if task.avoid_collisions or kind != "self_collision"]
        if not refused:
            return OptimisedMotion(index, curve, motion, search.figure(smaller))
        reason, share = refused[0], share * _SMALLER
    return reason


def sample_curve(robot: Robot, curve: Curve, name: str, seed: int | None = None) -> Motion:
    """A curve in time as a motion of an arm at the robot's rate."""
    n = max(2, int(np.ceil(curve.length * robot.description.sensors.rate_hz)))
    time = np.linspace(0.0, curve.length, n + 1)
    versions = {package: version(package) for package in ("excite", "daqp", "numpy")}
    q, v, a = (curve.evaluate(time, order) for order in range(3))
    metadata = MotionMetadata(NAME, seed, robot.joint_names, robot_hash=robot.hash, versions=versions)
    return Motion(name, robot.name, robot.joint_names, time, q, v, a, metadata=metadata)
