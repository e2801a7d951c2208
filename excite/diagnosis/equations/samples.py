"""Trials of a fixed-base arm on a uniform grid, and the filter that both sides of every equation go through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial, Bands
from excite.diagnosis.equations.repeats import Repeat, repeats_of
from excite.diagnosis.equations.standstill import rows_of_motion, standstill_speed
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import lowpass
from excite.logs.signals.coupling import coupling_matrix, joint_torques
from excite.logs.signals.differentiate import central_differences
from excite.logs.signals.sections import both_ways, butterworth_sections
from excite.robot.robot import Robot
from excite.rows.kinematics import (
    forces_on_grid,
    in_configurations,
    in_velocities,
    positions_on_grid,
    trial_grid,
    trial_rate,
)

_ORDER = 4


class _Layout(NamedTuple):
    """Where trials are in signals below each other.

    Attributes:
        ends: of each trial.
        rows: in their trials, of all trials.
        row_ends: where each trial's rows end in these.
    """

    ends: NDArray[np.int64]
    rows: NDArray[np.int64]
    row_ends: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ArmSamples:
    """All trials of an arm.

    Attributes:
        robot: the robot in the log.
        joints: names of the joints with torque, in the order of the columns of ``tau``.
        index: indices of these joints into ``v``.
        coupling: ``(n_joints, n_joints)`` from velocities of these joints to those of their motors, each seen
            through its own gear; the identity where every motor turns its own joint alone.
        standstill: ``(n_joints,)`` speed up to which a joint may as well stand [rad/s].
        trials: the trials.
        rate_hz: full rate.
        bands: frequencies.
        lead: time by which dry friction changes sign before the filtered velocity does [s]. A joint that sticks for
            a moment comes to rest steeply and leaves gently: the filter smears the stop into what follows.
    """

    robot: Robot
    joints: tuple[str, ...]
    index: tuple[int, ...]
    trials: tuple[ArmTrial, ...]
    rate_hz: float
    bands: Bands
    coupling: Array
    standstill: Array
    lead: float = 0.0

    @property
    def coupled(self) -> bool:
        """Whether a motor turns with more than its own joint."""
        return not np.array_equal(self.coupling, np.eye(len(self.joints)))

    def motors(self, joint: int) -> tuple[int, ...]:
        """Motors whose torques act on a joint, its own first."""
        others = np.flatnonzero(self.coupling[:, joint])
        return (joint, *(int(m) for m in others if m != joint))

    def of_motor(self, name: str, motor: int) -> Array:
        """Velocity or acceleration of a motor through its own gear, ``(n_samples,)``: ``name`` is ``v`` or ``a``."""
        values, row = self.stacked(name), self.coupling[motor]
        turning = np.flatnonzero(row)
        if len(turning) == 1 and row[turning[0]] == 1.0:
            return values[:, self.index[turning[0]]]
        return values[:, [self.index[k] for k in turning]] @ row[turning]

    def led(self, values: Array) -> Array:
        """What follows the sign of a velocity, ``(n_samples,)``, earlier by ``lead``."""
        if self.lead == 0.0:
            return values
        parts = zip(self.split(values), self.trials, strict=True)
        return np.concatenate([np.interp(t.time + self.lead, t.time, part) for part, t in parts])

    def rows(self, signals: Array | Sequence[Array]) -> Array:
        """Signals at full rate, all trials below each other or one a trial, through the filter, ``(n_rows, …)``.

        Ends are held, not mirrored: rows near them are left out.
        """
        values = signals if isinstance(signals, np.ndarray) else np.concatenate(signals)
        if self.bands.rows_hz >= 0.5 * self.rate_hz:
            parts = zip(self.split(values), self.trials, strict=True)
            return np.concatenate([part[trial.rows] for part, trial in parts])
        sections = butterworth_sections(_ORDER, self.rate_hz, self.bands.rows_hz)
        smooth = both_ways(values.reshape(len(values), -1), *self._layout, *sections)
        return smooth.reshape(len(smooth), *values.shape[1:])

    @cached_property
    def _layout(self) -> _Layout:
        """Where trials are in signals below each other."""
        ends, row_ends = np.cumsum(
            [[len(t.time) for t in self.trials], [len(t.rows) for t in self.trials]], 1
        )
        return _Layout(ends, np.concatenate([trial.rows for trial in self.trials]), row_ends)

    @cached_property
    def starts(self) -> NDArray[np.bool_]:
        """Which full-rate samples are the first of a trial, ``(n_samples,)``."""
        marked = np.zeros(self._layout.ends[-1], dtype=np.bool_)
        marked[np.concatenate([[0], self._layout.ends[:-1]])] = True
        return marked

    @cached_property
    def repeats(self) -> tuple[Repeat, ...]:
        """Trials that run one command again."""
        return repeats_of(self.trials, self.rate_hz)

    @cached_property
    def identification(self) -> NDArray[np.bool_]:
        """Which rows belong to identification trials, ``(n_rows,)``."""
        return np.concatenate([np.full(len(t.rows), t.identification) for t in self.trials])

    @cached_property
    def trial_of_row(self) -> NDArray[np.int64]:
        """Index of each row's trial, ``(n_rows,)``."""
        return np.concatenate([np.full(len(t.rows), k) for k, t in enumerate(self.trials)])

    def stacked(self, name: str) -> Array:
        """A channel of all trials at full rate below each other."""
        return np.concatenate([getattr(trial, name) for trial in self.trials])

    def of_joints(self, values: Array) -> Array:
        """Those of ``values (n, nv, …)`` that belong to the joints with torque, no copy where these are all."""
        return values if self.index == tuple(range(values.shape[1])) else values[:, list(self.index)]

    def split(self, values: Array) -> list[Array]:
        """Full-rate values of all trials, back into trials."""
        return np.split(values, self._layout.ends[:-1])


