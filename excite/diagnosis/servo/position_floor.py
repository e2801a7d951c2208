"""What no roll-out of a log of commands can go below: noise and steps of encoders, as far as a filter lets them by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.kinematic_noise import position_noise
from excite.diagnosis.equations.repeats import on_the_clock_of_the_first
from excite.diagnosis.equations.samples import ArmSamples
from excite.logs.log import Trial
from excite.logs.signals.butterworth import lowpass, noise_bandwidth

# Places of an encoder's marks that the mean is taken over.
_PLACES = 8


def position_floor(samples: ArmSamples, logged: Mapping[str, Trial], joints: Sequence[str]) -> Array:
    """Noise of the filtered positions, ``(n_joints,)`` [rad or m]: the largest of three that it cannot be less than.

    - Noise that is seen above the motion's band is white: its density there times the filter's bandwidth.
    - An encoder of step ``s`` is off by ``s²/12``. While a joint passes many marks within the filter's time that is
      white and the filter takes most of it away; while it creeps or rests nothing does. So the marks are laid over the
      record's own motion, at several places, and what each reading is off by is filtered.
    - Trials that run one command again differ by what does not repeat, halved.

    Args:
        samples: the record, filtered.
        logged: its trials as they were logged, by name.
        joints: of the log, in its order.
    """
    trials = [logged[t.name] for t in samples.trials]
    columns = [list(joints).index(joint) for joint in samples.joints]
    passed = noise_bandwidth(samples.rate_hz, samples.bands.kinematics_hz)
    white = position_noise(samples, columns, trials) * np.sqrt(passed)
    steps = np.array([[t.cleaning.quantised.get(f"q.{j}", 0.0) for j in samples.joints] for t in trials])
    return np.asarray(np.max([white, _rounding(samples, steps), _unrepeated(samples)], axis=0))


def _rounding(samples: ArmSamples, steps: Array) -> Array:
    """RMS over all trials of what encoders of these steps, ``(n_trials, n_joints)``, are off by after the filter."""
    squares, count = np.zeros(len(samples.joints)), 0
    for trial, step in zip(samples.trials, steps, strict=True):
        squares += len(trial.time) * _filtered_rounding(samples, trial, step)
        count += len(trial.time)
    return np.asarray(np.sqrt(squares / count))


def _filtered_rounding(samples: ArmSamples, trial: ArmTrial, step: Array) -> Array:
    coarse = np.flatnonzero(step > 0.0)
    found = np.zeros(len(step))
    if len(coarse):
        q = trial.q[:, [samples.index[j] for j in coarse]] / step[coarse]
        for place in (np.arange(_PLACES) + 0.5) / _PLACES:
            off = lowpass(np.round(q + place) - q - place, samples.rate_hz, samples.bands.kinematics_hz)
            found[coarse] += (off**2).mean(axis=0) / _PLACES
    return found * step**2


def _unrepeated(samples: ArmSamples) -> Array:
    """RMS of half the difference of repeated trials' positions, times √2; 0 without repeats."""
    positions = [t.q[t.rows][:, list(samples.index)].T for t in samples.trials]
    both = [on_the_clock_of_the_first(repeat, samples.trials, positions) for repeat in samples.repeats]
    if not both:
        return np.zeros(len(samples.joints))
    return np.asarray(np.sqrt(np.concatenate([0.5 * (b - a) ** 2 for a, b in both], axis=1).mean(axis=1)))
