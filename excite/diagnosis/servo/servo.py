"""The servo of a command-only log: what it does with ``q_cmd``, stated or estimated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
import pinocchio as pin
import scipy

from excite.arrays import Array
from excite.diagnosis.attribution import Attribution, Scored, at_rows, withdrawn
from excite.diagnosis.effects.effect import Shape
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.readings import ActuatorLag
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.own_columns import ARMATURE, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import Derivatives, central_differences, lowpass
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.kinematics import trial_rate

BAND_HZ = 30.0
FEEDFORWARDS = ("none", "gravity", "inverse_dynamics")


@dataclass(frozen=True, eq=False)
class Servo:
    """``τ = kp (q_cmd − q) + kd (s·v_cmd − v) + ki ∫(q_cmd − q) dt + feedforward`` of every joint.

    Attributes:
        kp: ``(n_joints,)`` in the log's order [N·m/rad].
        kd: ``(n_joints,)`` [N·m·s/rad].
        feedforward: ``none``, ``gravity`` of the nominal model at q, or its ``inverse_dynamics`` at the command.
        follows_velocity: s: whether the damping acts on the velocity's error or on the velocity itself.
        ki: ``(n_joints,)`` [N·m/(rad·s)], 0 where there is no integral part.
        estimated: what was estimated and not stated.
        rate_hz: its cycles per second, None where they are not stated.
        spread: by name of a gain, ``(n_joints,)`` standard deviations of those that were estimated.
    """

    kp: Array
    kd: Array
    feedforward: str
    follows_velocity: bool
    ki: Array | None = None
    estimated: tuple[str, ...] = ()
    rate_hz: float | None = None
    spread: Mapping[str, Array] = field(default_factory=dict)

    @property
    def damping_share(self) -> float:
        """s, 1 or 0."""
        return 1.0 if self.follows_velocity else 0.0


@dataclass(frozen=True, eq=False)
class Signals:
    """One trial's commands and motion on an even clock, the log's joints.

    Attributes:
        time: ``(n,)`` [s].
        measured: position and its derivatives, ``(n, n_joints)``.
        commanded: the command's.
        gravity: torque that holds the measured position by the servo's model ``(n, n_joints)`` [N·m].
        dynamics: inverse dynamics at the command by that model.
        nominal: nominal inverse dynamics at the measured motion.
        integral: torque of the servo's integral part, 0 before it is known.
    """

    time: Array
    measured: Derivatives
    commanded: Derivatives
    gravity: Array
    dynamics: Array
    nominal: Array
    integral: Array

    def feedforward(self, kind: str) -> Array:
        """Torque that the servo adds, ``(n, n_joints)`` [N·m]."""
        return {
            "none": np.zeros_like(self.gravity),
            "gravity": self.gravity,
            "inverse_dynamics": self.dynamics,
        }[kind]

    def torque(self, servo: Servo) -> Array:
        """What the servo asked its motors for, ``(n, n_joints)`` [N·m]."""
        e = self.commanded.value - self.measured.value
        rate = servo.damping_share * self.commanded.first - self.measured.first
        return servo.kp * e + servo.kd * rate + self.integral + self.feedforward(servo.feedforward)


def read_signals(robot: Robot, log: Log, trial: Trial, controller: Robot | None = None) -> Signals:
    """Commands and motion of a trial, differentiated.

    Args:
        robot: the nominal model.
        log: the log, for its header.
        trial: the trial.
        controller: the model that the servo's feedforward was computed with, where it is another.

    Raises:
        LogError: the trial has no commands.
    """
    if trial.q_cmd is None:
        raise LogError(
            "has neither torques nor commands",
            source=trial.name,
            field="q_cmd",
            remedy="log q_cmd.* or tau.*",
        )
    rate = trial_rate(log.header, trial)
    index = [robot.joint_index(name) for name in log.header.joints]
    q, c = (central_differences(lowpass(x, rate, BAND_HZ), rate) for x in (trial.q, trial.q_cmd))

    def torque(model: pin.Model, d: Derivatives, moving: float) -> Array:
        full = [np.tile(robot.rest, (len(trial.time), 1))] + [np.zeros((len(trial.time), robot.model.nv))] * 2
        full = [part.copy() for part in full]
        for part, values, share in zip(
            full, (d.value, d.first, d.second), (1.0, moving, moving), strict=True
        ):
            part[:, index] = share * values
        return inverse_dynamics(model, *full)[:, index]

    still = np.zeros_like(q.value)
    forward = (controller or robot).model
    gravity, dynamics = torque(forward, q, 0.0), torque(forward, c, 1.0)
    return Signals(trial.time, q, c, gravity, dynamics, torque(robot.model, q, 1.0), still)


# How much later than it was asked for a servo's torque acts: its cycle, and the filter of its encoders.

# Samples from a position's reading to the torque that answers it: computed in one cycle, held for the next.
LONGEST_SAMPLES = 2.0
# A cycle of a slow servo [s].
_NEWEST_S = 2e-3
_JOINTS = 3


@dataclass(frozen=True)
class Cycle:
    """When a servo's torque acts.

    Attributes:
        lag: between the torque that commands and positions speak for and the one that acts [s].
        newer: how much newer than the log's the velocity is that its damping acts on [s]; negative where it is older.
        longest: what two of the servo's cycles are, where the lag is surely longer [s].
    """

    lag: float
    newer: float = 0.0
    longest: float = np.inf

    def sentences(self) -> tuple[str, ...]:
        """What cannot be seen beside it."""
        said = []
        if self.lag > 0.0:
            said.append(
                f"torques act {1e3 * self.lag:.1f} ms after commands and positions ask for them, taken for the "
                "servo's cycle: a lag of the drive that is as short cannot be seen"
            )
        if self.lag > self.longest:
            said.append(
                f"of these, no more than {1e3 * self.longest:.1f} ms are cycles of the servo at its rate: the rest is "
                "a filter of the positions or a lag of the drives; what tells them apart: log positions unfiltered"
            )
        if self.newer != 0.0:
            said.append(
                f"the servo's damping acts on a velocity {1e3 * abs(self.newer):.1f} ms "
                f"{'newer' if self.newer > 0.0 else 'older'} than the log's: rotors that all are that much of kd "
                "cannot be seen"
            )
        return tuple(said)


def servo_cycle(
    samples: ArmSamples, modelled: tuple[str, ...], kd: Array, rate_hz: float | None = None
) -> Cycle:
    """When the servo's torques act.

    A digital servo reads its encoders, computes for a cycle and holds its torque for another one (Franklin,
    Powell, Workman 1998, chapter 4), and a filter of the logged positions adds its own delay: without a torque
    channel none of this can be told from a lag of the drive. Each joint's lag is fitted beside the baseline; the
    median over the joints hardly heeds one joint that has something else.

    Damping by a velocity that is newer or older than the log's by T is ``kd T`` of inertia more or less. Where no
    rotors are modelled, which would take it up, the same median of what rotors would have over kd tells T.

    Args:
        samples: trials with the torques that were asked for.
        modelled: what the baseline has.
        kd: ``(n_joints,)`` damping by joint of the samples [N·m·s/rad].
        rate_hz: the servo's rate where it is known [Hz].

    Returns:
        The cycle; a lag is 0 where it is none or longer than ``LONGEST_SAMPLES``, T where it is longer than
        ``_NEWEST_S``: that is more than a cycle.
    """
    rotors_too = (*modelled, *ARMATURE.words)
    own = own_terms(rotors_too)
    baseline = fit_baseline(samples, rotors_too, spectral_floor(samples), late=False)
    context = Context(baseline)
    common = ActuatorLag().shape(context, "torque", ()).columns
    n = len(samples.joints)
    apart = Shape({j: column * np.eye(n)[j] for j, column in common.items()})
    lags = baseline.solver.fit(at_rows(context, apart).extra).extra
    lag, newer = float(np.median(lags)), 0.0
    # Of a median, from the median of what is off it (Huber 1981, section 1.2).
    unsure = 1.25 * 1.48 * float(np.median(np.abs(lags - lag))) / np.sqrt(n)
    own_s = LONGEST_SAMPLES / rate_hz if rate_hz else np.inf
    # The median over fewer joints would be a rotor of one of them.
    if not ARMATURE.asked(modelled) and (kd > 0.0).all() and n >= _JOINTS:
        rotors = np.array([values[own.index(ARMATURE)] for values in baseline.fit.own])
        newer = float(np.median(rotors / kd))
    return Cycle(
        lag if 0.0 < lag <= LONGEST_SAMPLES / samples.rate_hz else 0.0,
        newer if abs(newer) <= _NEWEST_S else 0.0,
        own_s if lag - 2.0 * unsure > own_s else np.inf,
    )


def later(time: Array, torque: Array, lag: float) -> Array:
    """Torques ``(n, n_joints)`` as they act, later by a lag [s]."""
    return np.column_stack([np.interp(time - lag, time, column) for column in torque.T])


def acting(signals: Signals, servo: Servo, cycle: Cycle) -> Array:
    """Torques of one trial as they act, ``(n, n_joints)`` in the log's order [N·m]."""
    asked = signals.torque(servo) - cycle.newer * servo.kd * signals.measured.second
    return later(signals.time, asked, cycle.lag)


