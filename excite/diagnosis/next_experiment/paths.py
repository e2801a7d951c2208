"""Motions on postures that a record has been through: other speeds along its paths, where shapes are not known."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.samples import ArmSamples
from excite.logs.signals.butterworth import lowpass
from excite.logs.signals.differentiate import central_differences
from excite.motion.motion import Motion, MotionMetadata

GENERATOR = "retraced"
_LONGEST_S = 30.0
_SPEEDS = (0.25, 0.6, 1.2)
_CHIRP_HZ = ((0.3, 3.0), (0.3, 8.0))
_SMOOTH_HZ = 8.0
# Beyond what the record has shown: speed, and acceleration, which a chirp needs more of, where a limit is known.
_FASTER, _HARDER = 1.25, 3.0
# Acceleration that a model has which states none [rad/s²].
_NO_LIMIT = 1000.0
# Share of a limit, or of what the record has shown but for its noisiest samples.
_WITHIN, _SHOWN = 0.95, 0.999


def retraced(samples: ArmSamples, others: int) -> list[Motion]:
    """Motions along the record's own paths, in joint space.

    Each runs a trial's path slower, faster, or to and fro about one of its points in a chirp, its amplitude shrinking
    as frequency grows. No posture is new, so that nothing can be hit that the record has not hit; speeds stay
    within 1.25 times the record's and the model's limits, accelerations within three times the record's where the
    model limits them, else within the record's.

    Args:
        samples: the samples.
        others: number of trials whose paths are used.

    Returns:
        The motions, several a trial.
    """
    made = []
    trials = [t for t in samples.trials if t.identification and t.repeats is None][:others]
    for trial in trials:
        for speed in _SPEEDS:
            made.append(_motion(samples, trial, _steady(trial, speed, samples.rate_hz), f"speed_{speed:g}"))
        for band in _CHIRP_HZ:
            made.append(_motion(samples, trial, _chirp(samples, trial, band), f"chirp_{band[1]:g}_hz"))
    return made


def _steady(trial: ArmTrial, speed: float, rate_hz: float) -> Array:
    """Time on the path at a constant speed, eased in and out over half a second [s]."""
    length = min(float(trial.time[-1]) / speed, _LONGEST_S)
    t = np.arange(round(length * rate_hz)) / rate_hz
    ease = np.minimum(np.minimum(t, t[-1] - t) / 0.5, 1.0)
    rate = speed * ease**2 * (3.0 - 2.0 * ease)
    return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) / rate_hz])


def _chirp(samples: ArmSamples, trial: ArmTrial, band: tuple[float, float]) -> Array:
    """To and fro about the path's fastest point, the frequency growing exponentially [s]."""
    n = round(min(_LONGEST_S, 20.0) * samples.rate_hz)
    t = np.arange(n) / samples.rate_hz
    growth = np.log(band[1] / band[0]) / t[-1]
    frequency = band[0] * np.exp(growth * t)
    phase = 2.0 * np.pi * (frequency - band[0]) / growth
    speed = (trial.v[:, list(samples.index)] ** 2 / _reach(samples, "v") ** 2).sum(axis=1)
    inner = slice(round(1.0 * samples.rate_hz), -round(1.0 * samples.rate_hz))
    middle = float(trial.time[inner][int(np.argmax(speed[inner]))])
    room = 0.9 * min(middle, float(trial.time[-1]) - middle, 1.0)
    ease = np.minimum(np.minimum(t, t[-1] - t) / 1.0, 1.0)
    # Path speed of at most the record's, and path acceleration as the chirp's own limit leaves it.
    amplitude = np.minimum(room, 1.0 / (2.0 * np.pi * frequency))
    return middle + amplitude * ease**2 * (3.0 - 2.0 * ease) * np.sin(phase)


def accelerations(samples: ArmSamples, harder: float) -> Array:
    """Largest accelerations that a new motion may have ``(n_joints,)`` [rad/s²].

    ``harder`` times the record's, within the model's limits; where the model states none, the record's own.
    """
    shown = np.quantile(np.abs(samples.stacked("a")[:, list(samples.index)]), _SHOWN, axis=0)
    limit = samples.robot.limits.acceleration[list(samples.index)]
    return _WITHIN * np.where(limit < _NO_LIMIT, np.minimum(harder * shown, limit), shown)


def _reach(samples: ArmSamples, name: str) -> Array:
    return np.maximum(np.abs(samples.stacked(name)[:, list(samples.index)]).max(axis=0), 1e-6)


def _motion(samples: ArmSamples, trial: ArmTrial, along: Array, name: str) -> Motion:
    """The path at these times, slowed down as a whole until it is within the limits."""
    robot, index, rate = samples.robot, list(samples.index), samples.rate_hz
    path = lowpass(trial.q, rate, min(_SMOOTH_HZ, 0.2 * rate))
    most_v = np.minimum(_FASTER * _reach(samples, "v"), robot.limits.velocity[index])
    most_a = accelerations(samples, _HARDER)
    slower = 1.0
    for _ in range(8):
        n = round(len(along) * slower)
        s = np.interp(np.linspace(0.0, len(along) - 1.0, n), np.arange(len(along)), along)
        q = np.column_stack([np.interp(s, trial.time, column) for column in path.T])
        d = central_differences(lowpass(q, rate, min(1.5 * _SMOOTH_HZ, 0.25 * rate)), rate)
        excess = max(
            float((np.abs(d.first[:, index]).max(axis=0) / most_v).max()),
            float(np.sqrt((np.abs(d.second[:, index]).max(axis=0) / most_a).max())),
        )
        if excess <= 1.0:
            break
        slower *= 1.02 * excess
    return Motion(
        name=f"{trial.name}_{name}",
        robot=robot.name,
        joint_names=robot.joint_names,
        time=np.arange(len(q)) / rate,
        q=d.value,
        v=d.first,
        a=d.second,
        metadata=MotionMetadata(generator=GENERATOR, targets=samples.joints, robot_hash=robot.hash),
    )
