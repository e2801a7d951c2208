"""The linear problem that identification solves: rows of a regressor and what was measured."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from excite.arrays import Array, Flags, Indices
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import noise_bandwidth
from excite.logs.signals.resample import resample_noisy
from excite.progress import step
from excite.regressor.columns import PARAMETERS
from excite.robot.robot import Robot
from excite.rows.base_rows import BaseRows
from excite.rows.joint_rows import JointRows, drive_terms
from excite.rows.kinematics import decimation_factor, trial_rate
from excite.rows.saturation import flags_at
from excite.rows.settings import Filters, ProblemSettings
from excite.threads import one_blas_thread

NEVER_NEGATIVE = ("viscous", "coulomb", "armature")
"""Terms of drives that take power out, and rotors: below zero is no robot."""


def row_blocks(n_rows: int) -> Iterator[slice]:
    """Parts of many rows, so that what is computed of them needs no second copy of all."""
    return (slice(start, start + 4096) for start in range(0, n_rows, 4096))


@dataclass(frozen=True, eq=False)
class IdentificationProblem:
    """``Y θ ≈ y``, row by row, with ``θ`` the inertial parameters and then the drives' parameters.

    The first ``n_inertial`` columns are ten per segment in pinocchio's order
    ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz`` about the joint frame; the rest are named
    ``viscous.JOINT`` [N·m·s/rad], ``coulomb.JOINT`` [N·m] and so on, for the terms of
    :data:`~excite.rows.drive_terms.DRIVE_TERMS` that the settings ask for.

    Attributes:
        robot: the robot whose model is identified.
        Y: ``(n_rows, n_params)``.
        y: ``(n_rows,)`` [N·m or N].
        weights: ``(n_rows,)``, one over the standard deviation expected of each row's noise; weighted least
            squares multiplies rows by it.
        channel: ``(n_rows,)`` index into ``channel_names``.
        channel_names: joints' names (joint torque rows) or ``fx fy fz tx ty tz`` (base-link rows, in the
            frame of the base, moment about its origin).
        channel_units: unit of each channel, ``N·m`` or ``N``.
        time: ``(n_rows,)`` time of each row within its trial [s].
        trial: ``(n_rows,)`` index into ``trial_names``.
        trial_names: names of the trials.
        parameter_names: ``(n_params,)`` names: ``LINK.m`` … ``LINK.Izz``, then the drives'.
        prior: ``(n_params,)`` nominal values; drives' parameters that the robot does not state are 0.
        n_inertial: number of inertial columns, ``10·n_segments``.
        unmeasured: segments (indices into ``robot.segments``) that the sensors do not see; their columns
            are zero and their parameters stay nominal.
        noise_bandwidth: equivalent number of independent noise samples per row, at most 1: rows of a
            filtered signal that lie closer than the filter resolves are not independent.
        filters: the filters that it was built with.
        sampling_hz: rate at which these filters ran, before decimation [Hz]; None where nothing is known.
        drive_spread: ``(n_params - n_inertial,)`` standard deviation expected of each drive parameter about
            its prior, NaN where anything goes; None for NaN everywhere.
        freedom: ``(n_rows,)`` how much of an independent number each row holds: less than one where contact forces were
            taken out, which ties the rows of an instant; None for one everywhere.
    """

    robot: Robot
    Y: Array
    y: Array
    weights: Array
    channel: Indices
    channel_names: tuple[str, ...]
    channel_units: tuple[str, ...]
    time: Array
    trial: Indices
    trial_names: tuple[str, ...]
    parameter_names: tuple[str, ...]
    prior: Array
    n_inertial: int
    unmeasured: tuple[int, ...] = ()
    noise_bandwidth: float = 1.0
    filters: Filters | None = None
    drive_spread: Array | None = None
    sampling_hz: float | None = None
    freedom: Array | None = None

    def numbers(self, rows: Indices | slice = slice(None)) -> Array:
        """Independent numbers that some rows hold in each channel, ``(n_channels,)``."""
        weights = None if self.freedom is None else self.freedom[rows]
        return np.bincount(self.channel[rows], weights, minlength=len(self.channel_names)).astype(float)

    @property
    def is_moving(self) -> Flags:
        """Which parameters are free, ``(n_params,)``: all but those of segments that the sensors do not see."""
        free = np.ones(self.n_params, dtype=bool)
        for segment in self.unmeasured:
            free[self.robot.parameter_columns(segment)] = False
        return free

    @property
    def non_negative(self) -> list[int]:
        """Columns of masses, of drives' friction and of rotors; an offset may have either sign."""
        drives = range(self.n_inertial, self.n_params)
        positive = [j for j in drives if self.parameter_names[j].partition(".")[0] in NEVER_NEGATIVE]
        return [*range(0, self.n_inertial, 10), *positive]

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return len(self.y)

    @property
    def n_params(self) -> int:
        """Number of columns."""
        return int(self.Y.shape[1])

    def with_rows(self, kept: Flags) -> IdentificationProblem:
        """The problem with the rows of a mask ``(n_rows,)`` alone."""
        own = ("Y", "y", "weights", "channel", "time", "trial")
        parts = {name: getattr(self, name)[kept] for name in own}
        return replace(self, **parts, freedom=None if self.freedom is None else self.freedom[kept])

    def with_drives(self, names: Collection[str]) -> IdentificationProblem:
        """The problem without the columns of all drive parameters but those named."""
        n = self.n_inertial
        kept = np.array([k for k, name in enumerate(self.parameter_names) if k < n or name in names])
        if len(kept) == self.n_params:
            return self
        return replace(
            self,
            Y=self.Y[:, kept],
            parameter_names=tuple(self.parameter_names[k] for k in kept),
            prior=self.prior[kept],
            drive_spread=None if self.drive_spread is None else self.drive_spread[kept[n:] - n],
        )

    def residual(self, parameters: Array) -> Array:
        """Measured minus predicted, ``(n_rows,)``, for ``parameters`` of shape ``(n_params,)``."""
        return self.y - self.Y @ parameters

    def rows_of(self, channel: str) -> Flags:
        """Mask of the rows of a channel, ``(n_rows,)``."""
        return np.asarray(self.channel == self.channel_names.index(channel))