# Torque of a servo's integral part: its growth from the errors, its start from what the baseline misses.


def error_integral(signals: Signals) -> Array:
    """Integral of the position error since the trial's start, ``(n, n_joints)`` [rad·s]."""
    error = signals.commanded.value - signals.measured.value
    return np.asarray(scipy.integrate.cumulative_trapezoid(error, signals.time, axis=0, initial=0.0))


@dataclass(frozen=True, eq=False)
class _Levelled(ArmSamples):
    """Samples whose filter also takes every trial's mean off: on both sides of every equation alike."""

    def rows(self, signals: Array | Sequence[Array], joints: Sequence[int] | None = None) -> Array:
        values, of_row = super().rows(signals, joints), self.trial_of_row
        parts = [values[of_row == k] for k in range(len(self.trials))]
        return np.concatenate([part - part.mean(axis=0) for part in parts])


def trial_levels(samples: ArmSamples, modelled: tuple[str, ...]) -> dict[str, Array]:
    """Constants to be added to each trial's torques, ``(n_joints,)`` [N·m] by name.

    A baseline is fitted to what varies within trials; the constants are what its torques have more than the
    trials', on the mean.

    Args:
        samples: trials with torques but for these constants.
        modelled: what the baseline has.

    Returns:
        By trial, in the order of the samples' joints.
    """
    levelled = _Levelled(**{item.name: getattr(samples, item.name) for item in fields(samples)})
    baseline = fit_baseline(levelled, modelled, spectral_floor(levelled))
    missing = [
        total - t.measured for total, t in zip(samples.split(baseline.total), samples.trials, strict=True)
    ]
    found = {}
    for trial, rest in zip(samples.trials, missing, strict=True):
        found[trial.name] = np.asarray(rest[trial.rows].mean(axis=0))
    return found


