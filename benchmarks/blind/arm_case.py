"""Cases of an arm in the benchmark: a used robot, its session of trials, faults of the record, command-only logs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.blind.documents import Answer
from excite.arrays import Array
from excite.logs.log import Log, Trial
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.simulation.mjcf import World
from excite.simulation.true_parameters import (
    moved_inertia,
    nominal_drives,
    nominal_truth,
    scattered_parameters,
)
from excite.simulation.virtual_robot import Plant, VirtualRobot

# Arms of a blind benchmark: a used robot, its sensors, its session of trials.

RATE_HZ = 200.0
TRIAL_S, PAUSE_S = 10.0, 2.0
N_TRIALS, N_VALIDATION = 5, 2


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm before anything is hidden in it.

    Attributes:
        virtual: the robot, its drives' dry and viscous friction and rotor inertia all there.
        motions: one a command: identification trials, then validation trials.
        load: ``(n_joints,)`` standard deviation of the torque that the links need [N·m].
        torque: ``(n_joints,)`` typical torque of the motor, friction included [N·m].
        inertia: ``(n_joints,)`` inertia that each joint moves [kg·m²].
    """

    virtual: VirtualRobot
    motions: tuple[Motion, ...]
    load: Array
    torque: Array
    inertia: Array


def arm_of(robot: Robot, fixed: bool, rng: np.random.Generator) -> Arm:
    """A used arm and the motions of its session.

    Args:
        robot: an arm.
        fixed: whether its inertial parameters are the model's; else they are scattered.
        rng: source of all that is drawn.

    Returns:
        The arm.
    """
    sensors = robot.description.sensors.model_copy(update={"rate_hz": RATE_HZ, "joint_torque": "motor_side"})
    robot = replace(robot, description=robot.description.model_copy(update={"sensors": sensors}))
    motions = tuple(_fourier_motion(robot, f"trial_{k:02d}", rng) for k in range(N_TRIALS + N_VALIDATION))
    load = np.vstack([_needed_torques(robot, motion) for motion in motions]).std(axis=0)
    inertia = np.array([moved_inertia(robot, name) for name in robot.joint_names])
    n = robot.n_joints
    # Small joints have small rotors and large gear ratios.
    armature = np.maximum(inertia * rng.uniform(0.1, 0.4, n), 0.01 * inertia.max())
    speed_up = np.vstack([motion.a for motion in motions]).std(axis=0)
    size = np.hypot(load, armature * speed_up) + 0.002 * load.max()
    drives = replace(
        nominal_drives(robot),
        coulomb=size * rng.uniform(0.06, 0.25, n),
        viscous=size * rng.uniform(0.04, 0.2, n),
        armature=armature,
    )
    truth = nominal_truth(robot) if fixed else scattered_parameters(robot, rng, scatter=0.08)
    virtual = VirtualRobot(robot, truth, drives, World(timestep=1e-3))
    return Arm(virtual, motions, load, size + drives.coulomb, inertia)


def _fourier_motion(robot: Robot, name: str, rng: np.random.Generator) -> Motion:
    """A finite Fourier series that starts and ends at rest (Swevers et al. 1997)."""
    n, limits = robot.n_joints, robot.limits
    time = np.arange(round(TRIAL_S * RATE_HZ) + 1) / RATE_HZ
    s = np.clip(np.minimum(time, TRIAL_S - time) / 0.8, 0.0, 1.0)
    window = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    harmonics = np.arange(1, 6) * 2.0 * np.pi / TRIAL_S * rng.uniform(1.0, 1.3)
    low, high = limits.position_lower, limits.position_upper
    centre = np.clip(robot.rest + rng.uniform(-0.5, 0.5, n), low + 0.3, high - 0.3)
    q = np.empty((len(time), n))
    for j in range(n):
        a, b = rng.standard_normal((2, 5)) / np.sqrt(np.arange(1, 6))
        wave = np.cos(np.outer(time, harmonics)) @ a + np.sin(np.outer(time, harmonics)) @ b
        wave = window * (wave - wave.mean())
        speed = np.abs(np.gradient(wave, time)).max()
        reach = max(wave.max() / (high[j] - centre[j]), -wave.min() / (centre[j] - low[j]))
        fastest = min(1.6, 0.8 * limits.velocity[j])
        q[:, j] = centre[j] + wave * min(fastest / speed, 0.95 / reach)
    v = np.gradient(q, time, axis=0)
    return Motion(name, robot.name, robot.joint_names, time, q, v, np.gradient(v, time, axis=0))


