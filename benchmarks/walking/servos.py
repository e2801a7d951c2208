"""A robot that walks in MuJoCo under soft servos at its joints, as a policy has them, with drives that are not as told.

Shares no code with what diagnoses: the servo's law, its faults and the sensors are written here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.logs.header_blocks import Role, TrialHeader
from excite.logs.log import Log, Trial
from excite.robot.robot import Robot
from excite.simulation.mjcf import World, build_spec
from excite.simulation.sensing import log_header
from excite.simulation.true_parameters import nominal_drives

POLICY_HZ, RATE_HZ = 50, 500
_STEP_S = 0.001


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


class Gait(Protocol):
    """What a policy would have the joints do.

    Attributes:
        robot: nominal model.
        kp: stiffness of each drive's servo [N·m/rad].
        kd: its damping [N·m·s/rad].
        start: configuration at the beginning, base's quaternion w first.
        feet: body of each foot, in the order of the robot's feet.
        friction: of the feet on the ground.
        lowest: height of the base below which the robot has fallen [m].
        ticks: number of commands.
    """

    robot: Robot
    kp: Array
    kd: Array
    start: Array
    feet: tuple[str, ...]
    friction: float
    lowest: float
    ticks: int

    def command(self, tick: int, turned: Array, spin: Array, told: Array) -> Array:
        """Positions that are commanded at a tick.

        Args:
            tick: its number.
            turned: rotation of the trunk, ``(3, 3)``.
            spin: its angular velocity in its own frame [rad/s].
            told: positions that encoders tell [rad].
        """


def _arrivals(late: Array, jitter_s: float, n: int, rng: np.random.Generator) -> Array:
    """When a tick's command acts, ``(n + 1, n_joints)`` [s]; none overtakes another, one more never comes."""
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


def walk(gait: Gait, faults: tuple[Fault, ...], rng: np.random.Generator) -> Log:
    """The log of a walk: positions, commands, estimated torques, IMU and contact flags; the last third judges.

    Raises:
        Fallen: the robot fell.
    """
    robot, kp, kd = gait.robot, gait.kp, gait.kd
    joints, count = robot.joint_names, robot.n_joints
    drives = nominal_drives(robot)
    model = build_spec(robot, robot.nominal_parameters, drives, World(timestep=_STEP_S)).compile()
    each = [[f for f in faults if f.place in (None, joint)] for joint in joints]
    strength, stiffness, damping, scale = _of_drives(
        each, ("strength", "stiffness", "damping", "scale"), np.prod
    )
    late, zero, ahead, viscous, dry = _of_drives(each, ("late_s", "zero", "ahead", "viscous", "dry"), np.sum)
    model.dof_damping[6:] += viscous
    model.dof_frictionloss[6:] += dry
    _slip(model, gait, faults)
    wired = np.arange(count)
    for one in faults:
        if one.swapped is not None:
            pair = [joints.index(str(one.place)), joints.index(one.swapped)]
            wired[pair] = pair[::-1]
    limit = np.minimum(drives.torque_limit, [min((f.limit for f in one), default=np.inf) for one in each])
    model.actuator_gainprm[:, 0], model.actuator_biasprm[:] = 1.0, 0.0
    tick = round(1.0 / POLICY_HZ / _STEP_S)
    sent = np.zeros((gait.ticks * tick, count))
    arrives = _arrivals(late, sum(f.jitter_s for f in faults), gait.ticks, rng)
    data, matrix = mujoco.MjData(model), np.zeros(9)
    data.qpos[:] = gait.start
    first = gait.start[7:].copy()
    data.qpos[7:] += zero
    heard = np.zeros(count, dtype=int)
    rows: dict[str, list[Any]] = {name: [] for name in ("q", "v", "cmd", "tau", "imu", "feet")}
    every = round(1.0 / RATE_HZ / _STEP_S)
    bodies = [model.body(name).id for name in gait.feet]
    for k in range(len(sent)):
        told = data.qpos[7:] - zero
        if k % tick == 0:
            mujoco.mju_quat2Mat(matrix, data.qpos[3:7])
            sent[k : k + tick] = gait.command(k // tick, matrix.reshape(3, 3), data.qvel[3:6], told)
        heard += arrives[heard + 1, np.arange(count)] <= k * _STEP_S + 1e-9
        asked = sent[heard * tick, wired]
        asked = first + ahead + scale * (asked - first)
        torque = np.clip(stiffness * kp * (asked - told) - damping * kd * data.qvel[6:], -limit, limit)
        data.ctrl[:] = strength * torque
        before = data.qvel.copy()
        placed, turned = told.copy(), data.qpos[3:7].copy()
        mujoco.mj_step(model, data)
        spin = data.qvel[3:6].copy()
        mujoco.mju_quat2Mat(matrix, turned)
        linear = matrix.reshape(3, 3).T @ ((data.qvel[:3] - before[:3]) / _STEP_S + [0.0, 0.0, 9.81])
        feet = _pressed(model, data, bodies) > 2.0
        for name, value in zip(
            rows, (placed, before[6:], sent[k], torque, np.r_[spin, linear], feet), strict=True
        ):
            rows[name].append(value)
        if data.qpos[2] < gait.lowest:
            raise Fallen
    # Sensors average over the time between two samples; commands and contacts are as they are at its end.
    steps = {name: np.array(values).reshape(-1, every, len(values[0])) for name, values in rows.items()}
    told = {name: x[:, -1] if name in ("cmd", "feet") else x.mean(axis=1) for name, x in steps.items()}
    told["imu"] = _seen_by_imu(told["imu"], faults)
    return _logged(gait, told, rng)


def _of_drives(each: list[list[Fault]], names: tuple[str, ...], joined: Any) -> list[Array]:
    """Numbers of each drive's faults, joined, ``(n_joints,)`` by name."""
    return [np.array([joined([getattr(f, name) for f in one]) for one in each]) for name in names]


def _slip(model: mujoco.MjModel, gait: Gait, faults: tuple[Fault, ...]) -> None:
    """Take friction from feet; of two geometries that touch the one of greater priority tells."""
    names = [foot.name for foot in gait.robot.feet]
    for one in faults:
        if one.place in names:
            own = model.geom_bodyid == model.body(gait.feet[names.index(one.place)]).id
            model.geom_priority[own], model.geom_friction[own, 0] = 2, gait.friction * one.slippery


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


def _logged(gait: Gait, told: dict[str, Array], rng: np.random.Generator) -> Log:
    """What was told, with the sensors' noise, the last third to judge by."""
    robot, n = gait.robot, len(told["q"])
    noise = rng.standard_normal
    told["q"] = told["q"] + 1e-4 * noise(told["q"].shape)
    told["v"] = told["v"] + 0.02 * noise(told["q"].shape)
    told["tau"] = told["tau"] + 0.1 * noise(told["q"].shape)
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
                contacts={foot.name: told["feet"][part, i] > 0.5 for i, foot in enumerate(robot.feet)},
            )
        )
    entries = tuple(TrialHeader(file=f"{name}.parquet", role=role) for name, role, _ in parts)
    header = log_header(robot, entries).model_copy(
        update={
            "controller": {
                "mode": "position",
                "kp": gait.kp.tolist(),
                "kd": gait.kd.tolist(),
                "feedforward": "none",
            },
            "modelled": ("rigid_body_fixed", "viscous_friction", "coulomb_friction", "armature"),
            "rate_hz": RATE_HZ,
        }
    )
    return Log(header=header, trials=tuple(trials), robot_text=None)