# How large effects are beside what torques rebuilt from a servo can tell.

# How exact torques are that are rebuilt from commands and positions: cycles, held commands, encoders' filters.
EXACT = 0.015


def effect_strength(item: Scored) -> float:
    """RMS of an effect's torque over a joint's whole torque's deviation, at most; infinite where it has no columns."""
    h, samples = item.hypothesis, item.hypothesis.baseline.samples
    if h.columns.extra is None:
        return float(np.inf)
    made = np.sqrt(((h.columns.extra @ h.fit.extra) ** 2).mean(axis=1))
    return float((made / samples.rows([t.measured for t in samples.trials]).std(axis=0)).max())


def without_faint(attribution: Attribution, baseline: Baseline) -> Attribution:
    """The attribution up to the first effect that rebuilt torques are not exact enough for.

    The noise floor stays, and the parameters of the effects before it that were searched beside it: what is so faint
    moves neither. Where it happens, the floor without it is within 0.3 % of the one with it, and roll-outs' errors with
    parameters searched again are within 0.3 % of those without.

    Args:
        attribution: all its steps.
        baseline: the baseline that they began with.
    """
    for k, item in enumerate(attribution.accepted):
        if effect_strength(item) < EXACT:
            if k == 0:
                return withdrawn(attribution, baseline)
            stages = (*attribution.stages[:k], replace(attribution.stages[k], accepted=None))
            final = attribution.stages[k].context.baseline
            return replace(attribution, stages=stages, after=final.fit, final=final)
    return attribution


