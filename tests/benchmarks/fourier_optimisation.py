"""Optimised excitation of three arms against published figures.

A loaded machine spoils wall time: a search of several starts is run in one process, and half of its processor time
counts as what two cores take.
"""

from __future__ import annotations

import time

import numpy as np

from excite.excitation.optimisation.limits import JointLimits
from excite.excitation.optimisation.motions import FourierFamily
from excite.excitation.optimisation.search import SearchResult, SearchSettings, optimise_excitation
from excite.excitation.optimisation.task import ExcitationTask
from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.columns import measured_columns, regressor_rows
from excite.robot.loading import load_robot
from tests.benchmarks.table import Row
from tests.benchmarks.waypoints import WaypointFamily
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
    family = FourierFamily(PERIOD_S, HARMONICS)
    sums = ExcitationTask(
        iiwa(),
        family,
        start=np.zeros(N_JOINTS),
        independent=columns,
        amplitude_sums=True,
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
    task = ExcitationTask(robot, FourierFamily(_JACO2_S, _JACO2_HARMONICS), drives=())
    result, seconds = _timed(task, SearchSettings(starts=2, kicks=0, effort=0.6))
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
    limits = JointLimits(
        own.position_lower + soft,
        own.position_upper - soft,
        0.8 * own.velocity,
        own.acceleration,
        0.8 * own.torque,
    )
    return ExcitationTask(robot, WaypointFamily(2.0, 12), limits=limits, drives=())