def arm_samples(robot: Robot, log: Log, trials: Sequence[Trial], bands: Bands | None = None) -> ArmSamples:
    """Resample, filter and differentiate the trials of an arm.

    Standstill before and after a trial's motion makes no rows: friction holds the joints there with any torque.

    Args:
        robot: the robot in the log.
        log: the log, for its header.
        trials: repaired trials.
        bands: frequencies.

    Returns:
        The samples.

    Raises:
        LogError: a trial has no torques or is too short for the filter.
    """
    bands = bands or Bands()
    header = log.header
    joints = tuple(name for name in robot.joint_names if name in header.torque_joints)
    places = _Places(
        header.joints,
        tuple(header.joints.index(name) for name in joints),
        coupling_matrix(joints, header.coupling),
    )
    rate = float(np.median([trial_rate(log.header, trial) for trial in trials]))
    starts = [trial.start_s for trial in trials]
    known = all(start is not None for start in starts)
    made, clock = [], 0.0
    for trial in trials:
        start = float(trial.start_s) if known and trial.start_s is not None else clock
        made.append(_arm_trial(robot, trial, places, rate, bands, start))
        clock += float(made[-1].time[-1])
    index = tuple(robot.joint_index(name) for name in joints)
    still = np.array(
        [standstill_speed([t.q[:, k] for t in trials], bands.kinematics_hz) for k in places.torques]
    )
    return ArmSamples(robot, joints, index, tuple(made), rate, bands, places.coupling, still)


@dataclass(frozen=True, eq=False)
class _Places:
    """Where a log's columns belong.

    Attributes:
        logged: joints of the columns of ``q``.
        torques: columns of ``tau`` of those with torque, in the robot's order; ``coupling``, of their motors.
    """

    logged: tuple[str, ...]
    torques: tuple[int, ...]
    coupling: Array


def _arm_trial(
    robot: Robot,
    trial: Trial,
    places: _Places,
    rate: float,
    bands: Bands,
    start: float,
) -> ArmTrial:
    if trial.tau is None:
        raise LogError("has no torques", source=trial.name, field="tau", remedy="log tau.* for a diagnosis")
    grid = trial_grid(trial, rate)
    motor = trial.tau[:, list(places.torques)]
    tau = joint_torques(forces_on_grid(trial.time, motor, grid), places.coupling)
    positions = positions_on_grid(trial.time, trial.q, grid)
    d = central_differences(lowpass(positions, rate, bands.kinematics_hz), rate)
    q = in_configurations(robot, places.logged, d.value)
    v, a = (in_velocities(robot, places.logged, values) for values in (d.first, d.second))
    commanded = None
    if trial.q_cmd is not None:
        q_cmd = positions_on_grid(trial.time, trial.q_cmd, grid)
        commanded = in_configurations(robot, places.logged, q_cmd)
    rows = rows_of_motion(v, rate, bands, trial.name)
    return ArmTrial(
        name=trial.name,
        identification=trial.role == "identification",
        repeats=trial.repeats,
        time=grid - grid[0],
        session_s=start + grid - grid[0],
        q=q,
        v=v,
        a=a,
        tau=tau,
        rows=rows,
        q_cmd=commanded,
    )
