"""A Go2 that trots, and what can be wrong with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import excite
from benchmarks.walking.servos import POLICY_HZ, Case, Fault, walk
from excite.arrays import Array
from excite.logs.log import Log
from excite.robot.robot import Robot

_LEGS, _THIGH = ("FL", "FR", "RL", "RR"), 0.213


def draw_case(kind: int, rng: np.random.Generator) -> Case:
    """A fault of random place and size; ``kind`` counts through the effects."""
    joint = f"{rng.choice(_LEGS)}_{rng.choice(['hip', 'thigh', 'calf'])}_joint"
    foot, side = str(rng.choice(_LEGS)), float(rng.choice([-1, 1]))
    far, axis = rng.uniform(0.0, 1.0), rng.standard_normal(3)
    most = 11.5 if joint[0] == "F" else 15.0
    turn = tuple((0.05 + 0.08 * far) * axis / np.linalg.norm(axis))
    drawn = (
        (joint, "torque_gain", Fault(joint, strength=0.85 - 0.2 * far)),
        (joint, "servo_gain", Fault(joint, stiffness=0.85 - 0.2 * far)),
        (joint, "command_delay", Fault(joint, late_s=0.010 + 0.015 * far)),
        (joint, "encoder_offset", Fault(joint, zero=(0.04 + 0.04 * far) * side)),
        (joint, "coulomb_friction", Fault(joint, dry=0.4 + 0.6 * far)),
        (joint, "viscous_friction", Fault(joint, viscous=0.15 + 0.25 * far)),
        ("command", "command_delay", Fault(late_s=0.010 + 0.010 * far)),
        ("command", "command_jitter", Fault(jitter_s=0.003 + 0.003 * far)),
        (joint, "servo_damping", Fault(joint, damping=1.4 + 0.6 * far)),
        (joint, "command_offset", Fault(joint, ahead=(0.05 + 0.05 * far) * side)),
        (joint, "command_scale", Fault(joint.replace("hip", "thigh"), scale=0.85 - 0.15 * far)),
        (
            joint,
            "torque_saturation",
            Fault(joint.replace("hip", "calf"), limit=most - 2.0 * far),
        ),
        ("imu", "imu_mounting", Fault(turned=turn)),
        ("imu", "imu_delay", Fault(imu_late_s=0.010 + 0.010 * far)),
        (foot, "foot_slip", Fault(foot, slippery=0.12 - 0.06 * far)),
        (joint, "joint_order", Fault(joint.replace("thigh", "hip").replace("calf", "hip"))),
    )
    place, effect, fault = drawn[kind % len(drawn)]
    if effect == "joint_order":
        other = f"{str(fault.place)[0]}{'R' if str(fault.place)[1] == 'L' else 'L'}{str(fault.place)[2:]}"
        return Case(replace(fault, swapped=other), (effect,), (str(fault.place), other))
    return Case(fault, (effect, "command_delay")[: 1 + (effect == "command_jitter")], (fault.place or place,))


class Trot:
    """A trot in place with feet that wander, which levels the trunk as a policy would."""

    feet = tuple(f"{leg}_calf" for leg in _LEGS)
    friction, lowest = 0.6, 0.15

    def __init__(self, robot: Robot, seconds: float, rng: np.random.Generator):
        self.robot, self.kp, self.kd = robot, np.full(12, 40.0), np.full(12, 1.0)
        self.time = np.arange(0.0, seconds, 1.0 / POLICY_HZ)
        knots = rng.standard_normal((4, max(4, int(seconds)) + 3))
        self.wander = np.tanh([np.interp(self.time, np.arange(row.size), row) for row in knots])
        self.phase = np.cumsum((2.0 + 0.25 * self.wander[3]) / POLICY_HZ)
        self.ticks = len(self.time)
        standing = self.command(0, np.eye(3), np.zeros(3), np.zeros(12))
        self.start = np.concatenate([[0.0, 0.0, 0.31, 1.0, 0.0, 0.0, 0.0], standing])

    def command(self, tick: int, turned: Array, spin: Array, told: Array) -> Array:
        """Positions ``(12,)`` of a tick, from the turning of the trunk."""
        up = turned[2]
        height, forth, aside, _ = self.wander[:, tick]
        amplitude = min(max(self.time[tick] - 0.5, 0.0), 1.0)
        pitch, roll = -up[0] + 0.05 * spin[1], up[1] + 0.05 * spin[0]
        angles = np.zeros((4, 3))
        for leg, name in enumerate(_LEGS):
            own = (self.phase[tick] + (0.0 if name in ("FL", "RR") else 0.5)) % 1.0
            swing = own < 0.45
            along = -np.cos(np.pi * own / 0.45) if swing else np.cos(np.pi * (own - 0.45) / 0.55)
            lift = 0.06 * amplitude * np.sin(np.pi * own / 0.45) ** 2 if swing else 0.0
            x = (0.03 * forth * along + 0.01 * aside) * amplitude - 0.02
            z = 0.28 + 0.015 * height * amplitude - lift
            z += 0.19 * pitch * (1 if name[0] == "F" else -1) - 0.12 * roll * (1 if name[1] == "L" else -1)
            length = min(np.hypot(x, z), 0.4)
            bend = np.arccos(length / (2.0 * _THIGH))
            angles[leg] = 0.04 * aside * amplitude * along, bend + np.arctan2(-x, z), -2.0 * bend
        return angles.ravel()


def trot(
    faults: tuple[Fault, ...] = (), *, seconds: float = 20.0, seed: int = 0, robot: Robot | None = None
) -> Log:
    """The log of a trot (:func:`benchmarks.walking.servos.walk`)."""
    rng = np.random.default_rng(seed)
    return walk(Trot(robot or excite.load_robot("go2"), seconds, rng), faults, rng)
