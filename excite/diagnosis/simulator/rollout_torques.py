"""The torques that drive roll-outs: the log's, less the noise that the servo's commands can tell.

Without feedback the noise of a torque channel is integrated twice, and soon hides what two simulators differ in. But
a servo makes its torque from what it is asked for and what it sees: wherever that law, fitted to the log, leaves
nothing but noise, the law's torque is the better reading. The two are joined by Wiener's filter (Wiener 1949).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.baseline_fit import model_phi
from excite.diagnosis.equations.samples import ArmSamples
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.logs.signals.differentiate import central_differences
from excite.logs.signals.spectrum import welch_spectrum
from excite.regressor.kernels import joint_torque_regressor

# Noise of a torque channel is seen between these shares of the rate; nothing else of a motion is there.
_NOISE, _END = (0.25, 0.45), (0.075, 0.125)
_MANY = 4
_EDGE_S, _LEAST_S = 0.3, 2.0
_SEGMENT_S = 2.0
_SLOW = 0.02
_RANK = 1e-8
_OWN = 7


@dataclass(frozen=True, eq=False)
class DrivingTorques:
    """Torques of all trials, and how their noise came through.

    Attributes:
        torque: by trial, ``(n, n_joints)`` [N·m].
        sigma: ``(n_joints,)`` standard deviation of the logged torques' white noise [N·m].
        frequency: ``(n_f,)`` [Hz].
        passed: ``(n_f, n_joints)`` share of the logged torque's noise that is left at each frequency; the law's own
            stands for the rest.
        gains: ``(2, n_joints)`` of the law: position [N·m/rad] and velocity [N·m·s/rad].
        cutoff_hz: of the positions that the law saw [Hz].
    """

    torque: dict[str, Array]
    sigma: Array
    frequency: Array
    passed: Array
    gains: Array
    cutoff_hz: float

    @property
    def smoothed(self) -> bool:
        """Whether the commands tell anything about the torques."""
        return bool((self.passed < 1.0).any())

    def noise(self, trial: ArmTrial, positions: Array, rate_hz: float, rng: np.random.Generator) -> Array:
        """A draw of what noise is in a trial's torques, ``(n, n_joints)`` [N·m].

        Args:
            trial: the trial.
            positions: ``(n, n_joints)`` a draw of its positions' noise, which goes through the servo [rad].
            rate_hz: its rate [Hz].
            rng: source of the torque channels' noise.
        """
        drawn = self.sigma * rng.standard_normal((len(trial.time), len(self.sigma)))
        seen = central_differences(lowpass(positions, rate_hz, self.cutoff_hz), rate_hz)
        made = -self.gains[0] * seen.value - self.gains[1] * seen.first
        return made + _through(drawn - made, rate_hz, self.frequency, self.passed)


def driving_torques(samples: ArmSamples) -> DrivingTorques:
    """The logged torques, less the noise that commands can tell; as logged where a trial has no commands or is short.

    Every joint's law: errors of position and velocity and the error's integral, a constant, the nominal model's
    rigid-body columns at the command (a feedforward of whatever masses), viscous, dry and rotor terms. What it
    leaves passes the filter ``max(0, 1 − N/P)`` of its own spectrum P and the noise N far above the motion.
    """
    rate, trials, cut = samples.rate_hz, samples.trials, _cut(samples)
    commands = [t.q_cmd for t in trials if t.q_cmd is not None]
    long = min(len(t.time) for t in trials) > _LEAST_S * rate
    law = _law(samples, commands) if long and len(commands) == len(trials) else None
    inner = [t.measured for t in trials]
    if law is not None:
        residuals = (t.measured - law.torque(samples, t, c) for t, c in zip(trials, commands, strict=True))
        inner = [r[_inside(samples)] for r in residuals]
    length = min(round(_SEGMENT_S * rate), *(len(r) // 2 for r in inner))
    spectra = [welch_spectrum(r - _trend(r), rate, length, centred=False) for r in inner]
    frequency, power = spectra[0][0], np.mean([p for _, p in spectra], axis=0)
    power[0] *= 2.0
    noise = _noise(frequency, power, rate)
    sigma = np.sqrt(0.5 * rate * noise)
    if law is None:
        logged = {t.name: t.measured for t in trials}
        return DrivingTorques(logged, sigma, frequency, np.ones_like(power), np.zeros((2, len(sigma))), cut)
    wide = np.concatenate([power[:1], power, power[-1:]])
    passed = 1.0 - noise / (0.25 * wide[:-2] + 0.5 * wide[1:-1] + 0.25 * wide[2:])
    passed = np.clip(passed, 0.0, 1.0)
    made = {t.name: t.measured.copy() for t in trials}
    for trial, rest in zip(trials, inner, strict=True):
        made[trial.name][_inside(samples)] += _through(rest, rate, frequency, passed) - rest
    return DrivingTorques(made, sigma, frequency, passed, law.weights[:, :2].T, cut)


@dataclass(frozen=True, eq=False)
class _Law:
    """A servo's law fitted to a log.

    Attributes:
        weights: ``(n_joints, n_columns)`` of its columns.
    """

    weights: Array

    def torque(self, samples: ArmSamples, trial: ArmTrial, command: Array) -> Array:
        """Torque that the law gives in a trial, ``(n, n_joints)`` [N·m]."""
        return np.einsum("njc,jc->nj", _columns(samples, trial, command), self.weights)


def _law(samples: ArmSamples, commands: list[Array]) -> _Law:
    """Least squares over all trials, in the directions that the motions show.

    The noise of positions would make the gains small, but for the low-pass. A feedforward of the nominal model has
    one column in place of all of them; it is taken unless they leave less than so many would of noise alone.
    """
    step = max(1, round(samples.rate_hz / samples.bands.rate_hz))
    sums: list[tuple[Array, Array, Array]] = []
    rows = 0
    for trial, command in zip(samples.trials, commands, strict=True):
        x = _columns(samples, trial, command)[_inside(samples)][::step]
        x = np.ascontiguousarray(x.transpose(1, 2, 0))
        tau = lowpass(trial.measured, samples.rate_hz, _cut(samples))[_inside(samples)][::step]
        sums.append((x @ x.transpose(0, 2, 1), np.einsum("jcn,nj->jc", x, tau), (tau**2).sum(axis=0)))
        rows += len(tau)
    gram, right, power = (np.sum(part, axis=0) for part in zip(*sums, strict=True))
    independent = max(2.0 * _cut(samples) * step / samples.rate_hz * rows, 1.0)
    nominal = np.zeros((gram.shape[1], _OWN + 1))
    nominal[:_OWN, :_OWN], nominal[_OWN:, _OWN] = np.eye(_OWN), model_phi(samples)
    weights = []
    for g, r, p in zip(gram, right, power, strict=True):
        made = [basis @ _solved(basis.T @ g @ basis, basis.T @ r) for basis in (nominal, np.eye(len(r)))]
        left = [float(p - 2.0 * w @ r + w @ g @ w) for w in made]
        worth = left[1] * (1.0 + 2.0 * (len(r) - _OWN - 1) / independent) < left[0]
        weights.append(made[int(worth)])
    return _Law(np.array(weights))


def _solved(gram: Array, right: Array) -> Array:
    """Solution of normal equations in the directions that the rows show."""
    size = np.sqrt(np.maximum(np.diagonal(gram), 1e-30))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > _RANK * values[-1]
    basis = vectors[:, kept]
    return np.asarray(basis @ (basis.T @ (right / size) / values[kept]) / size)


def _columns(samples: ArmSamples, trial: ArmTrial, command: Array) -> Array:
    """Columns of the servo's law, the position's and the velocity's error first, ``(n, n_joints, n_columns)``."""
    index, rate = list(samples.index), samples.rate_hz
    asked, seen = (central_differences(lowpass(x, rate, _cut(samples)), rate) for x in (command, trial.q))
    error, drift = (asked.value - seen.value)[:, index], (asked.first - seen.first)[:, index]
    v, a = asked.first[:, index], asked.second[:, index]
    own = (error, drift, np.cumsum(error, axis=0) / rate, np.ones_like(v), v, np.tanh(v / _SLOW), a)
    rigid = joint_torque_regressor(samples.robot.model, asked.value, asked.first, asked.second)
    return np.concatenate([np.stack(own, axis=2), rigid[:, index]], axis=2)


