"""The servo of a command-only log: what it does with ``q_cmd``, stated or estimated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import lowpass
from excite.logs.signals.differentiate import Derivatives, central_differences
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
