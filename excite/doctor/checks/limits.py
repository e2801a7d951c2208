"""Positions, speeds and torques that the robot's limits do not allow."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.doctor.check import Check, Outcome
from excite.doctor.checks.velocities import velocity_ratios
from excite.doctor.misreadings import LEAST_GAIN
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import torque_samples
from excite.finding import Finding, list_names
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.robot.robot import Robot
from excite.robot.sliding import is_prismatic

_DEGREE = 180.0 / np.pi
# Positions may pass a limit by this share of the range (bent limits, calibration) before anything is said.
_BEYOND = 0.1
_TORQUE_BEYOND = 2.0
# Degrees exceed limits manifold; joints that count turns do so by whole ones.
_MANIFOLD = 3.0
# So near to the slope of the positions are velocities in the same unit.
_SAME = 1.15
_TURN = 2.0 * np.pi


class Degrees(Check):
    """Joints far beyond their limits that are inside them if the numbers are degrees."""

    kinds = ("degrees",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        reach = _Reach.of(robot, log)
        columns = [robot.joint_index(name) for name in log.header.joints]
        turning = np.array([not is_prismatic(robot.model, robot.n_base_v + k) for k in columns])
        inside = (reach.low / _DEGREE >= reach.lower) & (reach.high / _DEGREE <= reach.upper)
        furthest = np.maximum(np.abs(reach.low), np.abs(reach.high))
        manifold = furthest > _MANIFOLD * np.maximum(np.abs(reach.lower), np.abs(reach.upper))
        speed = np.max([_speed(trial) for trial in log.trials], axis=0)
        degrees = (
            turning
            & inside
            & reach.outside
            & (manifold | (speed > _MANIFOLD * robot.limits.velocity[columns]))
        )
        # Most joints in degrees: all are that turn, also those that hardly moved. Else those alone that nothing else
        # explains.
        most = bool(inside[turning].all()) and 2 * degrees.sum() > turning.sum()
        which = turning if most else degrees & manifold & ~reach.counted
        turning_over = speed <= _MANIFOLD * robot.limits.velocity[columns]
        if not which.any() or (turning_over[which].all() and _in_radians_by_others(robot, log, which)):
            return Outcome(log)
        names = tuple(np.array(log.header.joints)[which])
        text = (
            f"positions of {list_names(names)} reach {furthest[which].max():.4g}, far beyond their limits in radians and "
            "inside them in degrees: they look like degrees"
        )
        finding = Finding(
            "degrees",
            text,
            {"largest": float(furthest[which].max())},
            names,
            severity="spoils",
            repaired=True,
            remedy="they were converted; write radians",
        )
        return Outcome(replace(log, trials=tuple(_in_radians(t, which) for t in log.trials)), (finding,))


def _in_radians_by_others(robot: Robot, log: Log, which: NDArray[np.bool_]) -> bool:
    """Whether torques, or velocities where there are none, say of joints beyond their limits that these turn over."""
    measured = not log.header.free_base and log.header.torque not in {None, "none"}
    samples = torque_samples(robot, log) if measured else None
    if samples is not None:
        reading = Reading.as_stated(log)
        turned = replace(reading, unit=np.where(which, 1.0 / _DEGREE, reading.unit))
        return float((samples.judged(reading) - samples.judged(turned)).sum()) < LEAST_GAIN
    compared = velocity_ratios(log)
    return compared is not None and bool(
        (np.abs(np.log(np.maximum(compared[0][which], 1e-9))) < np.log(_SAME)).all()
    )


class Limits(Check):
    """Positions and torques beyond what the model allows, once channels are what the log calls them."""

    kinds = ("beyond_limits", "torque_size")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        reach, found = _Reach.of(robot, log), _torque_size(robot, log)
        # What goes round and round is no joint with limits, whatever the model says.
        round_and_round = reach.high - reach.low > _TURN
        beyond = reach.outside & ~reach.counted & ~round_and_round
        if beyond.any():
            names = tuple(np.array(log.header.joints)[beyond])
            excess = float(np.maximum(reach.lower - reach.low, reach.high - reach.upper)[beyond].max())
            text = (
                f"positions of {list_names(names)} lie {excess:.3g} rad outside the limits: wrong order of joints, sign or "
                "zero, or limits that are not this robot's"
            )
            finding = Finding(
                "beyond_limits",
                text,
                {"excess_rad": excess},
                names,
                severity="limits",
                remedy="compare the columns with the model, joint by joint",
            )
            found.append(finding)
        return Outcome(log, tuple(found))


@dataclass(frozen=True, eq=False)
class _Reach:
    """How far joints go, and how far they may, each ``(n_joints,)``; limits with a margin."""

    low: Array
    high: Array
    lower: Array
    upper: Array

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Which joints whole turns bring into their limits: an encoder counts on."""
        turns = _TURN * np.round(0.5 * (self.low + self.high - self.lower - self.upper) / _TURN)
        return np.asarray((self.low - turns >= self.lower) & (self.high - turns <= self.upper))

    @classmethod
    def of(cls, robot: Robot, log: Log) -> _Reach:
        columns = [robot.joint_index(name) for name in log.header.joints]
        lower, upper = robot.limits.position_lower[columns], robot.limits.position_upper[columns]
        margin = _BEYOND * (upper - lower)
        low = np.min([trial.q.min(axis=0) for trial in log.trials], axis=0)
        high = np.max([trial.q.max(axis=0) for trial in log.trials], axis=0)
        return cls(low, high, lower - margin, upper + margin)

    @property
    def outside(self) -> NDArray[np.bool_]:
        """Which joints leave their limits."""
        return (self.low < self.lower) | (self.high > self.upper)


