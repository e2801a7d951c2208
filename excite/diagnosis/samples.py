"""Trials of a fixed-base arm on a uniform grid, and the filter that both sides of every equation go through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi

from excite.errors import LogError
from excite.identification.kinematics import trial_rate
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.logs.signals.differentiate import central_differences
from excite.logs.signals.resample import is_uniform, resample_noisy, resample_smooth, uniform_grid
from excite.robot.robot import Array, Robot


@dataclass(frozen=True)
class Bands:
    """Frequencies of the comparison [Hz].

    Attributes:
        rows_hz: cut-off of the filter on both sides of the equations.
        kinematics_hz: cut-off before differentiation; wider, so that friction sees reversals sharply.
        rate_hz: rate of the rows after decimation.
    """

    rows_hz: float = 10.0
    kinematics_hz: float = 30.0
    rate_hz: float = 50.0


@dataclass(frozen=True, eq=False)
class ArmTrial:
    """One trial at its full rate.

    Attributes:
        name: stem of its file.
        identification: whether it is an identification trial.
        repeats: name of the trial whose command it repeats.
        time: ``(n,)`` [s] from the trial's start.
        session_s: ``(n,)`` [s] since the session's start.
        q: ``(n, n_joints)`` in the model's order; v, a alike [rad, rad/s, rad/s²].
        v: velocities.
        a: accelerations.
        tau: ``(n, n_joints)`` unfiltered torque, the log's joints in the model's order [N·m].
        rows: indices of the rows that are kept.
    """

    name: str
    identification: bool
    repeats: str | None
    time: Array
    session_s: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    rows: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ArmSamples:
    """All trials of an arm.

    Attributes:
        robot: the robot in the log.
        joints: names of the joints with torque, in the order of the columns of ``tau``.
        index: indices of these joints into ``v``.
        trials: the trials.
        rate_hz: full rate.
        bands: frequencies.
    """

    robot: Robot
    joints: tuple[str, ...]
    index: tuple[int, ...]
    trials: tuple[ArmTrial, ...]
    rate_hz: float
    bands: Bands

    def filtered(self, signals: Sequence[Array]) -> list[Array]:
        """Signals at full rate, one ``(n, …)`` a trial, through the filter, at the kept rows."""
        lengths = [len(trial.time) for trial in self.trials]
        # All trials go through side by side; a shorter one is held at its end, as the filter would do.
        stacked = np.empty((max(lengths), len(lengths), *signals[0].shape[1:]))
        for k, values in enumerate(signals):
            stacked[: len(values), k], stacked[len(values) :, k] = values, values[-1]
        smooth = np.moveaxis(both_ways(stacked, self.rate_hz, self.bands.rows_hz), 1, 0)
        return [values[trial.rows] for trial, values in zip(self.trials, smooth, strict=True)]

    def rows(self, signals: Sequence[Array]) -> Array:
        """The same, all trials below each other, ``(n_rows, …)``."""
        return np.concatenate(self.filtered(signals))

    @property
    def identification(self) -> NDArray[np.bool_]:
        """Which rows belong to identification trials, ``(n_rows,)``."""
        return np.concatenate([np.full(len(t.rows), t.identification) for t in self.trials])

    @property
    def trial_of_row(self) -> NDArray[np.int64]:
        """Index of each row's trial, ``(n_rows,)``."""
        return np.concatenate([np.full(len(t.rows), k) for k, t in enumerate(self.trials)])

    def stacked(self, name: str) -> Array:
        """A channel of all trials at full rate below each other."""
        return np.concatenate([getattr(trial, name) for trial in self.trials])

    def split(self, values: Array) -> list[Array]:
        """Full-rate values of all trials, back into trials."""
        return np.split(values, np.cumsum([len(t.time) for t in self.trials])[:-1])


@lru_cache(maxsize=16)
def _design(rate_hz: float, cutoff_hz: float) -> tuple[Array, Array]:
    sections = butter(4, cutoff_hz, fs=rate_hz, output="sos")
    return sections, sosfilt_zi(sections)


def both_ways(values: Array, rate_hz: float, cutoff_hz: float) -> Array:
    """:func:`~excite.logs.signals.butterworth.lowpass` of fourth order, designed once; ends held, not mirrored.

    Hundreds of columns go through it, and rows near the ends are left out.
    """
    if cutoff_hz >= 0.5 * rate_hz:
        return values
    sections, start = _design(rate_hz, cutoff_hz)
    flat = np.ascontiguousarray(values.reshape(len(values), -1).T)
    for _ in range(2):
        state = start[:, None, :] * flat[None, :, :1]
        flat = sosfilt(sections, flat, axis=1, zi=state)[0][:, ::-1]
    return flat.T.reshape(values.shape)


def arm_samples(robot: Robot, log: Log, trials: Sequence[Trial], bands: Bands | None = None) -> ArmSamples:
    """Resample, filter and differentiate the trials of an arm.

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
    if log.header.no_torque:
        raise LogError(
            "names joints without torque",
            source=log.folder,
            field="no_torque",
            remedy="a diagnosis needs the torque of every joint in the log",
        )
    order = [log.header.joints.index(name) for name in robot.joint_names if name in log.header.joints]
    joints = tuple(log.header.joints[i] for i in order)
    index = tuple(robot.joint_index(name) for name in joints)
    rate = float(np.median([trial_rate(log.header, trial) for trial in trials]))
    starts = [trial.start_s for trial in trials]
    known = all(start is not None for start in starts)
    made, clock = [], 0.0
    for trial in trials:
        start = float(trial.start_s) if known and trial.start_s is not None else clock
        made.append(_arm_trial(robot, trial, order, index, rate, bands, start))
        clock += float(made[-1].time[-1])
    return ArmSamples(robot, joints, index, tuple(made), rate, bands)


def _arm_trial(
    robot: Robot,
    trial: Trial,
    order: list[int],
    index: tuple[int, ...],
    rate: float,
    bands: Bands,
    start: float,
) -> ArmTrial:
    if trial.tau is None:
        raise LogError("has no torques", source=trial.name, field="tau", remedy="log tau.* for a diagnosis")
    uniform = is_uniform(trial.time, rate)
    grid = trial.time if uniform else uniform_grid(trial.time, rate)
    q_log = trial.q if uniform else resample_smooth(trial.time, trial.q, grid)
    tau = trial.tau if uniform else resample_noisy(trial.time, trial.tau, grid)
    d = central_differences(lowpass(q_log, rate, bands.kinematics_hz), rate)
    n = len(grid)
    q, v, a = np.tile(robot.rest, (n, 1)), np.zeros((n, robot.model.nv)), np.zeros((n, robot.model.nv))
    columns = list(index)
    q[:, columns], v[:, columns], a[:, columns] = d.value[:, order], d.first[:, order], d.second[:, order]
    edge = max(3, settling_samples(rate, bands.rows_hz))
    step = max(1, round(rate / bands.rate_hz))
    return ArmTrial(
        name=trial.name,
        identification=trial.role == "identification",
        repeats=trial.repeats,
        time=grid - grid[0],
        session_s=start + grid - grid[0],
        q=q,
        v=v,
        a=a,
        tau=tau[:, order],
        rows=np.arange(edge, n - edge, step),
    )
