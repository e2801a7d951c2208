"""A floating-base log prepared for diagnosis: decimated kinematics and sensor readings of all trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtr, chdtri

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot, robot_in_log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.columns import base_wrench
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.robot import Robot
from excite.rows.joint_rows import JointRows
from excite.rows.kinematics import forces_on_grid, in_velocities, trial_kinematics
from excite.rows.settings import Filters, ProblemSettings

# What a log without wrench sensors is read by: the torques of all joints.
TORQUE = "torque"
# Whole-body motion lives below 3 Hz; the filter only has to keep decimation clean.
CUTOFF_HZ = 8.0
ROW_RATE_HZ = 25.0
# Lost to the filters at either end, and what has to be left for the motion to show [s].
_EDGE_S, _LEAST_S = 0.4, 1.0


@dataclass(frozen=True, eq=False)
class FloatingRecord:
    """All trials of a log, one after the other, at a common low rate.

    Attributes:
        robot: the nominal robot with the log's sensors.
        tree: its kinematic tree.
        rate_hz: rate of the samples [Hz].
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)``.
        a: ``(n, nv)``.
        readings: by sensor, ``(n, 6)``: what it said [N, N·m], in its frame; without sensors the joints' torques,
            ``(n, n_joints)``, by ``TORQUE``.
        readings_rate: by sensor, time derivative of the same, ``(n, 6)`` per second.
        spans: samples of each trial.
        trials: names of the trials.
        validation: by trial, whether it is for validation.
        repeats: pairs of indices of trials that ran the same command.
        unmeasured: segments beyond the sensors.
        sensor_noise: ``(c, c)`` covariance of the rows' white noise, a sample of the full rate, learnt above the
            motion's band, from the trials that do not judge; of torques that of the joints.
        full_rate_hz: that rate [Hz].
        inertials_free: whether ``modelled`` asks for the rigid body's parameters to be identified.
        modelled: words of ``modelled``: effects that are not to be tried.
    """

    robot: Robot
    tree: KinematicTree
    rate_hz: float
    q: Array
    v: Array
    a: Array
    readings: dict[str, Array]
    readings_rate: dict[str, Array]
    spans: tuple[slice, ...]
    trials: tuple[str, ...]
    validation: tuple[bool, ...]
    repeats: tuple[tuple[int, int], ...]
    unmeasured: tuple[int, ...]
    sensor_noise: Array
    full_rate_hz: float
    inertials_free: bool
    modelled: tuple[str, ...] = ()

    @property
    def n_samples(self) -> int:
        """Number of samples of all trials."""
        return len(self.q)

    @property
    def time(self) -> Array:
        """``(n,)`` time within each trial [s]."""
        return np.concatenate([np.arange(s.stop - s.start) for s in self.spans]) / self.rate_hz

    def halve_rate(self) -> FloatingRecord:
        """Every other sample; still more than the band of the likelihood needs."""
        few = [np.arange(span.start, span.stop, 2) for span in self.spans]
        thin = self._select_samples(np.concatenate(few), [len(own) for own in few])
        return replace(thin, rate_hz=0.5 * self.rate_hz)

    def _select_samples(self, samples: NDArray[np.int64], lengths: Sequence[int]) -> FloatingRecord:
        """Some samples, so many of each trial."""
        return replace(
            self,
            q=self.q[samples],
            v=self.v[samples],
            a=self.a[samples],
            readings={name: values[samples] for name, values in self.readings.items()},
            readings_rate={name: values[samples] for name, values in self.readings_rate.items()},
            spans=_trial_spans(lengths),
        )

    def learning_trials(self) -> FloatingRecord:
        """The trials that are learnt from, of which the last that stands for itself checks each name.

        Names and sizes come from this record alone, so that nothing depends on the trials that judge. A trial that
        repeats another, or is repeated, tells the noise instead. Itself where there are no trials of both roles.
        """
        if all(self.validation) or not any(self.validation):
            return self
        kept = [i for i, judges in enumerate(self.validation) if not judges]
        samples = [np.arange(self.spans[i].start, self.spans[i].stop) for i in kept]
        repeats = tuple((kept.index(a), kept.index(b)) for a, b in self.repeats if {a, b} <= {*kept})
        alone = [i for i in range(len(kept)) if not any(i in pair for pair in repeats)]
        check = alone[-1] if len(alone) > 1 else None
        return replace(
            self._select_samples(np.concatenate(samples), [len(own) for own in samples]),
            trials=tuple(self.trials[i] for i in kept),
            validation=tuple(i == check for i in range(len(kept))),
            repeats=repeats,
        )

    def smooth_signal(self, values: Array, cutoff_hz: float) -> Array:
        """``(n, …)`` without what is above a frequency, trial by trial."""
        return np.concatenate([lowpass(values[span], self.rate_hz, cutoff_hz) for span in self.spans])

    def differentiate_signal(self, values: Array) -> Array:
        """``(n, …)`` derivative with respect to time, by central differences within each trial [1/s]."""
        return np.concatenate([np.gradient(values[span], 1.0 / self.rate_hz, axis=0) for span in self.spans])

    def validation_samples(self) -> NDArray[np.bool_]:
        """``(n,)`` which samples are of validation trials."""
        mask = np.zeros(self.n_samples, dtype=bool)
        for span, held_out in zip(self.spans, self.validation, strict=True):
            mask[span] = held_out
        return mask


def _trial_spans(lengths: Sequence[int]) -> tuple[slice, ...]:
    """Samples of trials that follow each other."""
    return tuple(slice(int(lo), int(hi)) for lo, hi in pairwise(np.cumsum([0, *lengths])))


def prepare_record(log: Log, robot: Robot | None = None) -> FloatingRecord:
    """Filter, differentiate and decimate every trial.

    Args:
        log: a floating-base log with contact wrenches and base pose.
        robot: the nominal robot; None reads the one that the log names.

    Raises:
        LogError: the log has a fixed base, or lacks base pose or wrenches.
    """
    header = log.header
    if not header.free_base:
        raise LogError("has no free base", source=log.folder, field="base")
    robot = nominal_robot(log) if robot is None else robot_in_log(robot, header, log.folder)
    settings = ProblemSettings()
    filters = Filters(CUTOFF_HZ, CUTOFF_HZ, 4, ROW_RATE_HZ)
    parts = [_prepare_trial(robot, log, trial, settings, filters) for trial in log.trials]
    names = [trial.name for trial in log.trials]
    heard = [i for i, t in enumerate(log.trials) if t.role != "validation"] or range(len(parts))
    return FloatingRecord(
        robot=robot,
        tree=read_tree(robot.model),
        rate_hz=parts[0].rate_hz,
        q=np.concatenate([part.q for part in parts]),
        v=np.concatenate([part.v for part in parts]),
        a=np.concatenate([part.a for part in parts]),
        readings={
            name: np.concatenate([part.readings[name] for part in parts]) for name in parts[0].readings
        },
        readings_rate={name: np.concatenate([part.rates[name] for part in parts]) for name in parts[0].rates},
        spans=_trial_spans([len(part.q) for part in parts]),
        trials=tuple(names),
        validation=tuple(trial.role == "validation" for trial in log.trials),
        repeats=tuple(
            (names.index(trial.repeats), i) for i, trial in enumerate(log.trials) if trial.repeats in names
        ),
        unmeasured=tuple(sorted({segment for s in robot.sensors for segment in s.excludes})),
        sensor_noise=robust_covariance(np.concatenate([parts[i].above_band for i in heard])),
        full_rate_hz=header.rate_hz,
        inertials_free="rigid_body" in header.modelled,
        modelled=tuple(header.modelled),
    )


@dataclass(frozen=True, eq=False)
class _TrialPart:
    rate_hz: float
    q: Array
    v: Array
    a: Array
    readings: dict[str, Array]
    rates: dict[str, Array]
    above_band: Array


def _prepare_trial(
    robot: Robot, log: Log, trial: Trial, settings: ProblemSettings, filters: Filters
) -> _TrialPart:
    missing = [s.name for s in robot.sensors if s.name not in trial.wrenches]
    if missing or (trial.base is None and not log.header.uses_imu):
        raise LogError(
            "is missing",
            source=trial.name,
            field=f"wrench.{missing[0]}" if missing else "base",
            remedy="log it",
        )
    k = trial_kinematics(robot, log.header, trial, settings, filters)
    raw = _sensor_readings(robot, log, trial, settings, filters)
    raw = {name: forces_on_grid(trial.time, values, k.time) for name, values in raw.items()}
    edge = round(_EDGE_S * k.rate_hz)
    if len(k.time) < 2 * edge + _LEAST_S * k.rate_hz:
        raise LogError(
            f"lasts {len(k.time) / k.rate_hz:.2g} s, of which filters take {2.0 * _EDGE_S:g}",
            source=trial.name,
            field="time",
            remedy=f"record trials of {2.0 * _EDGE_S + _LEAST_S:g} s and more, or leave it out",
        )
    step = max(1, round(k.rate_hz / ROW_RATE_HZ))
    keep = slice(edge, len(k.time) - edge, step)
    smooth = {name: lowpass(values, k.rate_hz, CUTOFF_HZ) for name, values in raw.items()}
    rates = {name: np.gradient(values, 1.0 / k.rate_hz, axis=0) for name, values in smooth.items()}
    noisy = base_wrench(robot, k.q, raw) if robot.sensors else raw[TORQUE]
    return _TrialPart(
        rate_hz=k.rate_hz / step,
        q=k.q[keep],
        v=k.v[keep],
        a=k.a[keep],
        readings={name: values[keep] for name, values in smooth.items()},
        rates={name: values[keep] for name, values in rates.items()},
        above_band=_above_band(noisy, k.rate_hz)[edge:-edge],
    )


def _sensor_readings(
    robot: Robot, log: Log, trial: Trial, settings: ProblemSettings, filters: Filters
) -> Mapping[str, Array]:
    """Contact wrenches by sensor; where there are no sensors, the torques of all joints."""
    if robot.sensors:
        return trial.wrenches
    rows = JointRows(robot, log.header, settings, filters, ())
    silent = [joint for joint in robot.driven_names if joint not in rows.channel_names]
    if silent:
        raise LogError(
            f"says nothing of joint {silent[0]!r}",
            source=trial.name,
            field="no_torque",
            remedy="forces at the feet are found from the torques of all joints: log them",
        )
    torques = in_velocities(robot, rows.channel_names, rows.torque(trial))
    return {TORQUE: torques[:, robot.n_base_v :]}


def _above_band(values: Array, rate_hz: float) -> Array:
    """What is left between 9 and 15 Hz, scaled so that white noise keeps its variance."""
    low, high = min(9.0, 0.2 * rate_hz), min(15.0, 0.35 * rate_hz)
    angle = np.tan(0.5 * np.pi * (np.arange(4096) + 0.5) / 4096)
    upper, lower = (1.0 / (1.0 + (angle / np.tan(np.pi * f / rate_hz)) ** 12) for f in (high, low))
    # Share of white noise's power in the difference of two zero-phase Butterworth filters.
    share = ((upper - lower) ** 2).mean()
    return (lowpass(values, rate_hz, high, 6) - lowpass(values, rate_hz, low, 6)) / np.sqrt(share)


def robust_covariance(values: Array, kept: float = 0.9, rounds: int = 5) -> Array:
    """Covariance of the bulk of ``values (n, k)``: the most distant tenth is left out, its absence made good.

    Impacts are short and large; noise is always there (a trimmed form of the minimum covariance determinant,
    Rousseeuw and Van Driessen 1999).
    """
    dimension = values.shape[1]
    limit = chdtri(dimension, 1.0 - kept)
    consistency = kept / chdtr(dimension + 2, limit)
    covariance = values.T @ values / len(values)
    for _ in range(rounds):
        distance = np.einsum("ni,ij,nj->n", values, np.linalg.inv(covariance), values)
        inside = values[distance <= np.quantile(distance, kept)]
        covariance = consistency * inside.T @ inside / len(inside)
    return covariance