def _noise(frequency: Array, power: Array, rate_hz: float) -> Array:
    """Density of the channels' noise within the motion's band, ``(n_joints,)`` [(N·m)²/Hz].

    It is seen far above the motion, where it may be less: a filter that all channels went through shows in every
    joint, friction that reverses does not show in all of them.
    """
    above, end = ((frequency > low * rate_hz) & (frequency < high * rate_hz) for low, high in (_NOISE, _END))
    noise = np.median(power[above], axis=0)
    common = float((np.median(power[end], axis=0) / noise).min()) if len(noise) >= _MANY else 1.0
    return np.asarray(noise * max(common, 1.0))


def _inside(samples: ArmSamples) -> slice:
    """Samples of a trial that the filters' ends do not reach."""
    edge = max(settling_samples(samples.rate_hz, _cut(samples)), round(_EDGE_S * samples.rate_hz))
    return slice(edge, -edge)


def _cut(samples: ArmSamples) -> float:
    """Cut-off of what the law is fitted and evaluated with [Hz]: of what is faster, the log knows more."""
    return min(samples.bands.rows_hz, 0.2 * samples.rate_hz)


def _through(values: Array, rate_hz: float, frequency: Array, passed: Array) -> Array:
    """Values ``(n, n_joints)`` through a filter without phase; ends are continued by point reflection."""
    trend = _trend(values)
    pad, rest = len(values) // 2, values - trend
    before, after = 2.0 * rest[:1] - rest[pad:0:-1], 2.0 * rest[-1:] - rest[-2 : -pad - 2 : -1]
    long = np.concatenate([before, rest, after])
    at = np.fft.rfftfreq(len(long), 1.0 / rate_hz)
    factor = np.stack([np.interp(at, frequency, p) for p in passed.T], axis=1)
    smooth = np.fft.irfft(np.fft.rfft(long, axis=0) * factor, len(long), axis=0)
    return np.asarray(trend + smooth[pad : pad + len(values)])


def _trend(values: Array) -> Array:
    """Straight line through a trial's values ``(n, n_joints)``: a whole trial tells it well."""
    clock = np.linspace(-1.0, 1.0, len(values))[:, None]
    return np.asarray(values.mean(axis=0) + clock * (clock * values).mean(axis=0) / (clock**2).mean())
