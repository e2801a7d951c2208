"""Optimised excitation of three arms against published figures.

A loaded machine spoils wall time: a search of several starts is run in one process, and half of its processor time
counts as what two cores take.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from excite.arrays import Array
from excite.excitation.series import ExcitationTask, Layout, fourier_family
from excite.excitation.series_search import SearchResult, SearchSettings, optimise_excitation
from excite.motion.generators.curves import FourierCurve
from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.columns import measured_columns, regressor_rows
from excite.robot.loading import load_robot
from tests.benchmarks.table import Row
from tests.benchmarks.waypoints import waypoint_family
from tests.reproduction.iiwa import HARMONICS, N_JOINTS, PERIOD_S, iiwa, published_base

# One period, its harmonics, and repetitions. The article shows the first 20 s of its trajectory and does not say how
# long the whole is.
_JACO2_S, _JACO2_HARMONICS, _JACO2_PERIODS, _JACO2_HZ = 20.0, 10, 4, 100.0


def rows() -> list[Row]:
    """Condition numbers reached, and the time that took."""
    return [*_iiwa(), *_jaco2(), *_ur10()]


def _timed(task: ExcitationTask, settings: SearchSettings) -> tuple[SearchResult, float]:
    """The result, and half of the processor time [s]."""
    start = time.process_time()
    result = optimise_excitation(task, settings)
    return result, 0.5 * (time.process_time() - start)


def _iiwa() -> list[Row]:
    """Xu et al. 2020, Table 3, eq. (8) to (10): five harmonics of 0.05 Hz, Khalil's 57 columns, unscaled."""
    columns = np.array([item.column for item in published_base()])
    family = fourier_family(PERIOD_S, HARMONICS)
    sums = ExcitationTask(
        iiwa(),
        family,
        start=np.zeros(N_JOINTS),
        independent=columns,
        further=AmplitudeSums,
        avoid_collisions=False,
    )
    true = ExcitationTask(iiwa(), family, independent=columns)
    table = []
    for what, task, limit, settings in (
        ("amplitude sums of eq. (10)", sums, 92.0, SearchSettings(starts=12, kicks=0)),
        ("true limits, offsets, no collision", true, 60.0, SearchSettings(starts=6, kicks=1)),
    ):
        result, seconds = _timed(task, settings)
        table.append(Row.at_most(f"iiwa, {what}: condition number (paper 156.3)", result.best.value, limit))
        table.append(Row.at_most(f"iiwa, {what}: time", seconds, 30.0, "s"))
    return table


def _jaco2() -> list[Row]:
    """Golluccio et al. 2020: condition number about 50, smallest singular value 34, 43 base columns, 100 Hz."""
    robot = load_robot("jaco2")
    task = ExcitationTask(robot, fourier_family(_JACO2_S, _JACO2_HARMONICS), drives=())
    result, seconds = _timed(task, SearchSettings(starts=2, kicks=0))
    base = structural_base_parameters(robot, drives=())
    motion = result.best.motion.resampled(robot, _JACO2_HZ)
    regressor = regressor_rows(robot, measured_columns(robot, ()), motion.q, motion.v, motion.a)
    stacked = regressor.reshape(-1, regressor.shape[2])[:, base.independent]
    values = np.linalg.svd(stacked, compute_uv=False)
    # Repetitions add the squares of singular values.
    smallest, whole = float(values[-1]), _JACO2_PERIODS * _JACO2_S
    needed = _JACO2_S * (34.0 / smallest) ** 2
    what = f"jaco2, {whole:g} s: smallest singular value ({smallest:.1f} in {_JACO2_S:g} s; 34 takes {needed:.0f} s)"
    return [
        Row.at_most(f"jaco2, {len(values)} columns: condition number", float(values[0] / values[-1]), 50.0),
        Row.at_least(what, smallest * np.sqrt(_JACO2_PERIODS), 34.0),
        Row.at_most("jaco2: time", seconds, 30.0, "s"),
    ]


def _ur10() -> list[Row]:
    """FIGAROH's example: twice seven waypoints of 2 s, at rest in each, 80 % of the limits, inertial columns."""
    result, seconds = _timed(figaroh_task(), SearchSettings(starts=2, kicks=0, effort=0.42))
    return [
        Row.at_most("ur10, FIGAROH's task, collisions checked: condition number", result.best.value, 17.6),
        Row.at_most("ur10, FIGAROH's task: time (FIGAROH 64 s)", seconds, 6.4, "s"),
    ]


def figaroh_task() -> ExcitationTask:
    """Its settings: soft limit 0.1 of each range on either side, 12 segments in two stacks, no friction."""
    robot = load_robot("ur10")
    own = robot.limits
    soft = 0.1 * (own.position_upper - own.position_lower)
    limits = replace(
        own,
        position_lower=own.position_lower + soft,
        position_upper=own.position_upper - soft,
        velocity=0.8 * own.velocity,
        torque=0.8 * own.torque,
    )
    return ExcitationTask(robot, waypoint_family(2.0, 12), limits=limits, drives=())


# Keeps the root's derivative finite where an amplitude vanishes, as a share of the velocity limit.
_ROUNDING = 1e-4


@dataclass(frozen=True, eq=False)
class AmplitudeSums:
    """Sums of amplitudes of eq. (10) of Xu et al. 2020, in shares of the limits, two rows a joint, in place of peaks.

    Attributes:
        layout: of a Fourier family about a given start; positions are counted from it to the nearer end.
    """

    layout: Layout

    @cached_property
    def _unit(self) -> FourierCurve:
        n = self.layout.family.n_coefficients
        curve = self.layout.family.curve(np.zeros(n), np.eye(n))
        assert isinstance(curve, FourierCurve)
        assert not len(self.layout.reach)
        return curve

    @cached_property
    def _weights(self) -> tuple[Array, Array]:
        number = np.arange(1, self._unit.a.shape[1] + 1)
        return 1.0 / (number * self._unit.omega), np.ones(len(number))

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        limits, start = self.layout.limits, self.layout.start
        return np.minimum(limits.position_upper - start, start - limits.position_lower), limits.velocity

    def shares(self, x: Array) -> Array:
        """Largest share of its limits that each joint uses, ``(n_joints,)``."""
        table = self.layout.parts(x)[1]
        size = np.hypot(table @ self._unit.a, table @ self._unit.b)
        ways = zip(self._weights, self._limits, strict=True)
        return np.max([(size * weight).sum(axis=1) / limit for weight, limit in ways], axis=0)

    def rows(self, x: Array) -> tuple[Array, Array]:
        """What is left of each limit, ``(2·n_joints,)``, and its gradient ``(2·n_joints, size)``."""
        table, speed = self.layout.parts(x)[1], self._limits[1]
        a, b = table @ self._unit.a, table @ self._unit.b
        size, n = np.sqrt(a**2 + b**2 + (_ROUNDING * speed[:, None]) ** 2), len(speed)
        left, by_table = np.empty(2 * n), np.zeros((2 * n, *table.shape))
        for k, (weight, limit) in enumerate(zip(self._weights, self._limits, strict=True)):
            left[k * n : (k + 1) * n] = 1.0 - (size * weight).sum(axis=1) / limit
            slope = (a / size * weight) @ self._unit.a.T + (b / size * weight) @ self._unit.b.T
            by_table[k * n + np.arange(n), np.arange(n)] = -slope / limit[:, None]
        return left, self.layout.gathered(np.zeros((2 * n, n)), by_table)
