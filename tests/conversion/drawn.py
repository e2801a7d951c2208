"""Drawn recordings of arms, with columns called as projects call theirs, shuffled, in any unit, with one turned torque.

It shares no code with what understands them: torques are pinocchio's of a model with other masses, plus friction and
noise; names are written out as drivers, middleware, vendors' loggers and people's scripts write them.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

import excite

ROBOTS = ("ur10", "panda", "iiwa14", "jaco2")
# Names of positions, velocities, torques and commands; {n} counts from 1, {z} from 0, {j} is the joint's own name.
STYLES = (
    ("q{n}", "dq{n}", "tau{n}", "q_des{n}"),
    ("q_{z}", "qd_{z}", "tau_{z}", "q_d_{z}"),
    ("actual_q_{z}", "actual_qd_{z}", "actual_torque_{z}", "target_q_{z}"),
    ("q[{z}]", "dq[{z}]", "tau_J[{z}]", "q_d[{z}]"),
    ("position.{j}", "velocity.{j}", "effort.{j}", "command.{j}"),
    ("{j}_pos", "{j}_vel", "{j}_torque", "{j}_cmd"),
    ("{j}/position", "{j}/velocity", "{j}/effort", "{j}/position_command"),
    ("/joint_states/{j}/position", "/joint_states/{j}/velocity", "/joint_states/{j}/effort", "/cmd/{j}/position"),
    ("joint_{n}_position", "joint_{n}_velocity", "joint_{n}_torque", "joint_{n}_position_setpoint"),
    ("Joint{n}Position", "Joint{n}Velocity", "Joint{n}Torque", "Joint{n}TargetPosition"),
    ("jointPos{n}", "jointVel{n}", "jointTrq{n}", "jointPosRef{n}"),
    ("theta_{n}", "theta_dot_{n}", "torque_{n}", "theta_ref_{n}"),
    ("theta{n}", "omega{n}", "T{n}", "theta{n}_d"),
    ("pos_{z}", "vel_{z}", "eff_{z}", "goal_pos_{z}"),
    ("J{n}_angle", "J{n}_speed", "J{n}_torque", "J{n}_angle_cmd"),
    ("AxisAct_A{n}", "AxisVel_A{n}", "TorqueAxisAct_A{n}", "AxisCmd_A{n}"),
    ("MeasJntPos_{n}", "MeasJntVel_{n}", "MeasJntTrq_{n}", "CmdJntPos_{n}"),
    ("state.q.{z}", "state.dq.{z}", "state.tau.{z}", "cmd.q.{z}"),
    ("m{n}_pos", "m{n}_vel", "m{n}_tau", "m{n}_pos_ref"),
    ("dof_pos_{z}", "dof_vel_{z}", "dof_torque_{z}", "des_dof_pos_{z}"),
    ("qpos_{z}", "qvel_{z}", "qfrc_actuator_{z}", "ctrl_{z}"),
    ("measured_position_{n}", "measured_velocity_{n}", "measured_torque_{n}", "desired_position_{n}"),
    ("ang{n}", "angvel{n}", "trq{n}", "angcmd{n}"),
    ("p{n}", "v{n}", "t{n}", "pc{n}"),
    ("robot0_joint{n}_pos", "robot0_joint{n}_vel", "robot0_joint{n}_eff", "robot0_joint{n}_target"),
    ("axis{n}.ActPos", "axis{n}.ActVelo", "axis{n}.ActTorque", "axis{n}.SetPos"),
    ("jt{n}_enc", "jt{n}_spd", "jt{n}_tq", "jt{n}_enc_ref"),
    ("present_position_{n}", "present_velocity_{n}", "present_torque_{n}", "goal_position_{n}"),
    ("observation.state.{j}.pos", "observation.state.{j}.vel", "observation.effort.{j}", "action.{j}.pos"),
    ("winkel_{n}", "geschwindigkeit_{n}", "drehmoment_{n}", "soll_winkel_{n}"),
)  # fmt: skip
CLOCKS = (
    "time",
    "t",
    "timestamp",
    "Time",
    "stamp",
    "t_rel",
    "timestamp_sec0",
    "clock",
    "zeit",
    "ros_time",
    "secs",
)
DISTRACTORS = (
    "temperature_{n}",
    "position_error_{n}",
    "tau_ext_{n}",
    "tcp_x",
    "tcp_y",
    "status",
    "motor_temp_{n}",
    "seq",
)
TICKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclass(frozen=True)
class Drawn:
    """A recording and the truth about it.

    Attributes:
        file: the CSV.
        robot: whose it is.
        columns: by channel of the log, the column that holds it.
        factors: by channel, factor to SI.
        turned: joint whose torque has its sign turned, empty for none.
    """

    file: Path
    robot: str
    columns: dict[str, str]
    factors: dict[str, float]
    turned: str


def draw(seed: int, folder: Path) -> Drawn:
    """The recording of a seed."""
    rng = np.random.default_rng([2026, seed])
    name = ROBOTS[rng.integers(len(ROBOTS))]
    robot = excite.load_robot(name)
    time, q, v, tau = _motion(robot, rng)
    n = q.shape[1]
    style = STYLES[rng.integers(len(STYLES))]
    degrees = rng.random() < 0.6
    clock = rng.choice(["s", "ms", "ms", "us", "ns"])
    turned = int(rng.integers(n)) if rng.random() < 0.8 else -1
    if turned >= 0:
        tau[:, turned] *= -1.0
    angle = np.pi / 180.0 if degrees else 1.0
    late = 0.004 + 0.02 * rng.random()
    command = np.column_stack([np.interp(time + late, time, column) for column in q.T])
    q = q + 2e-5 * rng.standard_normal(q.shape)
    v = v + 2e-3 * rng.standard_normal(v.shape)
    table: dict[str, np.ndarray] = {}
    columns, factors = {}, {"time": TICKS[clock], "q": angle, "v": angle, "tau": 1.0, "q_cmd": angle}
    table[str(rng.choice(CLOCKS))] = (time + (1.7e9 if rng.random() < 0.3 else 0.0)) / TICKS[clock]
    columns["time"] = next(iter(table))
    kinds = ["q", "tau"] + (["v"] if rng.random() < 0.7 else []) + (["q_cmd"] if rng.random() < 0.5 else [])
    values = {"q": q / angle, "v": v / angle, "tau": tau, "q_cmd": command / angle}
    for kind in kinds:
        pattern = style[("q", "v", "tau", "q_cmd").index(kind)]
        for k in range(n):
            column = pattern.format(n=k + 1, z=k, j=robot.joint_names[k])
            table[column] = values[kind][:, k]
            columns[f"{kind}.{robot.joint_names[k]}"] = column
    for pattern in rng.choice(DISTRACTORS, size=rng.integers(0, 4), replace=False):
        table |= {pattern.format(n=k + 1): _distractor(str(pattern), k, len(time), rng) for k in range(n)}
    file = folder / f"drawn_{seed:03d}.csv"
    _write(file, table, rng)
    return Drawn(file, name, columns, factors, robot.joint_names[turned] if turned >= 0 else "")


def _distractor(pattern: str, k: int, n: int, rng: np.random.Generator) -> np.ndarray:
    if "temp" in pattern:
        return 35.0 + k + np.linspace(0.0, 2.0, n) + 0.05 * rng.standard_normal(n)
    if pattern in ("status", "seq"):
        return np.arange(n) if pattern == "seq" else np.full(n, 7)
    return 0.01 * np.convolve(rng.standard_normal(n), np.ones(20) / 20, mode="same")


def _motion(robot: excite.Robot, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """A Fourier motion within the joints' ranges, and the torques of a machine with other masses and friction."""
    rate = float(rng.choice([100, 125, 200, 250, 500]))
    time = np.arange(0.0, 20.0, 1.0 / rate)
    n = robot.n_joints
    low, high = (
        np.maximum(robot.limits.position_lower, -np.pi),
        np.minimum(robot.limits.position_upper, np.pi),
    )
    q, v, a = np.zeros((len(time), n)), np.zeros((len(time), n)), np.zeros((len(time), n))
    for k in range(n):
        for harmonic in range(1, 6):
            w = 2.0 * np.pi * 0.1 * harmonic
            sine, cosine = rng.standard_normal(2) / harmonic
            q[:, k] += sine * np.sin(w * time) + cosine * np.cos(w * time)
            v[:, k] += w * (sine * np.cos(w * time) - cosine * np.sin(w * time))
            a[:, k] -= w**2 * (sine * np.sin(w * time) + cosine * np.cos(w * time))
        size = rng.uniform(0.4, 0.8) * (high[k] - low[k]) / np.ptp(q[:, k])
        size = min(size, 1.8 / np.abs(v[:, k]).max())
        middle = q[:, k].min() + 0.5 * np.ptp(q[:, k])
        q[:, k] = size * (q[:, k] - middle) + 0.5 * (low[k] + high[k])
        v[:, k], a[:, k] = size * v[:, k], size * a[:, k]
    model = robot.model.copy()
    for k in range(1, model.njoints):
        model.inertias[k] = pin.Inertia(
            model.inertias[k].mass * rng.uniform(0.8, 1.25),
            model.inertias[k].lever,
            model.inertias[k].inertia,
        )
    data = model.createData()
    tau = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
    size = tau.std(axis=0)
    coulomb, viscous = rng.uniform(0.05, 0.3, n) * size, rng.uniform(0.05, 0.2, n) * size
    tau += coulomb * np.tanh(v / 0.01) + viscous * v + 0.03 * size * rng.standard_normal(tau.shape)
    return time, q, v, tau


def _write(file: Path, table: dict[str, np.ndarray], rng: np.random.Generator) -> None:
    names = list(table)
    rng.shuffle(names)
    separator, decimal = ((",", "."), (";", "."), (";", ","), ("\t", "."), (" ", "."))[rng.integers(5)]
    with file.open("w", newline="") as stream:
        if rng.random() < 0.3:
            stream.write("# recorded in the lab\n")
        writer = csv.writer(stream, delimiter=separator)
        writer.writerow(names)
        for row in zip(*(table[name] for name in names), strict=True):
            writer.writerow(
                [f"{value:.9g}" if abs(value) < 1e8 else f"{value:.6f}" for value in row]
                if decimal == "."
                else [
                    f"{value:.9g}".replace(".", ",") if abs(value) < 1e8 else f"{value:.6f}".replace(".", ",")
                    for value in row
                ]
            )
