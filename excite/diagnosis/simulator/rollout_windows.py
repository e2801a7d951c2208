"""Which pieces of a record are simulated, and what drives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.baseline_fit import model_phi
from excite.diagnosis.equations.samples import ArmSamples
from excite.logs.signals.butterworth import central_differences, lowpass, settling_samples
from excite.logs.signals.spectrum import welch_spectrum
from excite.regressor.kernels import joint_torque_regressor

# What a simulation starts from and what drives it: windows of a record, logged torques, position servos.


@dataclass(frozen=True, eq=False)
class Past:
    """The record before a window: what bristles, filters and soft gears remember.

    Attributes:
        time: ``(n,)`` of the trial [s], evenly spaced; the last one is the window's start.
        q: ``(n, n_joints)`` positions [rad].
        v: ``(n, n_joints)`` velocities [rad/s].
    """

    time: Array
    q: Array
    v: Array


@dataclass(frozen=True, eq=False)
class Window:
    """A piece of a record to be simulated.

    Attributes:
        q: ``(n_joints,)`` positions at its start [rad].
        v: velocities at its start [rad/s].
        load: torque that the links need at its start [N·m]; sets how far soft and loose gears are deflected of which
            that is not told.
        time: ``(n_steps,)`` of the steps [s] since the trial's start.
        session_s: time of its start within the session [s].
        growth: by joint, how far friction that drifts has come at its start; from the session's clock where it
            is not given.
        past: the record before it; without it the robot was at rest.
        deflected: by joint, how far a soft or loose gear is deflected at its start [rad] and how fast it moves
            [rad/s]; it rests under its load where that is not given.
    """

    q: Array
    v: Array
    load: Array
    time: Array
    session_s: float
    growth: Mapping[str, float] = field(default_factory=dict)
    past: Past | None = None
    deflected: Mapping[str, tuple[float, float]] = field(default_factory=dict)


class Drive(Protocol):
    """Where a simulation's torques come from."""

    def offers(self, times: Array) -> Array:
        """Torques of the motors in the zero position at rest ``(n, n_joints)`` [N·m], at times of the trial."""
        ...

    def answer(self, offer: Array, q: Array, v: Array) -> Array:
        """Torques of the motors at positions and velocities, from what is offered, all ``(…, n_joints)``."""
        ...


@dataclass(frozen=True, eq=False)
class LoggedTorque:
    """The record's own torques, no feedback.

    Attributes:
        time: ``(n,)`` [s].
        tau: ``(n, n_joints)`` [N·m].
    """

    time: Array
    tau: Array

    def offers(self, times: Array) -> Array:
        """The logged torques at those times."""
        return _interpolated(self.time, self.tau, times)

    def answer(self, offer: Array, q: Array, v: Array) -> Array:
        """What is offered: nothing is fed back."""
        return offer


@dataclass(frozen=True, eq=False)
class PositionServo:
    """``kp (q_cmd − q) + kd (v_cmd − v) + feedforward``, commands interpolated.

    Attributes:
        time: ``(n,)`` [s].
        q_cmd: ``(n, n_joints)``, v_cmd and feedforward alike.
        v_cmd: commanded velocities [rad/s].
        feedforward: torque added to it [N·m].
        kp: ``(n_joints,)`` [N·m/rad].
        kd: ``(n_joints,)`` [N·m·s/rad].
        undamped: leave ``−kd v`` to the one who asks.
    """

    time: Array
    q_cmd: Array
    v_cmd: Array
    feedforward: Array
    kp: Array
    kd: Array
    undamped: bool = False

    def offers(self, times: Array) -> Array:
        """What the servo asks for with the joints at zero and at rest."""
        asked = self.kp * self.q_cmd + self.kd * self.v_cmd + self.feedforward
        return _interpolated(self.time, asked, times)

    def answer(self, offer: Array, q: Array, v: Array) -> Array:
        """What is offered less what the joints have already done of it."""
        asked = offer - self.kp * q
        return asked if self.undamped else asked - self.kd * v


