"""A Go2 that trots in MuJoCo under soft servos at its joints, as a policy has them, with drives that are not as told.

Shares no code with what diagnoses: the servo's law, its faults and the sensors are written here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import excite
from excite.arrays import Array
from excite.logs.header_blocks import Role, TrialHeader
from excite.logs.log import Log, Trial
from excite.robot.robot import Robot
from excite.simulation.mjcf import World, build_spec
from excite.simulation.sensing import log_header
from excite.simulation.true_parameters import nominal_drives

KP, KD, POLICY_HZ, RATE_HZ = 40.0, 1.0, 50, 500
_LEGS = ("FL", "FR", "RL", "RR")
_STEP_S, _THIGH = 0.001, 0.213


@dataclass(frozen=True)
class Fault:
    """What one drive, one foot, the IMU or all of the commands (``place`` None) differ in.

    Attributes:
        place: joint or foot.
        strength: delivered torque over the estimated one.
        stiffness: applied stiffness over the stated one.
        damping: applied damping over the stated one.
        late_s: delay of the commands.
        jitter_s: deviation of the delay of each tick's commands, the same for all drives.
        zero: true less logged position [rad].
        dry: dry friction more than nominal [N·m].
        viscous: viscous friction more than nominal [N·m·s/rad].
        limit: largest torque of the drive [N·m].
        ahead: position that the drive adds to the logged command [rad]: another default pose.
        scale: motion of the drive's command about the default pose over that of the logged one.
        swapped: joint whose command the drive follows, and which follows the command of this one.
        turned: rotation vector from the frame that the IMU is said to have to the one it has [rad].
        imu_late_s: delay of the IMU.
        slippery: friction of the foot over the nominal one.
    """

    place: str | None = None
    strength: float = 1.0
    stiffness: float = 1.0
    damping: float = 1.0
    late_s: float = 0.0
    jitter_s: float = 0.0
    zero: float = 0.0
    dry: float = 0.0
    viscous: float = 0.0
    limit: float = np.inf
    ahead: float = 0.0
    scale: float = 1.0
    swapped: str | None = None
    turned: tuple[float, float, float] = (0.0, 0.0, 0.0)
    imu_late_s: float = 0.0
    slippery: float = 1.0


class Fallen(Exception):
    """The robot fell."""


@dataclass(frozen=True)
class Case:
    """A fault, and how a diagnosis may call it.

    Attributes:
        fault: the fault.
        effects: names, the first one its own; a jitter also makes commands late.
        places: joints, feet, ``command`` or ``imu``; of two joints that are exchanged both.
    """

    fault: Fault
    effects: tuple[str, ...]
    places: tuple[str, ...]

    @property
    def size(self) -> str:
        """What was drawn, as text."""
        nothing = Fault()
        drawn = {name: value for name, value in vars(self.fault).items() if value != getattr(nothing, name)}
        return " ".join(
            f"{value:.3g}" if isinstance(value, float) else " ".join(f"{x:.3g}" for x in value)
            for name, value in drawn.items()
            if name not in ("place", "swapped")
        )


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


class _Gait:
    """Joint positions of a trot in place with feet that wander, which levels the trunk as a policy would."""

    def __init__(self, seconds: float, rng: np.random.Generator):
        self.time = np.arange(0.0, seconds, 1.0 / POLICY_HZ)
        knots = rng.standard_normal((4, max(4, int(seconds)) + 3))
        self.wander = np.tanh([np.interp(self.time, np.arange(row.size), row) for row in knots])
        self.phase = np.cumsum((2.0 + 0.25 * self.wander[3]) / POLICY_HZ)

    def command(self, tick: int, up: Array, spin: Array) -> Array:
        """Positions ``(12,)`` of a tick, from the world's vertical and the turning in the trunk's frame."""
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


def _arrivals(late: Array, jitter_s: float, n: int, rng: np.random.Generator) -> Array:
    """When a tick's command acts at each drive, ``(n + 1, 12)`` [s]; none overtakes another, one more never comes."""
    drawn = rng.uniform(0.0, np.sqrt(12.0) * jitter_s, n) if jitter_s else np.zeros(n)
    due = np.maximum.accumulate(np.arange(n) / POLICY_HZ + drawn)
    due[0] = -1.0
    return np.vstack([due[:, None] + late, np.full((1, len(late)), np.inf)])