# Whether the change that effects make to closed-loop roll-outs goes the way that the record asks for.

# A change of less than this share of the roll-outs' amplitude of error is lost in it; one so much larger than what it
# is to explain is a simulation that gets nowhere.
_HEARD, _WILD = 0.1, 10.0
# Standard errors by which a change has to go the right way.
_SURE = 2.0
# Fewer roll-outs do not tell by how much they disagree.
_ROLLOUTS = 4
# A change of which so little goes the right way makes things worse, however surely.
_LEAST = 0.1


@dataclass(frozen=True)
class Witness:
    """What roll-outs say of effects.

    Attributes:
        slope: share of the effects' change that the error without them asks for: 1 where they are all that is missing,
            0 where they have nothing to do with it; NaN where roll-outs with them diverge.
        error: standard error of the slope.
        heard: amplitude of the change over that of the error, at the joint where it is most.
    """

    slope: float
    error: float
    heard: float

    @property
    def speaks_against(self) -> bool:
        """Whether the change is surely less than foretold, and not surely any of it the right way.

        A simulation that gets nowhere says nothing, nor does a change within the error.
        """
        if not (np.isfinite(self.slope) and _HEARD <= self.heard <= _WILD):
            return False
        return self.slope < 1.0 - _SURE * self.error and self.slope < max(_SURE * self.error, _LEAST)


def witness(before: Array, after: Array, band: float = 1.0) -> Witness:
    """Regress what the record asks for on what effects do.

    Under feedback the positions hardly show an effect that the torques show well: how much of the error goes
    tells little where friction, noise and the start have most of it. Whether what goes is what was foretold does.
    Every frequency weighs by the error that there is without the effects, in octaves: slow errors of friction are
    the largest, and would drown what a soft gear does (generalised least squares, Aitken 1936).

    Args:
        before: simulated less recorded positions without the effects ``(n_windows, n, n_joints)`` [rad].
        after: with them.
        band: share of the frequencies up to half the sampling rate that effects were fitted in: beyond, a filtered
            record has next to nothing, and the start of a simulation has something.

    Returns:
        What they say, all joints weighed by their errors without the effects.
    """
    if not np.isfinite(after).all():
        return Witness(np.nan, np.nan, 0.0)
    size = np.sqrt((before**2).mean(axis=(0, 1))) + 1e-12
    heard = float((np.sqrt(((after - before) ** 2).mean(axis=(0, 1))) / size).max())
    count = max(round(band * before.shape[1]), 1)
    old, new = (_spectrum(x / size)[:, :count] for x in (before, after))
    weight = 1.0 / _levels(old)
    error, change = old * weight, (new - old) * weight
    asked, made = (x.sum(axis=(1, 2)) for x in (-error * change, change**2))
    total = float(made.sum())
    if total <= 0.0:
        return Witness(np.nan, np.nan, 0.0)
    slope = float(asked.sum()) / total
    if len(made) < _ROLLOUTS:
        return Witness(slope, np.inf, heard)
    # Of a ratio of sums over the joints and frequencies of each roll-out (Cochran 1977, section 6.3).
    spread = float(np.sqrt(len(made) / max(len(made) - 1, 1) * ((asked - slope * made) ** 2).sum()))
    return Witness(slope, spread / total, heard)


def _spectrum(errors: Array) -> Array:
    """Cosine transform over time: what begins and ends apart leaks next to nothing into it."""
    from scipy.fft import dct

    return np.asarray(dct(errors, axis=1, norm="ortho"))


def _levels(spectrum: Array) -> Array:
    """RMS over the windows and the octave of each frequency, ``(n, n_joints)``."""
    octave = np.frexp(np.arange(spectrum.shape[1]))[1]
    levels = np.empty(spectrum.shape[1:])
    for k in range(int(octave.max()) + 1):
        inside = octave == k
        levels[inside] = np.sqrt((spectrum[:, inside] ** 2).mean(axis=(0, 1)))
    return levels + 1e-9