def _interpolated(time: Array, values: Array, times: Array) -> Array:
    """Rows of ``values`` between those at ``time``, the first and last one beyond."""
    k = np.clip(np.searchsorted(time, times) - 1, 0, len(time) - 2)
    share = np.clip((times - time[k]) / (time[k + 1] - time[k]), 0.0, 1.0)[:, None]
    return (1.0 - share) * values[k] + share * values[k + 1]


# The torques that drive roll-outs: the log's, less the noise that the servo's commands can tell.
#
# Without feedback the noise of a torque channel is integrated twice, and soon hides what two simulators
# differ in. But a servo makes its torque from what it is asked for and what it sees: wherever that law,
# fitted to the log, leaves nothing but noise, the law's torque is the better reading. The two are joined by
# Wiener's filter (Wiener 1949).

# Noise of a torque channel is seen between these shares of the rate; nothing else of a motion is there.
_NOISE, _END = (0.25, 0.45), (0.075, 0.125)
_MANY = 4
_ROLLOUT_TORQUES_EDGE_S, _LEAST_S = 0.3, 2.0
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
    edge = max(
        settling_samples(samples.rate_hz, _cut(samples)), round(_ROLLOUT_TORQUES_EDGE_S * samples.rate_hz)
    )
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


HORIZON_S = 0.5
_TOTAL_S = 16.0
_STEP_S = 1.25e-3
_START_HZ = 10.0
_EDGE_S = 0.3
_PAST_S = 2.0
# Where torques were beyond their range all pieces without such are simulated, or this share with the fewest.
_KNOWN = 0.25


@dataclass(frozen=True, eq=False)
class Plan:
    """How roll-outs are run.

    Attributes:
        horizon_s: length of one [s].
        drives: by name of the trial, where its torques come from.
        driven_by: the same in words.
        total_s: simulated time at most: roll-outs are spread evenly over longer records [s].
        growth: by joint, how far friction that drifts has come, one ``(n,)`` a trial.
        deflections: by joint, deflection of a soft or loose gear and its speed, one ``(n, 2)`` a trial.
        fitted: simulate the identification trials, not the validation trials.
        torques: what drives them where that is the log's torques.
        least_gain: share of some joint's squared error that each effect after the first has to take away.
        all_effects: whether errors with all effects are wanted where some do not help.
        noise: ``(n_joints,)`` standard deviation of the filtered positions' noise [rad or m]; None where it is unknown.
    """

    horizon_s: float
    drives: dict[str, Drive]
    driven_by: str
    total_s: float = _TOTAL_S
    growth: Mapping[str, list[Array]] = field(default_factory=dict)
    deflections: Mapping[str, list[Array]] = field(default_factory=dict)
    fitted: bool = False
    torques: DrivingTorques | None = None
    least_gain: float = 0.0
    all_effects: bool = False
    noise: Array | None = None


def torque_plan(samples: ArmSamples) -> Plan:
    """Half a second with the logged torques."""
    torques = driving_torques(samples)
    drives: dict[str, Drive] = {t.name: LoggedTorque(t.time, torques.torque[t.name]) for t in samples.trials}
    how = "logged torque, smoothed by what the commands tell of it" if torques.smoothed else "logged torque"
    return Plan(HORIZON_S, drives, how, torques=torques)


@dataclass(frozen=True, eq=False)
class Piece:
    """A window with the torques that drive it and the positions that were recorded.

    Attributes:
        window: where it starts.
        drive: what drives it.
        recorded: ``(n_kept, n_joints)`` [rad].
        keep: steps between recorded positions.
    """

    window: Window
    drive: Drive
    recorded: Array
    keep: int