def _seen_by_imu(readings: Array, faults: tuple[Fault, ...]) -> Array:
    """Readings ``(n, 6)`` of an IMU that sits turned, and tells them late."""
    for one in faults:
        turn = Rotation.from_rotvec(one.turned).as_matrix()
        readings = np.hstack([readings[:, :3] @ turn, readings[:, 3:] @ turn])
        readings = readings[np.maximum(np.arange(len(readings)) - round(one.imu_late_s * RATE_HZ), 0)]
    return readings


def trot(
    faults: tuple[Fault, ...] = (), *, seconds: float = 20.0, seed: int = 0, robot: Robot | None = None
) -> Log:
    """The log of a trot: positions, commands, estimated torques, IMU and contact flags; the last third judges."""
    rng = np.random.default_rng(seed)
    robot = robot or excite.load_robot("go2")
    joints = robot.joint_names
    drives = nominal_drives(robot)
    spec = build_spec(robot, robot.nominal_parameters, drives, World(timestep=_STEP_S))
    model = spec.compile()
    each = [[f for f in faults if f.place in (None, joint)] for joint in joints]
    strength, stiffness, damping, scale = _of_drives(
        each, ("strength", "stiffness", "damping", "scale"), np.prod
    )
    late, zero, ahead, viscous, dry = _of_drives(each, ("late_s", "zero", "ahead", "viscous", "dry"), np.sum)
    model.dof_damping[6:] += viscous
    model.dof_frictionloss[6:] += dry
    _slip(model, faults)
    wired = np.arange(12)
    for one in faults:
        if one.swapped is not None:
            pair = [joints.index(str(one.place)), joints.index(one.swapped)]
            wired[pair] = pair[::-1]
    limit = np.minimum(drives.torque_limit, [min((f.limit for f in one), default=np.inf) for one in each])
    model.actuator_gainprm[:, 0], model.actuator_biasprm[:] = 1.0, 0.0
    gait, tick = _Gait(seconds, rng), round(1.0 / POLICY_HZ / _STEP_S)
    sent = np.zeros((len(gait.time) * tick, 12))
    arrives = _arrivals(late, sum(f.jitter_s for f in faults), len(gait.time), rng)
    first = gait.command(0, np.array([0.0, 0.0, 1.0]), np.zeros(3))
    matrix = np.zeros(9)
    data = mujoco.MjData(model)
    data.qpos[:3], data.qpos[3:7], data.qpos[7:] = (0.0, 0.0, 0.31), (1.0, 0.0, 0.0, 0.0), first + zero
    heard = np.zeros(12, dtype=int)
    rows: dict[str, list[Any]] = {name: [] for name in ("q", "v", "cmd", "tau", "imu", "feet")}
    every = round(1.0 / RATE_HZ / _STEP_S)
    bodies = [model.body(f"{leg}_calf").id for leg in _LEGS]
    for k in range(len(sent)):
        told = data.qpos[7:] - zero
        if k % tick == 0:
            mujoco.mju_quat2Mat(matrix, data.qpos[3:7])
            sent[k : k + tick] = gait.command(k // tick, matrix[6:].copy(), data.qvel[3:6])
        heard += arrives[heard + 1, np.arange(12)] <= k * _STEP_S + 1e-9
        asked = sent[heard * tick, wired]
        asked = first + ahead + scale * (asked - first)
        torque = np.clip(stiffness * KP * (asked - told) - damping * KD * data.qvel[6:], -limit, limit)
        data.ctrl[:] = strength * torque
        before = data.qvel.copy()
        placed, turned = told.copy(), data.qpos[3:7].copy()
        mujoco.mj_step(model, data)
        if k % every:
            continue
        spin = data.qvel[3:6].copy()
        mujoco.mju_quat2Mat(matrix, turned)
        linear = matrix.reshape(3, 3).T @ ((data.qvel[:3] - before[:3]) / _STEP_S + [0.0, 0.0, 9.81])
        feet = _pressed(model, data, bodies) > 2.0
        for name, value in zip(
            rows, (placed, before[6:], sent[k], torque, np.r_[spin, linear], feet), strict=True
        ):
            rows[name].append(value)
        if data.qpos[2] < 0.15:
            raise Fallen
    told = {name: np.array(values) for name, values in rows.items()}
    told["imu"] = _seen_by_imu(told["imu"], faults)
    return _logged(robot, told, rng)


def _of_drives(each: list[list[Fault]], names: tuple[str, ...], joined: Any) -> list[Array]:
    """Numbers of each drive's faults, joined, ``(12,)`` by name."""
    return [np.array([joined([getattr(f, name) for f in one]) for one in each]) for name in names]


def _slip(model: mujoco.MjModel, faults: tuple[Fault, ...]) -> None:
    """Take friction from feet; of two geometries that touch the one of greater priority tells."""
    for one in faults:
        if one.place in _LEGS:
            own = model.geom_bodyid == model.body(f"{one.place}_calf").id
            model.geom_priority[own], model.geom_friction[own, 0] = 1, 0.6 * one.slippery


def _pressed(model: mujoco.MjModel, data: mujoco.MjData, bodies: list[int]) -> Array:
    """Normal forces on bodies ``(n,)`` [N]."""
    force = np.zeros(len(bodies))
    for i in range(data.ncon):
        one = data.contact[i]
        for body in set(model.geom_bodyid[[one.geom1, one.geom2]]) & set(bodies):
            wrench = np.zeros(6)
            mujoco.mj_contactForce(model, data, i, wrench)
            force[bodies.index(body)] += wrench[0]
    return force


def _logged(robot: Robot, told: dict[str, Array], rng: np.random.Generator) -> Log:
    """What was told, with the sensors' noise, the last third to judge by."""
    n = len(told["q"])
    noise = rng.standard_normal
    told["q"] = told["q"] + 1e-4 * noise((n, 12))
    told["v"] = told["v"] + 0.02 * noise((n, 12))
    told["tau"] = told["tau"] + 0.1 * noise((n, 12))
    told["imu"] = told["imu"] + np.r_[np.full(3, 3e-3), np.full(3, 0.03)] * noise((n, 6))
    begun = RATE_HZ  # it stood till then
    cut = begun + 2 * (n - begun) // 3
    time = np.arange(n) / RATE_HZ
    trials = []
    parts: tuple[tuple[str, Role, slice], ...] = (
        ("learn", "identification", slice(begun, cut)),
        ("judge", "validation", slice(cut, n)),
    )
    for name, role, part in parts:
        trials.append(
            Trial(
                name=name,
                role=role,
                time=time[part] - time[part][0],
                q=told["q"][part],
                v=told["v"][part],
                tau=told["tau"][part],
                q_cmd=told["cmd"][part],
                imu=told["imu"][part],
                contacts={leg: told["feet"][part, i] > 0.5 for i, leg in enumerate(_LEGS)},
            )
        )
    entries = tuple(TrialHeader(file=f"{name}.parquet", role=role) for name, role, _ in parts)
    header = log_header(robot, entries).model_copy(
        update={
            "controller": {"mode": "position", "kp": KP, "kd": KD, "feedforward": "none"},
            "modelled": ("rigid_body_fixed", "viscous_friction", "coulomb_friction", "armature"),
            "rate_hz": RATE_HZ,
        }
    )
    return Log(header=header, trials=tuple(trials), robot_text=None)
