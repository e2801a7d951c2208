"""The servo of a command-only log: what it does with ``q_cmd``, and the torques that it must have asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.diagnosis.attribution import at_rows
from excite.diagnosis.effects.effect import Shape
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.readings import ActuatorLag
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.own_columns import ARMATURE
from excite.diagnosis.equations.samples import ArmSamples
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import Derivatives, central_differences, lowpass
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.kinematics import trial_rate

BAND_HZ = 30.0
FEEDFORWARDS = ("none", "gravity", "inverse_dynamics")
# Samples from a position's reading to the torque that answers it: computed in one cycle, held for the next.
_LONGEST_SAMPLES = 2.0
# Where the spectral floor is measured, in multiples of the rows' band.
_ABOVE = (1.5, 3.0)


@dataclass(frozen=True, eq=False)
class Servo:
    """``τ = kp (q_cmd − q) + kd (s·v_cmd − v) + feedforward`` of every joint.

    Attributes:
        kp: ``(n_joints,)`` in the log's order [N·m/rad].
        kd: ``(n_joints,)`` [N·m·s/rad].
        feedforward: ``none``, ``gravity`` of the nominal model at q, or its ``inverse_dynamics`` at the command.
        follows_velocity: s: whether the damping acts on the velocity's error or on the velocity itself.
        estimated: what was estimated and not stated.
        told: by name of a gain, ``(2, n_joints)``: as the record tells it, stated or not, and its standard deviation.
    """

    kp: Array
    kd: Array
    feedforward: str
    follows_velocity: bool
    estimated: tuple[str, ...] = ()
    told: Mapping[str, Array] = field(default_factory=dict)

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
    """

    time: Array
    measured: Derivatives
    commanded: Derivatives
    gravity: Array
    dynamics: Array
    nominal: Array

    def feedforward(self, kind: str) -> Array:
        """Torque that the servo adds, ``(n, n_joints)`` [N·m]."""
        return {"none": 0.0 * self.gravity, "gravity": self.gravity, "inverse_dynamics": self.dynamics}[kind]

    def commanded_torque(self, servo: Servo) -> Array:
        """What the servo would ask for with the joints at zero and at rest, but for its feedforward [N·m]."""
        return servo.kp * self.commanded.value + servo.damping_share * servo.kd * self.commanded.first

    def torque(self, servo: Servo) -> Array:
        """What the servo asked its motors for, ``(n, n_joints)`` [N·m]."""
        fed_back = servo.kp * self.measured.value + servo.kd * self.measured.first
        return self.commanded_torque(servo) - fed_back + self.feedforward(servo.feedforward)

    def acting_torque(self, servo: Servo, lag: float) -> Array:
        """The same as it acts, later by a lag [s]."""
        return delayed(self.time, self.torque(servo), lag)


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
        full = np.zeros((3, len(trial.time), robot.model.nv))
        full[0] = robot.rest
        for part, values in zip(full, (d.value, moving * d.first, moving * d.second), strict=True):
            part[:, index] = values
        return inverse_dynamics(model, *full)[:, index]

    forward = (controller or robot).model
    return Signals(
        trial.time, q, c, torque(forward, q, 0.0), torque(forward, c, 1.0), torque(robot.model, q, 1.0)
    )


def delayed(time: Array, torque: Array, lag: float) -> Array:
    """Torques ``(n, n_joints)`` as they act, later by a lag [s]."""
    return np.column_stack([np.interp(time - lag, time, column) for column in torque.T])


def cycle_lag(samples: ArmSamples, modelled: tuple[str, ...]) -> float:
    """How much later than it was asked for a servo's torque acts [s]: its cycle, and the filter of its encoders.

    A digital servo reads its encoders, computes for a cycle and holds its torque for another one (Franklin,
    Powell, Workman 1998, chapter 4), and a filter of the logged positions adds its own delay: without a torque
    channel none of this can be told from a lag of the drive. Each joint's lag is fitted beside the baseline; the
    median over the joints hardly heeds one joint that has something else.

    Args:
        samples: trials with the torques that were asked for.
        modelled: what the baseline has.

    Returns:
        The lag; 0 where there is none, or one that is longer than two samples.
    """
    baseline = fit_baseline(samples, (*modelled, *ARMATURE.words), spectral_floor(samples), late=False)
    context, n = Context(baseline), len(samples.joints)
    common = ActuatorLag().shape(context, "torque", ()).columns
    apart = Shape({j: column * np.eye(n)[j] for j, column in common.items()})
    lag = float(np.median(baseline.solver.fit(at_rows(context, apart).extra).extra))
    return lag if 0.0 < lag <= _LONGEST_SAMPLES / samples.rate_hz else 0.0


def servo_floor(samples: ArmSamples, servo: Servo, order: list[int]) -> Array:
    """Noise in the rows' band, ``(n_joints,)`` [N·m], of torques rebuilt from positions.

    Above the band the noise is measured; below it is what the servo makes of encoders whose noise is white: it
    grows with the frequency as ``|kp + i 2πf kd|``, by several times within a decade where kd/kp is long. A floor
    that took it for flat would hide all that is weak.

    Args:
        samples: trials with torques rebuilt with this servo.
        servo: the servo.
        order: of the samples' joints in the log.
    """
    rate, rows_hz = samples.rate_hz, samples.bands.rows_hz
    f = np.linspace(0.0, 0.5 * rate, 2000)[1:]
    grown = servo.kp[order] ** 2 + (2.0 * np.pi * f[:, None] * servo.kd[order]) ** 2
    grown *= _power_passed(f, BAND_HZ, rate)[:, None]
    high = min(_ABOVE[1] * rows_hz, 0.45 * rate)
    low = min(_ABOVE[0] * rows_hz, 0.7 * high)
    above = np.median(grown[(f > low) & (f < high)], axis=0)
    passed = _power_passed(f, rows_hz, rate)[:, None]
    share = np.minimum((grown * passed).sum(axis=0) / (above * passed.sum()), 1.0)
    return np.asarray(spectral_floor(samples) * np.sqrt(share))


def _power_passed(f: Array, cutoff_hz: float, rate_hz: float) -> Array:
    """Share of the power at ``f`` [Hz] that a fourth-order Butterworth filter run both ways lets through."""
    if cutoff_hz >= 0.5 * rate_hz:
        return np.ones_like(f)
    warped = np.tan(np.pi * np.minimum(f, 0.4999 * rate_hz) / rate_hz) / np.tan(np.pi * cutoff_hz / rate_hz)
    return 1.0 / (1.0 + warped**8) ** 2