def pieces(samples: ArmSamples, rigid: Array, plan: Plan) -> list[Piece]:
    """Windows of the trials that the plan asks for, of all trials where there are no such ones.

    Args:
        samples: the samples.
        rigid: ``(n_samples, n_joints)`` torque that the gears carry, for their deflection [N·m].
        plan: horizon and drives.
    """
    loads, starts = samples.split(rigid), _starts(samples, plan)
    n = round(plan.horizon_s * samples.rate_hz)
    smooth = {k: _smooth(samples, samples.trials[k]) for k in {k for k, _ in starts}}
    return [_piece(samples, samples.trials[k], smooth[k], loads[k], i, n, plan) for k, i in starts]


def spans(samples: ArmSamples, plan: Plan) -> tuple[tuple[str, float, float], ...]:
    """Where the pieces lie: the trial's name, their first and last instant after its start [s]."""
    n = round(plan.horizon_s * samples.rate_hz)
    trials = samples.trials
    return tuple(
        (trials[k].name, float(trials[k].time[i]), float(trials[k].time[i + n]))
        for k, i in _starts(samples, plan)
    )


def _starts(samples: ArmSamples, plan: Plan) -> list[tuple[int, int]]:
    """Index of the trial and of the first sample of every piece."""
    wanted = [k for k, t in enumerate(samples.trials) if t.identification == plan.fitted]
    chosen = wanted or list(range(len(samples.trials)))
    n = round(plan.horizon_s * samples.rate_hz)
    edge = round(_EDGE_S * samples.rate_hz)
    starts = [(k, i) for k in chosen for i in range(edge, len(samples.trials[k].time) - edge - n, n)]
    if any(trial.beyond is not None for trial in samples.trials):
        # Nobody knows what drove the robot where a torque was beyond its range.
        guessed = np.array([_guessed(samples.trials[k], i, n) for k, i in starts])
        starts = (
            [starts[p] for p in np.flatnonzero(guessed <= np.quantile(guessed, _KNOWN))] if starts else starts
        )
    most = max(1, int(plan.total_s / plan.horizon_s))
    pick = np.unique(np.linspace(0, len(starts) - 1, min(most, len(starts))).round().astype(int))
    return [starts[p] for p in pick]


def _guessed(trial: ArmTrial, first: int, n: int) -> float:
    """Share of a piece's samples in which some torque is a guess."""
    return 0.0 if trial.beyond is None else float(trial.beyond[first : first + n + 1].any(axis=1).mean())


def _smooth(samples: ArmSamples, trial: ArmTrial) -> tuple[Array, Array]:
    cut = min(_START_HZ, 0.2 * samples.rate_hz)
    d = central_differences(lowpass(trial.q[:, list(samples.index)], samples.rate_hz, cut), samples.rate_hz)
    return d.value, d.first


def _piece(
    samples: ArmSamples,
    trial: ArmTrial,
    smooth: tuple[Array, Array],
    load: Array,
    i: int,
    n: int,
    plan: Plan,
) -> Piece:
    period = 1.0 / samples.rate_hz
    keep = max(1, int(np.ceil(period / _STEP_S - 1e-9)))
    step = period / keep
    t0 = float(trial.time[i])
    v = np.array([np.interp(t0 - 0.5 * step, trial.time, c) for c in smooth[1].T])
    k = samples.trials.index(trial)
    growth = {joint: float(values[k][i]) for joint, values in plan.growth.items()}
    deflected = {
        joint: (float(values[k][i, 0]), float(np.interp(t0 - 0.5 * step, trial.time, values[k][:, 1])))
        for joint, values in plan.deflections.items()
    }
    steps = np.asarray(t0 + step * np.arange(n * keep), dtype=np.float64)
    before = slice(max(0, i - round(_PAST_S * samples.rate_hz)), i + 1)
    past = Past(trial.time[before], smooth[0][before], trial.v[before][:, list(samples.index)])
    window = Window(smooth[0][i], v, load[i], steps, float(trial.session_s[i]), growth, past, deflected)
    recorded = trial.q[i : i + n + 1][:, list(samples.index)]
    return Piece(window, plan.drives[trial.name], recorded, keep)