_FEWEST_ROWS = 10


@one_blas_thread
@step("filter and stack rows")
def build_problem(
    robot: Robot, log: Log, settings: ProblemSettings | None = None, *, role: str | None = "identification"
) -> IdentificationProblem:
    """Turn trials into the linear problem that identification solves.

    A floating base gives the six rows a sample of its base link's equation, ``Y1 φ = Σ J1ᵀ f``; a fixed or a
    suspended one (whose harness holds the base link) the joint torques. What the log says of gravity and
    sensors overrides the robot.

    Args:
        settings: filters, decimation, friction terms; defaults if None.
        role: which trials: ``identification``, ``validation``, or None for all.

    Returns:
        The problem.

    Raises:
        LogError: robot and log do not fit, no trial has that role, channels are missing, or no rows are left.
    """
    settings = settings or ProblemSettings()
    filters = settings.filters(floating=log.header.measures_contacts, lowpass_hz=log.header.lowpass_hz)
    settings.check_rate(log.header.rate_hz)
    trials = log.trials if role is None else log.role(role)
    if not trials:
        raise LogError(f"has no trial with role {role!r}", source=log.folder, field="trials")
    robot = robot_in_log(robot, log.header, log.folder)
    builder: BaseRows | JointRows
    if log.header.measures_contacts:
        builder = BaseRows(robot, log.header, settings, filters)
        unmeasured = builder.unmeasured
    else:
        builder = JointRows(robot, log.header, settings, filters, drive_terms(log.header, settings))
        unmeasured = ()
    trials = tuple(advance_torques(trial, settings.torque_delay_s) for trial in trials)
    parts = [builder.rows(trial) for trial in trials]
    # Sample by sample, unusable rows left out.
    places = [np.nonzero(part.use) for part in parts]
    values = [part.values[place] for part, place in zip(parts, places, strict=True)]
    freedom = [
        part.freedom[place] for part, place in zip(parts, places, strict=True) if part.freedom is not None
    ]
    counts = [len(one) for one in values]
    n_rows = sum(counts)
    if n_rows < _FEWEST_ROWS:
        raise LogError(
            f"leaves {n_rows} usable rows", source=log.folder, remedy="record longer, or raise the cut-off"
        )
    names = [f"{segment.link}.{name}" for segment in robot.segments for name in PARAMETERS]
    rate = trial_rate(log.header, trials[0])
    passed = noise_bandwidth(rate, filters.cutoff_hz, filters.order)
    noise = builder.noise * np.sqrt(passed)
    channel = np.concatenate([place[1] for place in places])
    return IdentificationProblem(
        robot=robot,
        Y=np.concatenate([one[:, :-1] for one in values]),
        y=np.concatenate([one[:, -1] for one in values]),
        weights=1.0 / noise[channel],
        channel=channel,
        channel_names=builder.channel_names,
        channel_units=builder.channel_units,
        time=np.concatenate([part.time[place[0]] for part, place in zip(parts, places, strict=True)]),
        trial=np.repeat(np.arange(len(parts)), counts),
        trial_names=tuple(trial.name for trial in trials),
        parameter_names=(*names, *builder.drive_names),
        prior=np.concatenate([robot.nominal_parameters, builder.drive_prior]),
        n_inertial=len(names),
        unmeasured=unmeasured,
        noise_bandwidth=min(1.0, passed * decimation_factor(rate, filters)),
        filters=filters,
        drive_spread=builder.drive_spread,
        sampling_hz=rate,
        freedom=np.concatenate(freedom) if len(freedom) == len(parts) else None,
    )


def advance_torques(trial: Trial, delay_s: float) -> Trial:
    """The trial with torques, currents and wrenches ``delay_s`` [s] earlier; ends hold their last value."""
    if delay_s == 0.0:
        return trial
    wanted = np.clip(trial.time + delay_s, trial.time[0], trial.time[-1])

    def shift_rows(values: Array) -> Array:
        return resample_noisy(trial.time, values, wanted)

    changed: dict[str, Any] = {
        name: shift_rows(getattr(trial, name))
        for name in ("tau", "current")
        if getattr(trial, name) is not None
    }
    wrenches = {name: shift_rows(reading) for name, reading in trial.wrenches.items()}
    beyond = None if trial.beyond is None else flags_at(trial.time, trial.beyond, wanted)
    return replace(trial, **changed, wrenches=wrenches, beyond=beyond)
