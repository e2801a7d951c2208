"""Motions designed by gradients: splines added to a safe motion, for the information that those before lack.

Swevers et al. 1997 make motions rich by optimising their coefficients; Wilson and Murphey 2014 follow gradients of the
Fisher information; Ayusawa et al. 2017 take them analytically for several motions one after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import minimize

from excite.arrays import Array, Moved
from excite.excitation.design_coordinates import JointCoordinates
from excite.excitation.design_rows import SEARCH_HZ, DesignRows
from excite.excitation.near_bodies import NearBodies, NearPairs
from excite.excitation.selection import Criterion
from excite.motion.motion import Motion, interpolate_motion
from excite.regressor.adjoint import regressor_gradient
from excite.regressor.kernels import forward_kinematics
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.parameter_set import ParameterSet, stated_parameters
from excite.safety.verdict import Verdict
from excite.threads import one_blas_thread

# Name of motions that are designed.
GRADIENT = "gradient"

_DEGREE = 4


@dataclass(frozen=True)
class DesignSettings:
    """How motions are searched for; ``python -m benchmarks.minutes --settings`` changes one after the other.

    Attributes:
        knot_s: distance of the splines' knots [s].
        rate_hz: samples that limits and criterion are looked at in the last rounds [Hz].
        coarse: share of that rate in the rounds before.
        reach: root mean square of what a round adds at most, as a share of the limits.
        velocity: share of the velocities that is used at the samples: between them motions go beyond.
        acceleration: the same of the accelerations.
        near_m: bodies nearer than this beyond their margin are watched [m].
        extra_m: distance beyond the margin, for what happens between the samples [m].
        rounds: of the search, before each of which nearest points are found anew.
        more_rounds: at most, while safe steps are short: what little is known pulls harder than the first weights.
        enough: part of the way that is not short.
        iterations: in each round.
        weight: of squared violations in the first round.
        growth: of that weight from round to round.
    """

    knot_s: float = 0.25
    rate_hz: float = SEARCH_HZ
    coarse: float = 0.5
    reach: float = 0.3
    velocity: float = 0.98
    acceleration: float = 0.94
    near_m: float = 0.06
    extra_m: float = 0.01
    rounds: int = 4
    more_rounds: int = 2
    enough: float = 0.9
    iterations: int = 35
    weight: float = 0.2
    growth: float = 5.0


_USUAL = DesignSettings()


@dataclass(frozen=True, eq=False)
class _Witnesses:
    """Points of pairs of bodies that come near each other, fixed to the bodies.

    Attributes:
        pairs: where they were found.
        joints: ``(m, 2)`` that carry them.
        points: ``(m, 2, 3)`` in the joints' frames [m].
    """

    pairs: NearPairs
    joints: NDArray[np.intp]
    points: Array


class DesignProgram:
    """A criterion of prior and own information less what violates the limits, in a spline's coefficients.

    Args:
        rows: of the robot.
        source: the safe motion that the spline is added to.
        prior: information so far, ``(n_base, n_base)``, of samples at the search's rate.
        criterion: what to make large.
        settings: of the search.
        rate_hz: samples that are looked at [Hz]; the settings' own if None.
    """

    def __init__(
        self,
        rows: DesignRows,
        source: Motion,
        prior: Array,
        criterion: Criterion,
        settings: DesignSettings = _USUAL,
        rate_hz: float | None = None,
    ) -> None:
        rate_hz = rate_hz or settings.rate_hz
        # A copy that was sent to another process lies otherwise in memory, and sums of it would round otherwise.
        self._rows, self._prior, self._criterion = rows, np.ascontiguousarray(prior), criterion
        self.source, self._settings = source, settings
        robot, moved = rows.robot, rows.moved
        limits = robot.limits
        self._velocity = settings.velocity * limits.velocity[moved]
        self._acceleration = settings.acceleration * limits.acceleration[moved]
        self._at_q, self._at_v = robot.n_base_q + moved, robot.n_base_v + moved
        n = max(4, round(source.duration / settings.knot_s))
        self._knots = np.r_[
            np.zeros(_DEGREE), np.linspace(0.0, source.duration, n + 1), np.full(_DEGREE, source.duration)
        ]
        time = np.linspace(0.0, source.duration, max(8, round(source.duration * rate_hz)) + 1)
        self._bases = self._basis(time)
        nominal = interpolate_motion(source, robot, source.time[0] + time)
        self._coordinates: JointCoordinates = rows.coordinates(nominal)
        self._whitening = self._whiten(np.linspace(0.0, source.duration, 8 * n + 1))
        # Jerks jump at knots of the source: they are looked at between the samples too.
        fine = np.linspace(0.0, source.duration, 8 * len(time))
        own = self._coordinates.own
        between = interpolate_motion(source, robot, source.time[0] + fine).a[:, robot.n_base_v + own]
        rates = np.diff(between, axis=0) / fine[1]
        self._share = SEARCH_HZ / rate_hz
        self._jerk, self._jerk_basis = rates, self._basis(fine[:-1] + 0.5 * fine[1])[3]
        self._most_jerk = limits.jerk[own]
        self.size = self._whitening[:, 0].size
        self._tree = rows.tree
        self._half = 0.5 * (limits.position_upper - limits.position_lower)[moved]
        self._middle = limits.position_lower[moved] + self._half
        self._bodies = NearBodies(robot, moved + (2 if robot.floating else 1))
        self._burden = rows.burden(nominal)
        self._near: _Witnesses | None = None

    def _basis(self, time: Array) -> tuple[Array, ...]:
        """The splines and their first three derivatives, ``(n, k)`` each; those left out would move the ends."""
        count = len(self._knots) - _DEGREE - 1
        spline = BSpline(self._knots, np.eye(count), _DEGREE)
        inside = np.clip(time, 0.0, self._knots[-1] * (1.0 - 1e-12))
        values = ((spline.derivative(d) if d else spline)(inside)[:, 3:-3] for d in range(4))
        return tuple(np.ascontiguousarray(basis) for basis in values)

    def _whiten(self, time: Array) -> Array:
        """Units of the coefficients in which what is added takes the same share of its limits in all directions.

        Curvatures of criterion and penalties go with the squares of accelerations: without it a search of few steps
        leaves the slow parts as they are.
        """
        bases, limits = self._basis(time), self._coordinates.limits
        squared = np.array([basis.T @ basis for basis in bases]) * bases[0].shape[1] / len(time)
        shares = np.einsum("dc,dij->cij", 1.0 / np.maximum(limits, 1e-6) ** 2, squared)
        return self._settings.reach * np.linalg.inv(np.linalg.cholesky(shares)).transpose(0, 2, 1)

    def _table(self, x: Array) -> Array:
        """Coefficients of the splines, ``(k, n_coordinates)``."""
        return (self._whitening @ x.reshape(len(self._whitening), -1, 1))[:, :, 0].T

    def states(self, x: Array) -> Moved:
        """q ``(n, nq)``, v and a ``(n, nv)`` of coefficients ``(size,)``."""
        table = self._table(x)
        return self._coordinates.states([basis @ table for basis in self._bases])

    def information(self, x: Array) -> Array:
        """Information of the motion alone."""
        return self._share * self._rows.information(*self.states(x))

    def motion(self, x: Array) -> Motion:
        """The source with the splines added."""
        source, table = self.source, self._table(x)
        bases = self._basis(source.time - source.time[0])
        q, v, a = self._rows.coordinates(source).states([basis @ table for basis in bases])
        metadata = replace(source.metadata, generator=GRADIENT, verdict=None)
        return replace(source, q=q, v=v, a=a, metadata=metadata)

    def evaluate(self, x: Array, weight: float) -> tuple[float, Array]:
        """What is minimised, and its gradient ``(size,)``; ``weight`` is that of squared violations."""
        q, v, a = state = self.states(x)
        at_q, at_v = self._at_q, self._at_v
        width = np.ones(v.shape[1])
        width[at_v] = 0.02 * self._velocity
        sign = np.tanh(v / width)
        sign_slope = (1.0 - sign**2) / width
        full = self._rows.regressor(q, v, a)
        rows = self._rows.weighted(full, v, a, sign)
        flat = rows.reshape(-1, rows.shape[2])
        information = self._prior + self._share * (flat.T @ flat)
        value = -self._criterion.value(information)
        slope = -2.0 * self._share * (flat @ self._criterion.gradient(information)).reshape(rows.shape)
        weights, by_v, by_a, _ = self._rows.pulled(slope, sign_slope, full.shape[2])
        penalty, parts = 0.0, []
        table = self._table(x)
        own = slice(table.shape[1] - self._jerk.shape[1], None)
        jerk = self._jerk + self._jerk_basis @ table[:, own]
        for values, limit in (
            (q[:, at_q] - self._middle, self._half),
            (v[:, at_v], self._velocity),
            (a[:, at_v], self._acceleration),
            (self._burden.values(full, state, sign), self._burden.most),
            (jerk, 0.9 * self._most_jerk),
        ):
            over = 10.0 * np.maximum(np.abs(values) / limit - 0.99, 0.0)
            penalty += float((over**2).sum())
            parts.append(20.0 * weight * over * np.sign(values) / limit)
        by_q, burden = parts[0], self._burden.pulled(parts[3], full, state, sign_slope)
        penalty += self._push_apart(q, weight, by_q)
        # Torques beside the rows come after them.
        every = np.array(burden.weights)
        every[:, : weights.shape[1]] += weights
        gradient = regressor_gradient(self._tree, q, v, a, every, self._rows.loaded_joints)
        pulls = Moved(gradient.q + burden.q, gradient.v + by_v + burden.v, gradient.a + by_a + burden.a)
        for pull, part in zip(pulls, (by_q, *parts[1:3]), strict=True):
            pull[:, at_v] += part
        found = sum(
            basis.T @ pull
            for basis, pull in zip(self._bases, self._coordinates.pulled(state, pulls), strict=False)
        )
        found = np.array(found)
        found[:, own] += self._jerk_basis.T @ parts[4]
        return value + weight * penalty, (found.T[:, None] @ self._whitening).ravel()

    def watch(self, x: Array) -> None:
        """Find the nearest points of bodies that are near each other, and what else is found once a round."""
        state = self.states(x)
        self._burden.watch(self._rows.regressor(*state), state)
        poses, pairs = self._bodies.find(state.q, self._bodies.kept + self._settings.near_m)
        joints, at = self._bodies.carriers(pairs), pairs.sample[:, None]
        world = np.stack([pairs.first, pairs.second], axis=1)
        local = np.einsum("mkji,mkj->mki", poses.rotation[at, joints], world - poses.translation[at, joints])
        self._near = _Witnesses(pairs, joints, local)

    def _push_apart(self, q: Array, weight: float, by_q: Array) -> float:
        """Squared lack of distance in centimetres; its gradient is added to ``by_q``."""
        if self._near is None:
            return 0.0
        near, poses = self._near, forward_kinematics(self._tree, q)
        at = near.pairs.sample[:, None]
        turned = np.einsum("mkij,mkj->mki", poses.rotation[at, near.joints], near.points)
        first, second = (turned + poses.translation[at, near.joints]).transpose(1, 0, 2)
        apart = ((second - first) * near.pairs.normal).sum(axis=1)
        lack = np.maximum(self._bodies.kept[near.pairs.pair] + self._settings.extra_m - apart, 0.0) / 0.01
        lacking = lack > 0.0
        every = replace(near.pairs, first=first, second=second)
        pairs = NearPairs(**{name: values[lacking] for name, values in vars(every).items()})
        slope = self._bodies.slopes(poses, pairs)
        np.add.at(by_q, pairs.sample, (-2.0 * weight * lack[lacking] / 0.01)[:, None] * slope)
        return float((lack**2).sum())


@dataclass(frozen=True, eq=False)
class Design:
    """A motion that was designed.

    Attributes:
        motion: the motion, which the check finds safe.
        information: of the motion alone, ``(n_base, n_base)``.
        step: part of the way to the optimum that the check finds safe; 0 where the motion is its source still.
    """

    motion: Motion
    information: Array
    step: float


@one_blas_thread
def design_motion(
    rows: DesignRows,
    source: Motion,
    prior: Array,
    criterion: Criterion,
    *,
    robust: bool = False,
    stands: Callable[[Motion], bool] = lambda _: True,
    settings: DesignSettings = _USUAL,
) -> Design:
    """The motion near a safe one that adds most to the information so far.

    Coefficients are those of B-splines of degree four that leave both ends at rest. Squared violations of the limits
    and of distances at coal's witness points are penalties of growing weight; L-BFGS-B minimises, on fewer samples
    until the last rounds. The step is then shortened until the independent check finds the motion safe; with none left
    it is the source itself.

    Args:
        rows: of the robot.
        source: a safe motion.
        prior: ``(n_base, n_base)`` information so far, positive definite.
        criterion: what to make large.
        robust: whether the check asks for safety of all robots of the set that the description states. A standing
            robot's design leaves them no less than its source in any case.
        settings: of the search.
    """
    rates = (settings.coarse * settings.rate_hz, settings.rate_hz)
    first, program = (DesignProgram(rows, source, prior, criterion, settings, rate) for rate in rates)
    keeps_margins = rows.robot.floating and not robust
    parameters = stated_parameters(rows.robot) if keeps_margins else None
    least = _least_margins(check_motion(rows.robot, source, parameters=parameters)) if keeps_margins else {}
    x = np.zeros(program.size)
    best = Design(source, program.information(x), 0.0)
    for k in range(settings.rounds + settings.more_rounds):
        looked = program if k + 1 >= settings.rounds else first
        looked.watch(x)
        found = minimize(
            looked.evaluate, x, args=(settings.weight * settings.growth**k,), jac=True, method="L-BFGS-B",
            bounds=np.stack([x - 1.0, x + 1.0], axis=1), options={"maxiter": settings.iterations, "maxcor": 15},
        )  # fmt: skip
        x = np.asarray(found.x)
        # Each time twice as much is taken off the step.
        for step in (1.0, *(1.0 - 0.01 * 2**i for i in range(7))) if k + 1 >= settings.rounds else ():
            motion = program.motion(step * x)
            if _is_safe(rows.robot, motion, parameters, robust=robust, least=least) and stands(motion):
                safe = Design(motion, program.information(step * x), step)
                best = max(best, safe, key=lambda one: criterion.value(prior + one.information))
                break
        if best.step >= settings.enough:
            break
    return best


def design_motions(
    rows: DesignRows,
    sources: Sequence[Motion],
    start: Array,
    criterion: Criterion,
    *,
    robust: bool = False,
    stands: Callable[[Motion], bool] = lambda _: True,
    settings: DesignSettings = _USUAL,
) -> list[Design]:
    """Designs of motions that are run together, each for what those before it, as designed, and those after it lack.

    Args:
        rows: of the robot.
        sources: safe motions.
        start: ``(n_base, n_base)`` information to begin with, positive definite.
        criterion: what to make large.
        robust: as of :func:`design_motion`.
        stands: as of :func:`design_motion`.
        settings: of the search.
    """
    made: list[Design] = []
    own = [rows.of_motion(source) for source in sources]
    information = start + sum(own)
    for source, its in zip(sources, own, strict=True):
        before = information - its
        made.append(
            design_motion(rows, source, before, criterion, robust=robust, stands=stands, settings=settings)
        )
        information = before + made[-1].information
    return made


def _least_margins(verdict: Verdict) -> dict[str, float]:
    """What a design of a standing robot has to leave of each margin over the stated set: no less than its source."""
    worst = {} if verdict.robust is None else verdict.robust.worst
    return {name: min(one.value, one.limit) for name, one in worst.items() if one is not None}


def _is_safe(
    robot: Robot, motion: Motion, parameters: ParameterSet | None, *, robust: bool, least: Mapping[str, float]
) -> bool:
    verdict = check_motion(robot, motion, parameters=parameters, robust=robust)
    left = _least_margins(verdict)
    return verdict.safe and all(name in left and left[name] >= value for name, value in least.items())


@one_blas_thread
def first_information(rows: DesignRows, sources: Sequence[Motion]) -> Array:
    """A hundredth of what all sources say, which makes every determinant finite, ``(n_base, n_base)``."""
    total: Array = np.sum([rows.of_motion(motion) for motion in sources], axis=0)
    return 0.01 * total / len(sources) + 1e-9 * np.diag(np.diag(total)) + rows.prior