def _needed_torques(robot: Robot, motion: Motion) -> Array:
    data = robot.model.createData()
    rows = range(0, motion.n_samples, 20)
    return np.array([pin.rnea(robot.model, data, motion.q[k], motion.v[k], motion.a[k]) for k in rows])


# Blind cases without torque: position servos of several forms, and the log that is left of a case.

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


# Faults of a record: rows repeated or lost, stamps that jitter or are late, coarse sensors, filters.


def repeat_rows(trial: Trial, rng: np.random.Generator) -> Trial:
    """Two to four rows a trial hold what the row before them held; stamps go on."""
    index = np.arange(len(trial.time))
    again = rng.choice(index[1:], int(rng.integers(2, 5)), replace=False)
    index[again] = again - 1
    return replace(trial.rows(index), time=trial.time)


def lose_rows(trial: Trial, rng: np.random.Generator) -> Trial:
    """One row in fifty is missing."""
    keep = rng.random(len(trial.time)) > 0.02
    keep[[0, -1]] = True
    return trial.rows(keep)


def delay_stamps(trial: Trial, rng: np.random.Generator) -> Trial:
    """Stamps are late by up to a third of a step; the values are not."""
    step = float(trial.time[1] - trial.time[0])
    return replace(trial, time=trial.time + rng.uniform(0.0, 0.33 * step, len(trial.time)))


def jitter_rows(trial: Trial, rng: np.random.Generator) -> Trial:
    """Rows are taken up to a fifth of a step early or late, and their stamps say so."""
    from scipy.interpolate import CubicSpline

    step = float(trial.time[1] - trial.time[0])
    time = trial.time + rng.uniform(-0.2 * step, 0.2 * step, len(trial.time))
    time = np.clip(time, trial.time[0], trial.time[-1])
    time[0] = trial.time[0]
    order = np.argsort(time, kind="stable")
    time = time[order]

    def at(values: Array) -> Array:
        return np.asarray(CubicSpline(trial.time, values)(time))

    return replace(
        trial,
        time=time,
        q=at(trial.q),
        tau=None if trial.tau is None else at(trial.tau),
        q_cmd=None if trial.q_cmd is None else at(trial.q_cmd),
    )


def quantise_channels(trial: Trial, rng: np.random.Generator) -> Trial:
    """Encoders of 16 bits a turn, torques of eight to nine bits."""
    q_step = 2.0 * np.pi / 2**16
    q = np.round(trial.q / q_step) * q_step
    if trial.tau is None:
        return replace(trial, q=q)
    step = 2.0 ** np.ceil(np.log2(trial.tau.std(axis=0) / 100.0))
    return replace(trial, q=q, tau=np.round(trial.tau / step) * step)


def filter_channels(trial: Trial, rng: np.random.Generator) -> Trial:
    """All channels went through the same low-pass on their way to the log, and are late alike."""
    from scipy.signal import butter, lfilter, lfilter_zi

    rate = (len(trial.time) - 1) / float(trial.time[-1] - trial.time[0])
    b, a = butter(1, rng.uniform(30.0, 60.0), fs=rate)

    def late(values: Array) -> Array:
        start = lfilter_zi(b, a)[:, None] * values[:1]
        return np.asarray(lfilter(b, a, values, axis=0, zi=start)[0])

    return replace(
        trial,
        q=late(trial.q),
        tau=None if trial.tau is None else late(trial.tau),
        q_cmd=None if trial.q_cmd is None else late(trial.q_cmd),
    )


FAULTS: dict[str, Callable[[Trial, np.random.Generator], Trial]] = {
    "repeated_rows": repeat_rows,
    "missing_rows": lose_rows,
    "late_stamps": delay_stamps,
    "jitter": jitter_rows,
    "quantised": quantise_channels,
    "filtered": filter_channels,
}
