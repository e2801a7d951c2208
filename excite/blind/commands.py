"""Blind cases without torque: position servos of several forms, and the log that is left of a case."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.blind.arm import PAUSE_S, TRIAL_S, Arm
from excite.blind.hidden import Answer
from excite.logs.log import Log, Trial
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.simulation.plant import Plant

FEEDFORWARDS = ("none", "gravity", "inverse_dynamics")
# Errors of a torque channel, which a log without one cannot have.
CHANNEL = frozenset({"time_delay", "torque_gain", "torque_bias"})


@dataclass(frozen=True)
class Servo:
    """``τ = kp (q_cmd − q) + kd (s·v_cmd − v) + ki ∫(q_cmd − q) dt + feedforward`` of every joint.

    Attributes:
        feedforward: ``none``, ``gravity`` of the nominal model at q, or its ``inverse_dynamics`` at the command.
        follows_velocity: whether s is 1 and not 0: a velocity loop that only brakes.
        integral: ki/kp [1/s].
        stated: whether the log says all of this, or nothing but that it is a position servo.
    """

    feedforward: str = "none"
    follows_velocity: bool = True
    integral: float = 0.0
    stated: bool = True

    def on(self, arm: Arm) -> Arm:
        """The arm under this servo."""
        motions = (*arm.motions, arm.motions[0])
        return replace(arm, virtual=arm.virtual.with_law(_ServoLaw(self, motions)))

    def logged(self, log: Log, answer: Answer) -> tuple[Log, Answer]:
        """A case's log and answer without torques.

        What only a torque channel can have is gone from the answer. An encoder with an offset is the servo's own
        and commands are in its angles, unless the servo reckons torques from positions: that one knows the true ones.
        """
        controller = dict(log.header.controller or {})
        said: dict[str, Any] = {"mode": "position"}
        if self.stated:
            gains = {name: controller[name] for name in ("kp", "kd")}
            said |= gains | {
                "feedforward": self.feedforward,
                "velocity_reference": "derivative of q_cmd" if self.follows_velocity else "none",
                "rate_hz": controller["rate_hz"],
            }
            if self.integral:
                said["ki"] = {name: self.integral * kp for name, kp in gains["kp"].items()}
        header = log.header.model_copy(update={"torque": "none", "controller": said})
        shift = np.zeros(len(log.header.joints))
        for item in answer.effects:
            if item.effect == "encoder_offset" and self.feedforward != "none":
                shift[log.header.joints.index(item.location)] = -item.value
        trials = tuple(_without_torque(trial, shift) for trial in log.trials)
        effects = tuple(item for item in answer.effects if item.effect not in CHANNEL)
        kind = answer.kind
        if len(effects) < len(answer.effects):
            kind = "single" if effects else "none"
        return replace(log, header=header, trials=trials), replace(answer, kind=kind, effects=effects)


def drawn_servo(rng: np.random.Generator) -> Servo:
    """The servo of a case: gains are stated in about half of the cases; only stated ones have an integral part."""
    feedforward = str(rng.choice(FEEDFORWARDS))
    follows, stated = bool(rng.random() < 0.7), bool(rng.random() < 0.5)
    slow = float(rng.uniform(0.5, 3.0))
    return Servo(feedforward, follows, slow if stated and rng.random() < 0.25 else 0.0, stated)


def _without_torque(trial: Trial, shift: Array) -> Trial:
    commands = None if trial.q_cmd is None else trial.q_cmd + shift
    return replace(trial, tau=None, q_cmd=commands)


@dataclass(frozen=True, eq=False)
class _ServoLaw:
    """Turns the simulated servo, ``kp (q_cmd − q) + kd (v_cmd − v)``, into another one by moving its command.

    Attributes:
        servo: the other one.
        motions: commands of the session's runs in their order.
    """

    servo: Servo
    motions: tuple[Motion, ...]

    def start(self, plant: Plant) -> Callable[[], None]:
        """The law as a step."""
        motion = self.motions[round(plant.session_s / (TRIAL_S + PAUSE_S))]
        drives, step_s = plant.drives, float(plant.model.opt.timestep)
        lead = drives.kd / drives.kp
        asked = plant.data.ctrl.copy()
        moved = np.full_like(asked, np.nan)
        integral = np.zeros_like(asked)
        torque = _feedforward_law(self.servo.feedforward, plant.robot)

        def step() -> None:
            nonlocal moved, integral
            ctrl = plant.data.ctrl
            if not np.array_equal(ctrl, moved):
                asked[:] = ctrl
            now = max(plant.time, 0.0)
            v, a = (np.array([np.interp(now, motion.time, c) for c in x.T]) for x in (motion.v, motion.a))
            command, q = asked - lead * v, plant.data.qpos[plant.qpos]
            integral = integral + step_s * (command - q)
            push = torque(command, v, a, q) / drives.kp + self.servo.integral * integral
            moved = (asked if self.servo.follows_velocity else command) + push
            ctrl[:] = moved

        return step


def _feedforward_law(kind: str, robot: Robot) -> Callable[[Array, Array, Array, Array], Array]:
    """Torque ``(n_joints,)`` from command, its velocity and acceleration, and the position."""
    model, data = robot.model, robot.model.createData()
    return {
        "none": lambda c, v, a, q: np.zeros_like(c),
        "gravity": lambda c, v, a, q: pin.computeGeneralizedGravity(model, data, q).copy(),
        "inverse_dynamics": lambda c, v, a, q: pin.rnea(model, data, c, v, a).copy(),
    }[kind]
