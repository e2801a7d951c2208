"""What the noise of measured positions makes of predicted torques: it grows with the inertia that a posture has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.friction_sign import of_velocity
from excite.diagnosis.equations.known_motion import noise_density
from excite.diagnosis.equations.own_columns import ARMATURE, COULOMB, VISCOUS, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.logs.log import Trial
from excite.logs.signals.butterworth import lowpass
from excite.logs.signals.differentiate import Derivatives, central_differences
from excite.regressor.kernels import inverse_dynamics
from excite.rows.kinematics import positions_on_grid, trial_grid


def position_noise(samples: ArmSamples, columns: Sequence[int], trials: Sequence[Trial]) -> Array:
    """Standard deviation of the white noise of each position, ``(n_joints,)`` [rad or m].

    Args:
        samples: the samples of the trials.
        columns: of the trials' positions, by joint of the samples.
        trials: the trials as logged, repaired.
    """
    rate = samples.rate_hz
    positions = [positions_on_grid(t.time, t.q[:, list(columns)], trial_grid(t, rate)) for t in trials]
    return np.asarray(np.sqrt(0.5 * rate * noise_density(positions, rate, samples.bands.kinematics_hz)))


def kinematic_noise(baseline: Baseline, sigma: Array, rng: np.random.Generator) -> Array:
    """One draw of what noise of the positions adds to the residuals, ``(n_joints, n_rows)`` [N·m].

    White noise goes the way of the positions: filtered, differentiated, through the inertia of each posture,
    the rotors and the viscous and dry friction, and through the filter of the rows.

    Args:
        baseline: the fitted baseline.
        sigma: ``(n_joints,)`` standard deviation of the positions' noise [rad].
        rng: source of the draw.
    """
    samples, index = baseline.samples, list(baseline.samples.index)
    terms = own_terms(baseline.modelled)
    parts = []
    for trial in samples.trials:
        d = _drawn(samples, trial, sigma, rng)
        model = samples.robot.model
        moved = inverse_dynamics(model, trial.q, trial.v, trial.a + d.second, baseline.phi)
        change = (moved - inverse_dynamics(model, trial.q, trial.v, trial.a, baseline.phi))[:, index]
        for j, i in enumerate(index):
            own = dict(zip(terms, baseline.fit.own[j], strict=False))
            v, rate = trial.v[:, i], d.first[:, i]
            change[:, j] += own.get(ARMATURE, 0.0) * d.second[:, i]
            change[:, j] += own.get(VISCOUS, 0.0) * rate
            if not (sign := baseline.signs[j]).bent:
                change[:, j] += own.get(COULOMB, 0.0) * (of_velocity(v + rate, sign) - of_velocity(v, sign))
        parts.append(change)
    return samples.rows(parts, range(len(index))).T


def noisy_motion(samples: ArmSamples, sigma: Array, rng: np.random.Generator) -> ArmSamples:
    """The samples with as much noise again in their positions, and what the filter and differences make of it.

    Args:
        samples: the samples.
        sigma: ``(n_joints,)`` standard deviation of the positions' noise [rad].
        rng: source of the noise.
    """
    trials = []
    for trial in samples.trials:
        d = _drawn(samples, trial, sigma, rng)
        trials.append(replace(trial, q=trial.q + d.value, v=trial.v + d.first, a=trial.a + d.second))
    return replace(samples, trials=tuple(trials))


def _drawn(samples: ArmSamples, trial: ArmTrial, sigma: Array, rng: np.random.Generator) -> Derivatives:
    """White noise of a trial's positions on its way through the filter and the differences."""
    e, index = np.zeros_like(trial.v), list(samples.index)
    e[:, index] = sigma * rng.standard_normal((len(e), len(index)))
    return central_differences(lowpass(e, samples.rate_hz, samples.bands.kinematics_hz), samples.rate_hz)
