"""A Go2 that trots in MuJoCo under soft servos at its joints, as a policy has them, with drives that are not as told.

Shares no code with what diagnoses: the servo's law, its faults and the sensors are written here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

import excite
from excite.arrays import Array
from excite.logs.header_blocks import TrialHeader
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
    """What one drive, or all (``joint`` None), differs in.

    Attributes:
        joint: its joint.
        strength: delivered torque over the estimated one.
        stiffness: applied stiffness over the stated one.
        late_s: delay of the commands.
        zero: true less logged position [rad].
        dry: dry friction more than nominal [N·m].
        viscous: viscous friction more than nominal [N·m·s/rad].
    """

    joint: str | None = None
    strength: float = 1.0
    stiffness: float = 1.0
    late_s: float = 0.0
    zero: float = 0.0
    dry: float = 0.0
    viscous: float = 0.0


def draw_fault(seed: int) -> tuple[Fault, str]:
    """A fault of one drive, of random kind, place and size, and the name that it has in a diagnosis."""
    rng = np.random.default_rng(seed)
    joint = f"{rng.choice(_LEGS)}_{rng.choice(['hip', 'thigh', 'calf'])}_joint"
    far = rng.uniform(0.0, 1.0)
    drawn = {
        "torque_gain": Fault(joint, strength=0.85 - 0.2 * far),
        "servo_gain": Fault(joint, stiffness=0.85 - 0.2 * far),
        "command_delay": Fault(joint, late_s=0.010 + 0.015 * far),
        "encoder_offset": Fault(joint, zero=(0.04 + 0.04 * far) * rng.choice([-1, 1])),
        "coulomb_friction": Fault(joint, dry=0.4 + 0.6 * far),
        "viscous_friction": Fault(joint, viscous=0.15 + 0.25 * far),
    }
    name = list(drawn)[seed % len(drawn)]
    return drawn[name], name


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
    each = [[f for f in faults if f.joint in (None, joint)] for joint in joints]
    strength = np.array([np.prod([f.strength for f in one]) for one in each])
    stiffness = np.array([np.prod([f.stiffness for f in one]) for one in each])
    late = np.array([round(sum(f.late_s for f in one) / _STEP_S) for one in each])
    zero = np.array([sum(f.zero for f in one) for one in each])
    model.dof_damping[6:] += [sum(f.viscous for f in one) for one in each]
    model.dof_frictionloss[6:] += [sum(f.dry for f in one) for one in each]
    model.actuator_gainprm[:, 0], model.actuator_biasprm[:] = 1.0, 0.0
    names = [model.joint(i + 1).name for i in range(12)]
    order = [joints.index(name) for name in names]
    assert order == list(range(12))
    gait, tick = _Gait(seconds, rng), round(1.0 / POLICY_HZ / _STEP_S)
    sent = np.zeros((len(gait.time) * tick, 12))
    first = gait.command(0, np.array([0.0, 0.0, 1.0]), np.zeros(3))
    matrix = np.zeros(9)
    data = mujoco.MjData(model)
    data.qpos[:3], data.qpos[3:7], data.qpos[7:] = (0.0, 0.0, 0.31), (1.0, 0.0, 0.0, 0.0), first + zero
    rows: dict[str, list[Any]] = {name: [] for name in ("q", "v", "cmd", "tau", "imu", "feet")}
    every = round(1.0 / RATE_HZ / _STEP_S)
    bodies = [model.body(f"{leg}_calf").id for leg in _LEGS]
    limit = drives.torque_limit
    for k in range(len(sent)):
        told = data.qpos[7:] - zero
        if k % tick == 0:
            mujoco.mju_quat2Mat(matrix, data.qpos[3:7])
            sent[k : k + tick] = gait.command(k // tick, matrix[6:].copy(), data.qvel[3:6])
        asked = sent[np.maximum(k - late, 0), np.arange(12)]
        torque = np.clip(stiffness * KP * (asked - told) - KD * data.qvel[6:], -limit, limit)
        data.ctrl[:] = strength * torque
        before = data.qvel.copy()
        placed, turned = told.copy(), data.qpos[3:7].copy()
        mujoco.mj_step(model, data)
        if k % every:
            continue
        spin = data.qvel[3:6].copy()
        mujoco.mju_quat2Mat(matrix, turned)
        linear = matrix.reshape(3, 3).T @ ((data.qvel[:3] - before[:3]) / _STEP_S + [0.0, 0.0, 9.81])
        force = np.zeros((4, 6))
        for i in range(data.ncon):
            one = data.contact[i]
            foot = [b for b in model.geom_bodyid[[one.geom1, one.geom2]] if b in bodies]
            if foot:
                wrench = np.zeros(6)
                mujoco.mj_contactForce(model, data, i, wrench)
                force[bodies.index(foot[0])] += wrench
        for name, value in zip(
            rows, (placed, before[6:], sent[k], torque, np.r_[spin, linear], force[:, 0] > 2.0), strict=True
        ):
            rows[name].append(value)
        if data.qpos[2] < 0.15:
            raise AssertionError("the robot fell")
    told = {name: np.array(values) for name, values in rows.items()}
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
    for name, role, part in (
        ("learn", "identification", slice(begun, cut)),
        ("judge", "validation", slice(cut, n)),
    ):
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
                contacts={leg: told["feet"][part, i] for i, leg in enumerate(_LEGS)},
            )
        )
    entries = tuple(TrialHeader(file=f"{t.name}.parquet", role=t.role) for t in trials)
    header = log_header(robot, entries).model_copy(
        update={
            "controller": {"mode": "position", "kp": KP, "kd": KD, "feedforward": "none"},
            "modelled": ("rigid_body_fixed", "viscous_friction", "coulomb_friction", "armature"),
            "rate_hz": RATE_HZ,
        }
    )
    return Log(header=header, trials=tuple(trials), robot_text=None)


def main() -> None:
    """Draw faults, diagnose their logs, and print how many are named rightly."""
    robot, right, wrong = excite.load_robot("go2"), 0, 0
    seeds = range(100, 112)
    for seed in seeds:
        fault, name = draw_fault(seed)
        found = excite.diagnose(trot((fault,), seconds=13.0, seed=seed - 100), robot)
        named = (found.effect, found.location) == (name, fault.joint)
        right, wrong = right + named, wrong + (found.verdict == "effect" and not named)
        print(f"{seed} {name} {fault.joint}: {found.verdict} {found.effect} {found.location}")
    print(f"{right} of {len(seeds)} right, {wrong} firm and wrong")


if __name__ == "__main__":
    main()
