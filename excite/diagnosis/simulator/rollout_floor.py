"""What roll-outs of the same simulator differ by: replicas whose start and whose torques are as noisy as the log's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.simulator.rollout_drives import LoggedTorque
from excite.diagnosis.simulator.rollout_windows import Plan
from excite.logs.signals.butterworth import lowpass, noise_bandwidth
from excite.logs.signals.spectrum import welch_spectrum

# Noise of filtered positions is seen between these shares of the filter's cut-off, above the motion.
_BETWEEN = (0.5, 0.75)
_SEGMENT_S = 1.28


def position_noise(samples: ArmSamples) -> Array:
    """Standard deviation of the white noise of the positions, ``(n_joints,)`` [rad], as if flat below their band.

    Third differences keep the motion from leaking into the spectrum.
    """
    rate = samples.rate_hz
    low, high = (share * min(samples.bands.kinematics_hz, 0.5 * rate) for share in _BETWEEN)
    length = min(round(_SEGMENT_S * rate), *(len(t.time) // 2 for t in samples.trials))
    found = []
    for trial in samples.trials:
        frequency, power = welch_spectrum(
            np.diff(trial.q[:, list(samples.index)], 3, axis=0), rate, length, median=True
        )
        band = (frequency > low) & (frequency < high)
        differenced = (2.0 * np.sin(np.pi * frequency[band] / rate)) ** 6
        found.append(np.median(power[band] / differenced[:, None], axis=0))
    return np.asarray(np.sqrt(0.5 * rate * np.median(found, axis=0)))


def replicated(samples: ArmSamples, plan: Plan, rng: np.random.Generator) -> tuple[ArmSamples, Plan]:
    """The record and its roll-outs' drives with as much noise again as they have.

    Args:
        samples: the record.
        plan: drives; those that are not the log's torques stay as they are.
        rng: source of the noise.

    Returns:
        Record and plan of the replicas.
    """
    sigma, index = position_noise(samples), list(samples.index)
    rate, band = samples.rate_hz, samples.bands.kinematics_hz
    if plan.noise is not None:
        sigma = plan.noise / np.sqrt(noise_bandwidth(rate, band))
    trials, drives = [], dict(plan.drives)
    for trial in samples.trials:
        drawn = sigma * rng.standard_normal((len(trial.time), len(index)))
        q = trial.q.copy()
        q[:, index] += drawn if plan.noise is None else lowpass(drawn, rate, band)
        trials.append(replace(trial, q=q))
        drive = plan.drives[trial.name]
        if plan.torques is not None and isinstance(drive, LoggedTorque):
            noise = plan.torques.noise(trial, drawn, samples.rate_hz, rng)
            drives[trial.name] = replace(drive, tau=drive.tau + noise)
    return replace(samples, trials=tuple(trials)), replace(plan, drives=drives)