def _in_radians(trial: Trial, which: NDArray[np.bool_]) -> Trial:
    """Some joints' positions in radians; commands and velocities too, where they go with them."""
    q = np.where(which, trial.q / _DEGREE, trial.q)

    def like(values: Array | None, reference: Array) -> Array | None:
        """Divided where that brings a column nearer in size."""
        if values is None:
            return None
        sizes = [np.maximum(np.abs(x).max(axis=0), 1e-12) for x in (values, reference)]
        times = sizes[0] / sizes[1]
        return np.where(np.abs(np.log(times / _DEGREE)) < np.abs(np.log(times)), values / _DEGREE, values)

    return replace(
        trial, q=q, q_cmd=like(trial.q_cmd, q), v=like(trial.v, np.gradient(q, trial.time, axis=0))
    )


def _torque_size(robot: Robot, log: Log) -> list[Finding]:
    limit = robot.limits.torque[[robot.joint_index(name) for name in log.header.joints]]
    parts = [np.abs(trial.tau).max(axis=0) for trial in log.trials if trial.tau is not None]
    if not parts:
        return []
    share = np.max(parts, axis=0) / limit
    over = np.isfinite(share) & (share > _TORQUE_BEYOND)
    if not over.any():
        return []
    names = tuple(np.array(log.header.joints)[over])
    text = (
        f"torques of {list_names(names)} reach {share[over].max():.3g} times their limit: "
        "another unit (N·mm, currents), or the gear counted twice"
    )
    return [
        Finding(
            "torque_size",
            text,
            {"share_of_limit": float(share[over].max())},
            names,
            severity="limits",
            remedy="check unit and side of the gear, or the model's limits",
        )
    ]


def _speed(trial: Trial) -> Array:
    """Fastest motion of each joint that noise and single steps do not make, ``(n_joints,)``."""
    rate = 1.0 / float(np.median(np.diff(trial.time)))
    cutoff = min(10.0, 0.2 * rate)
    if trial.n_samples <= settling_samples(rate, cutoff):
        return np.zeros(trial.q.shape[1])
    return np.abs(np.gradient(lowpass(trial.q, rate, cutoff), axis=0) * rate).max(axis=0)
