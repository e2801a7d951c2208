"""What no model can go below: from repeated trials, and from the spectrum above the motion's band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial, Bands
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.friction_sign import of_velocity
from excite.diagnosis.equations.own_columns import ARMATURE, COULOMB, VISCOUS, own_terms
from excite.diagnosis.equations.repeats import align_repeat
from excite.diagnosis.equations.samples import ArmSamples
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import Derivatives, central_differences, lowpass, noise_bandwidth
from excite.logs.signals.spectrum import welch_spectrum
from excite.rows.kinematics import positions_on_grid, trial_grid, trial_rate

_ABOVE = (1.5, 3.0)
# Samples of a stretch of measured torques from which it tells a spectrum as a trial does, and without which none tells.
_LONG, _SHORTEST = 128, 16


def spectral_floor(samples: ArmSamples) -> Array:
    """Noise of each torque channel in the rows' band, ``(n_joints,)`` [N·m], from the spectrum right above it.

    The median over Welch's segments of the density between 1.5 and 3 times the band's end, so that single
    jumps do not count, times the band.
    """
    return _band_floor(samples, [_ABOVE])


def white_floor(samples: ArmSamples) -> Array:
    """The same from where the spectrum is lowest, ``(n_joints,)`` [N·m]: what no fit can go below.

    Friction that changes suddenly reaches far beyond the band; noise does not become less for it further up.
    """
    low, width = _ABOVE[0], _ABOVE[1] - _ABOVE[0]
    count = int((0.45 * samples.rate_hz / samples.bands.rows_hz - low) / width)
    return _band_floor(samples, [(low + width * k, low + width * (k + 1)) for k in range(max(count, 1))])


def _band_floor(samples: ArmSamples, bands: Sequence[tuple[float, float]]) -> Array:
    """From the lowest of the densities in several bands, given in multiples of the rows' band."""
    rate = samples.rate_hz
    width = noise_bandwidth(rate, samples.bands.rows_hz)
    high = [min(most * samples.bands.rows_hz, 0.45 * rate) for _, most in bands]
    low = [min(least * samples.bands.rows_hz, 0.7 * top) for (least, _), top in zip(bands, high, strict=True)]
    # Each band holds two frequencies of the spectrum of half a stretch.
    needed = 4.0 * rate / min(top - bottom for bottom, top in zip(low, high, strict=True))
    floors = []
    for j in range(len(samples.joints)):
        densities = []
        for trial, v in zip(samples.trials, samples.by_trial(samples.motor_signal("v")), strict=True):
            still = np.abs(v[:, j]) < samples.standstill[j]
            for tau in _moving_stretches(trial, j, still, max(_SHORTEST, int(needed) + 1)):
                f, p = welch_spectrum(np.diff(tau), rate, min(256, len(tau) // 2), median=True)
                found = []
                for bottom, top in zip(low, high, strict=True):
                    band = (f > bottom) & (f < top)
                    found.append(float(np.median(p[band] / (2.0 * np.sin(np.pi * f[band] / rate)) ** 2)))
                densities.append(found)
        density = float(np.median(densities, axis=0).min())
        floors.append(np.sqrt(density * 0.5 * rate * width))
    return np.maximum(np.array(floors), 1e-9)


def _moving_stretches(trial: ArmTrial, joint: int, still: NDArray[np.bool_], least: int) -> list[Array]:
    """Torques of a joint in the stretches in which it moves and they were measured, those that are long enough.

    A motor at rest is quiet: its controller sees no noise of velocities, and rows at rest are hardly judged. Where no
    stretch of motion tells a spectrum, those in which torques were measured do, or the trial.

    Args:
        joint: its column.
        still: ``(n,)`` where the joint may as well stand.
        least: samples that tell a spectrum.
    """
    tau = trial.tau[:, joint]
    told = np.ones(len(tau), dtype=np.bool_) if trial.beyond is None else ~trial.beyond[:, joint]
    moving = told.copy()
    for first, last in _find_runs(still):
        # What is shorter is no rest but a turn of the motion, where friction jumps.
        if last - first >= least:
            moving[first:last] = False
    for use in (moving, told):
        runs = [tau[first:last] for first, last in _find_runs(use)]
        longest = max((len(run) for run in runs), default=0)
        if longest >= least:
            return [run for run in runs if len(run) >= min(least if use is moving else longest, _LONG)]
    return [tau]


def _find_runs(use: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Stretches of samples that are used, first and one past the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], use, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def repeat_floor(samples: ArmSamples, residual: Array) -> Array | None:
    """RMS of half the difference of residuals in repeated trials, times √2: ``(n_joints,)`` or None.

    Differences of residuals, not of torques: the same command does not give quite the same motion.
    """
    values = [residual[:, samples.trial_of_row == k] for k in range(len(samples.trials))]
    both = [align_repeat(repeat, samples.trials, values) for repeat in samples.repeat_pairs]
    squares = np.concatenate([0.5 * (again - first) ** 2 for first, again in both], axis=1) if both else None
    return None if squares is None or not squares.size else np.sqrt(squares.mean(axis=1))


def without_drift(samples: ArmSamples, residual: Array, columns: Sequence[Array]) -> Array:
    """Residuals ``(n_joints, n_rows)`` of repeated trials, each less its own multiple of some columns.

    A joint that warms up between two runs of a command differs by another friction or constant: that is no noise.

    Args:
        residual: ``(n_joints, n_rows)`` [N·m].
        columns: by joint, ``(n_rows, n)`` of its friction and constant.
    """
    left = residual.copy()
    for k in {k for repeat in samples.repeat_pairs for k in (repeat.first, repeat.again)}:
        rows = samples.trial_of_row == k
        for j, block in enumerate(columns):
            left[j, rows] -= block[rows] @ np.linalg.lstsq(block[rows], residual[j, rows], rcond=None)[0]
    return left


def unrepeated_noise_power(samples: ArmSamples, noise: Array, rows: NDArray[np.bool_] | None = None) -> Array:
    """Power of a known noise less what it has in the repeated trials, ``(n_joints,)`` [(N·m)²].

    Where noise grows with the posture's inertia, repeats of one trial do not show that of all.

    Args:
        noise: ``(n_joints, n_rows)`` a draw of it [N·m].
        rows: which rows to tell it of; all by default.
    """
    pairs = [(repeat.first, repeat.again) for repeat in samples.repeat_pairs]
    if not pairs:
        return np.zeros(len(noise))
    power, shown = noise**2, np.isin(samples.trial_of_row, np.unique(pairs))
    asked = power if rows is None else power[:, rows]
    return np.asarray(asked.mean(axis=1) - power[:, shown].mean(axis=1))


def other_postures(repeat: Array, more: Array | float) -> Array:
    """The floor of repeated trials carried over to others, ``(n_joints,)`` [N·m]; no less than half of it.

    Args:
        repeat: ``(n_joints,)`` floor of the repeated trials [N·m].
        more: ``(n_joints,)`` power of noise in the others less that in the repeated ones [(N·m)²].
    """
    return np.sqrt(np.maximum(repeat**2 + more, 0.25 * repeat**2))


# What the noise of measured positions makes of predicted torques: it grows with the inertia that a posture
# has.


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
    samples, terms = baseline.samples, own_terms(baseline.modelled)
    drawn = _draw_position_noise(samples, sigma, rng)
    more = np.concatenate([d.second for d in drawn])
    faster = samples.tree_motion._replace(a=samples.tree_motion.a + more)
    change = samples.rigid_torques(baseline.phi, faster) - samples.rigid_torques(baseline.phi)
    first, second = samples.motor_values(np.concatenate([d.first for d in drawn])), samples.motor_values(more)
    for j, v in enumerate(samples.motor_signal("v").T):
        own = dict(zip(terms, baseline.fit.own_coefs[j], strict=False))
        change[:, j] += own.get(ARMATURE, 0.0) * second[:, j]
        change[:, j] += own.get(VISCOUS, 0.0) * first[:, j]
        if not (sign := baseline.signs[j]).has_bristles:
            change[:, j] += own.get(COULOMB, 0.0) * (
                of_velocity(v + first[:, j], sign) - of_velocity(v, sign)
            )
    return samples.to_rows(change, range(len(samples.joints))).T


def noisy_motion(samples: ArmSamples, sigma: Array, rng: np.random.Generator) -> ArmSamples:
    """The samples with as much noise again in their positions, and what the filter and differences make of it.

    Args:
        sigma: ``(n_joints,)`` standard deviation of the positions' noise [rad].
        rng: source of the noise.
    """
    trials = [
        replace(trial, q=trial.q + d.value, v=trial.v + d.first, a=trial.a + d.second)
        for trial, d in zip(samples.trials, _draw_position_noise(samples, sigma, rng), strict=True)
    ]
    return replace(samples, trials=tuple(trials))


def _draw_position_noise(samples: ArmSamples, sigma: Array, rng: np.random.Generator) -> list[Derivatives]:
    """White noise of each trial's positions on its way through the filter and the differences, and through the tree."""
    made, rate, index = [], samples.rate_hz, list(samples.index)
    for k, trial in enumerate(samples.trials):
        e = np.zeros_like(trial.v)
        e[:, index] = sigma * rng.standard_normal((len(e), len(index)))
        d = central_differences(lowpass(e, rate, samples.bands.kinematics_hz), rate)
        if samples.robot.mechanism is not None:
            maps = samples.motion_maps
            maps = maps if len(maps) == 1 else samples.by_trial(maps)[k]
            parts = (d.value, d.first, d.second)
            d = Derivatives(*((maps @ x[:, index, None])[:, :, 0] for x in parts))
        made.append(d)
    return made


# Up to which frequency positions tell a motion well enough: noise in accelerations bends what is fitted to
# them.

# White noise is seen between this multiple of the kinematics' band and this share of the rate; of slow records, whose
# band is wider than their spectrum, in the upper third below that.
_KNOWN_MOTION_ABOVE, _BELOW = 1.3, 0.45
_SEGMENT, _SEGMENT_S = 256, 4.0
# Nats that noise of a joint's acceleration may feign by itself. What other columns explain of a column is lost to its
# signal and not to its noise, so that in a fit of whole bodies the same noise feigns tens of times as much. Of 14 arms
# and recordings with encoders of 12 to 18 bits a turn (Z1, UR10, ARX5, Sawyer, Panda, xArm7) six had false soft gears
# or constants with 3 here, none with 0.3 or with 0.1; what was there kept its name with all of them. Without the rule a
# Fetch's lift had a constant of 111 N firmly, with 0.1 mm of noise on its position.
_FEIGNED = 0.3
# Factor between the bands that are tried, and the lowest [Hz]; settled ends may be no more than half of a trial.
_STEP, _LOWEST_HZ, _SETTLING = 1.25, 1.0, 8.0


def noise_density(positions: Sequence[Array], rate_hz: float, band_hz: float) -> Array:
    """Density of the white noise of positions, ``(n,)`` [rad²/Hz or m²/Hz]: as if it were flat below what is seen.

    The median over Welch's segments of the density above the band of the motion; third differences keep the motion
    from leaking into it.

    Args:
        positions: ``(n_samples, n)`` a trial, uniform.
        rate_hz: of the samples.
        band_hz: end of the kinematics' band.
    """
    high = _BELOW * rate_hz
    low = min(_KNOWN_MOTION_ABOVE * band_hz, 2.0 * high / 3.0)
    found = []
    for q in positions:
        f, p = welch_spectrum(np.diff(q, 3, axis=0), rate_hz, min(_SEGMENT, len(q) // 2), median=True)
        band = (f > low) & (f < high)
        found.append(np.median(p[band] / (2.0 * np.sin(np.pi * f[band] / rate_hz))[:, None] ** 6, axis=0))
    return np.asarray(np.median(found, axis=0))


def bands_by_noise(log: Log, trials: Sequence[Trial]) -> Bands:
    """Bands of the comparison: lower where the noise of positions would bend what is fitted.

    Noise in a regressor bends its coefficient towards zero by the noise's share of the regressor's power (Fuller,
    Measurement Error Models, 1987, section 1.1), and what the coefficient lacks another column takes over: of a slow
    lift's weight a part becomes a constant torque. With n effective rows a share λ feigns n λ/2 nats. The noise of an
    acceleration grows with the fifth power of the band, so a lower one ends that; a joint that nobody can tell moving
    at any of them has no say.

    Args:
        trials: repaired trials.
    """
    bands = Bands()
    rate = float(np.median([trial_rate(log.header, trial) for trial in trials]))
    positions = [positions_on_grid(t.time, t.q, trial_grid(t, rate)) for t in trials]
    noise = noise_density(positions, rate, bands.kinematics_hz)
    if not noise.any():
        return bands
    shortest = min(len(q) for q in positions)
    least = max(_LOWEST_HZ, _SETTLING * rate / shortest)
    tried = [bands.rows_hz]
    while tried[-1] / _STEP >= least:
        tried.append(tried[-1] / _STEP)
    f, seen = _acceleration_spectrum(positions, rate)
    false = (2.0 * np.pi * f[:, None]) ** 4 * noise
    seconds = sum(len(q) for q, t in zip(positions, trials, strict=True) if t.role == "identification") / rate
    feigned = np.empty((len(tried), len(noise)))
    for row, end in zip(feigned, tried, strict=True):
        inside = f <= end
        power = false[inside].sum(axis=0)
        motion = (seen - false)[inside].sum(axis=0)
        effective = seconds * rate * noise_bandwidth(rate, end)
        row[:] = 0.5 * effective * power / np.maximum(motion, 1e-9 * np.maximum(power, 1e-300))
        row[motion < power] = np.inf
    known = np.isfinite(feigned).any(axis=0)
    worst = feigned[:, known].max(axis=1, initial=0.0)
    good = np.flatnonzero(worst <= _FEIGNED)
    end = tried[int(good[0] if len(good) else np.argmin(worst))]
    return replace(bands, rows_hz=end, kinematics_hz=bands.kinematics_hz * end / bands.rows_hz)


def _acceleration_spectrum(positions: Sequence[Array], rate_hz: float) -> tuple[Array, Array]:
    """Frequencies ``(m,)`` [Hz] and density of accelerations ``(m, n)`` there, over all trials, noise included.

    The least of what positions and their differences show: slow motion leaks upwards in the ones, noise downwards in
    the others.
    """
    length = min(round(_SEGMENT_S * rate_hz), *(len(q) // 2 for q in positions))
    weight = np.array([len(q) for q in positions], dtype=float)
    f = np.arange(1.0, length // 2 + 1.0) * (rate_hz / length)
    bent = (2.0 * rate_hz * np.sin(np.pi * f[:, None] / rate_hz)) ** 2
    found = []
    for order in range(3):
        parts = [welch_spectrum(np.diff(q, order, axis=0), rate_hz, length)[1][1:] for q in positions]
        density = np.tensordot(weight / weight.sum(), np.array(parts), axes=1)
        found.append(density * (2.0 * np.pi * f[:, None]) ** 4 * rate_hz ** (2 * order) / bent**order)
    return np.asarray(f, dtype=np.float64), np.asarray(np.min(found, axis=0))
