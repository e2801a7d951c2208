"""Drawn records of a coupled wrist, a parallel ankle and a four-bar arm, each with one effect that its model lacks.

Nothing here is the package's: loops close by trigonometry, velocities come from splines, and what motors have to exert
from the balance of power of finite differences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import yaml
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from excite.logs.log import Log, LogHeader, Trial
from excite.robot.init_robot.files import write_scaffold
from excite.robot.load import load_robot
from excite.robot.robot import Robot
from tests.robot.mechanisms.test_transmissions import RODS, leg

RATE_HZ, FINE = 100, 10
STEP = 1e-6
# Over which speed dry friction changes sign [rad/s].
SIGN = 0.005


@dataclass(frozen=True)
class Machine:
    """A robot, and how its tree and its motors follow from the coordinates in which motions are drawn.

    Attributes:
        robot: the nominal robot.
        closed: of ``(n, n_free)`` coordinates: positions of the tree ``(n, nv)`` and of the motors ``(n, n_motors)``.
        motors: names of the motors.
        amplitude: of the motion in each coordinate [rad].
        followers: joints that no motor turns alone: the place's name in a diagnosis, and the column of the tree.
        load: index of the model's joint whose link gets a payload.
        coupling: what the log says of it.
    """

    robot: Robot
    closed: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    motors: tuple[str, ...]
    amplitude: np.ndarray
    followers: tuple[tuple[str, int], ...]
    load: int
    coupling: dict[str, dict[str, float]] = field(default_factory=dict)


def _link(name: str, mass: float, centre: str, radius: float = 0.08) -> str:
    size = 0.4 * mass * radius**2
    moments = f'<inertia ixx="{size}" ixy="0" ixz="0" iyy="{1.2 * size}" iyz="0" izz="{0.8 * size}"/>'
    return f'<link name="{name}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>{moments}</inertial></link>'


def _hinge(name: str, parent: str, child: str, origin: str, axis: str) -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{origin}"/><axis xyz="{axis}"/>'
    return (
        f'<joint name="{name}" type="revolute">{ends}'
        '<limit lower="-3" upper="3" velocity="10" effort="300"/></joint>'
    )


def wrist(folder: Path) -> Machine:
    """Six joints, of which motor 6 turns by the sum of joints 5 and 6, as a TX40's does."""
    axes = ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
    steps = ("0 0 .1", "0 .1 .1", "0 0 .25", "0 -.05 .1", "0 0 .15", "0 0 .07")
    masses, centres = (
        (7, 6, 4, 2, 1.5, 0.8),
        ("0 0 .1", "0 0 .12", ".01 0 .06", "0 .02 .08", "0 .01 .05", ".04 .01 .06"),
    )
    text = "<robot name='wrist'>" + _link("link_0", 5, "0 0 0")
    for k in range(6):
        text += _link(f"link_{k + 1}", masses[k], centres[k])
        text += _hinge(f"joint_{k + 1}", f"link_{k}", f"link_{k + 1}", steps[k], axes[k])
    (folder / "wrist.urdf").write_text(text + "</robot>")
    turns = np.eye(6)
    turns[5, 4] = 1.0
    names = tuple(f"joint_{k + 1}" for k in range(6))
    return Machine(
        load_robot(folder / "wrist.urdf"),
        lambda x: (x, x @ turns.T),
        names,
        np.array([1.0, 0.6, 0.8, 1.2, 1.0, 1.4]),
        (("joint_6.link", 5),),
        6,
        {"joint_6": {"joint_5": 1.0}},
    )


def ankle(folder: Path) -> Machine:
    """A knee, and an ankle that two motors pitch and roll over cranks and rods; drawn in pitch and roll."""
    robot = leg(folder, RODS)
    names = ("knee", "pitch", "roll", "A", "B")
    columns = [robot.joint_index(name) for name in names]

    def crank(side: float, pitch: np.ndarray, roll: np.ndarray) -> np.ndarray:
        axis, turns = (
            np.array([-0.01, side, -0.05]),
            Rotation.from_euler("y", pitch[:, None]) * Rotation.from_euler("x", roll[:, None]),
        )
        ball = np.array([0.0, 0.0, -0.3]) + turns.apply([-0.06, side, 0.01]) - axis
        rest = np.array([0.0, 0.0, -0.3]) + np.array([-0.06, side, 0.01]) - axis
        length = np.linalg.norm(rest - [-0.05, 0.0, 0.0])
        across = np.hypot(ball[:, 0], ball[:, 2])
        angle = np.arccos((length**2 - (ball**2).sum(axis=1) - 0.05**2) / (0.1 * across))
        return (-angle - np.arctan2(ball[:, 2], ball[:, 0]) + np.pi) % (2.0 * np.pi) - np.pi

    def closed(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        knee, pitch, roll = x.T
        a, b = crank(0.03, pitch, roll), crank(-0.03, pitch, roll)
        q = np.zeros((len(x), robot.model.nv))
        q[:, columns] = np.column_stack([knee, pitch, roll, a, b])
        return q, np.column_stack([knee, a, b])

    return Machine(
        robot,
        closed,
        ("knee", "A", "B"),
        np.array([0.6, 0.45, 0.35]),
        (("pitch", columns[1]), ("roll", columns[2])),
        robot.model.getJointId("roll"),
    )


def four_bar(folder: Path) -> Machine:
    """A column that turns, an upper arm, and a forearm that a motor on the column pulls over a crank and a rod."""
    text = (
        "<robot name='four_bar'>"
        + _link("base", 5, "0 0 0")
        + _link("column", 6, ".02 0 .1")
        + _link("upper", 4, ".01 .01 .2")
        + _link("forearm", 2.5, ".18 .01 .02", 0.12)
        + _link("crank", 0.8, "-.06 0 0")
        + _link("rod", 0.6, "0 0 .2")
        + _hinge("yaw", "base", "column", "0 0 .1", "0 0 1")
        + _hinge("shoulder", "column", "upper", "0 0 .2", "0 1 0")
        + _hinge("elbow", "upper", "forearm", "0 0 .4", "0 1 0")
        + _hinge("drive", "column", "crank", "0 0 .2", "0 1 0")
        + _hinge("coupler", "crank", "rod", "-.11 0 0", "0 1 0")
        + "</robot>"
    )
    (folder / "four_bar.urdf").write_text(text)
    loop = {
        "name": "linkage",
        "kind": "point",
        "ends": [{"link": "rod", "xyz": [-0.05, 0, 0.39]}, {"link": "forearm", "xyz": [-0.16, 0, -0.01]}],
        "passive": ["coupler", "elbow"],
        "source": "drawn",
    }
    file = write_scaffold(folder / "four_bar.urdf", folder).description
    content = yaml.safe_load(file.read_text()) | {"loops": [loop], "base": "fixed"}
    file.write_text(yaml.safe_dump(content))
    robot = load_robot(file)
    columns = [robot.joint_index(name) for name in ("yaw", "shoulder", "elbow", "drive", "coupler")]
    # In the plane a vector (x, z) is the number x - i z, which a turn about y multiplies by exp(i angle).
    upper, pull, crank, rod = -0.4j, -0.16 + 0.01j, -0.11 + 0.0j, -0.05 - 0.39j

    def closed(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        yaw, shoulder, drive = x.T
        elbow_at, crank_at = upper * np.exp(1j * shoulder), crank * np.exp(1j * drive)
        between = elbow_at - crank_at
        cosine = (abs(rod) ** 2 - abs(between) ** 2 - abs(pull) ** 2) / (2.0 * abs(between) * abs(pull))
        turn = np.angle(between.conj() * pull)
        both = [sign * np.arccos(cosine) - turn for sign in (1.0, -1.0)]
        both = [np.angle(np.exp(1j * (u - shoulder))) for u in both]
        elbow = np.where(abs(both[0]) < abs(both[1]), *both)
        end = elbow_at + pull * np.exp(1j * (shoulder + elbow)) - crank_at
        q = np.zeros((len(x), robot.model.nv))
        q[:, columns] = np.column_stack(
            [yaw, shoulder, elbow, drive, np.angle(end / rod * np.exp(-1j * drive))]
        )
        return q, x

    return Machine(
        robot,
        closed,
        ("yaw", "shoulder", "drive"),
        np.array([1.2, 0.32, 0.28]),
        (("elbow", columns[2]),),
        robot.model.getJointId("elbow"),
    )


MACHINES = {"wrist": wrist, "ankle": ankle, "four_bar": four_bar}
EFFECTS = (
    "none",
    "coulomb_friction",
    "viscous_friction",
    "torque_gain",
    "torque_bias",
    "armature",
    "time_delay",
    "encoder_offset",
    "payload",
    "coulomb_friction behind",
    "joint_spring behind",
)


@dataclass(frozen=True)
class Case:
    """A record with what is hidden in it."""

    robot: Robot
    log: Log
    effect: str
    place: str
    size: float


@dataclass(frozen=True)
class _Part:
    """A motion at the fine rate: of the tree, of the motors, and what the motors exert for the rigid bodies."""

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    maps: np.ndarray
    motor_v: np.ndarray
    motor_a: np.ndarray
    motor_torque: np.ndarray
    logged: np.ndarray
    offset: np.ndarray


def _motion(machine: Machine, model: pin.Model, seconds: float, rng: np.random.Generator) -> _Part:
    time = np.arange(round(seconds * RATE_HZ * FINE)) / (RATE_HZ * FINE)
    x = np.zeros((len(time), len(machine.amplitude)))
    for j, size in enumerate(machine.amplitude):
        for k, turn in enumerate((0.17, 0.43, 0.9, 1.6)):
            phase = 2.0 * np.pi * turn * (1.0 + 0.11 * j) * time + rng.uniform(0.0, 2.0 * np.pi)
            x[:, j] += 0.55 * size / (1.0 + 0.7 * k) * np.sin(phase)
    x *= (np.sin(0.5 * np.pi * np.clip(np.minimum(time, seconds - time), 0.0, 1.0)) ** 2)[:, None]
    q, motor = machine.closed(x)
    splines, of_motor = CubicSpline(time, q), CubicSpline(time, motor)
    v, a = splines(time, 1), splines(time, 2)
    data = model.createData()
    tree = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    slopes = []
    for unit in STEP * np.eye(x.shape[1]):
        ahead, behind = machine.closed(x + unit), machine.closed(x - unit)
        slopes.append([(one - other) / (2.0 * STEP) for one, other in zip(ahead, behind, strict=True)])
    of_tree = np.stack([one for one, _ in slopes], axis=2)
    of_motors = np.stack([other for _, other in slopes], axis=2)
    maps = of_tree @ np.linalg.inv(of_motors)
    torque = np.einsum("nvm,nv->nm", maps, tree)
    # Logs of coupled motors have the joints' positions, others the motors'.
    logged = x if machine.coupling else motor
    offset = maps[0].T if machine.coupling else np.eye(len(machine.motors))
    return _Part(time, q, v, maps, of_motor(time, 1), of_motor(time, 2), torque, logged, offset)


# Effects that are torques: by their name, per unit of their size at the motor where they are.
_LAWS: dict[str, Callable[[_Part, int], np.ndarray]] = {
    "armature": lambda part, k: part.motor_a[:, k],
    "coulomb_friction": lambda part, k: np.tanh(part.motor_v[:, k] / SIGN),
    "viscous_friction": lambda part, k: part.motor_v[:, k],
    "torque_bias": lambda part, k: np.ones(len(part.time)),
}
# The same at a joint of the tree that no motor turns alone.
_BEHIND: dict[str, Callable[[_Part, int], np.ndarray]] = {
    "coulomb_friction": lambda part, column: np.tanh(part.v[:, column] / SIGN),
    "joint_spring": lambda part, column: part.q[:, column],
}


def drawn(machine: Machine, word: str, rng: np.random.Generator) -> Case:
    """A record of a machine with an effect of a size and at a place that are drawn."""
    effect, _, behind = word.partition(" ")
    model, n = machine.robot.model.copy(), len(machine.motors)
    # About an upright axis no zero shows, and a rotor is a part of the link.
    first = 1 if effect in {"armature", "encoder_offset"} and machine.motors[0] != "knee" else 0
    where = int(rng.integers(first, n))
    place, column = machine.motors[where], -1
    if behind:
        place, column = machine.followers[int(rng.integers(len(machine.followers)))]
    share, sign = rng.uniform(0.08, 0.3), rng.choice([-1.0, 1.0])
    sizes = {"torque_gain": float(sign * share)}
    if effect == "payload":
        sizes[effect] = float(rng.uniform(0.1, 0.3) * model.inertias[machine.load].mass)
        ball = pin.Inertia(sizes[effect], rng.uniform(-0.08, 0.08, 3), 4e-4 * sizes[effect] * np.eye(3))
        model.inertias[machine.load] = model.inertias[machine.load] + ball
        carried = (f.name for f in model.frames if f.parentJoint == machine.load and f.type == pin.BODY)
        place = next(carried)
    parts = [_motion(machine, model, seconds, rng) for seconds in (14.0, 14.0, 12.0)]
    scale = np.concatenate([p.motor_torque for p in parts]).std(axis=0)
    viscous = 0.08 * scale / np.concatenate([p.motor_v for p in parts]).std(axis=0)
    viscous, dry = viscous * (effect != "viscous_friction"), 0.08 * scale * (word != "coulomb_friction")
    fitted = {"viscous_friction": viscous.any(), "coulomb_friction": dry.any()}
    if effect == "time_delay":
        place, sizes[effect] = "torque", float(rng.uniform(0.008, 0.025))
    if effect == "encoder_offset":
        sizes[effect] = float(sign * rng.uniform(0.015, 0.05))
    middle, trials = parts[0].q.mean(axis=0), []
    for number, moved in enumerate(parts):
        part = replace(moved, q=moved.q - middle)
        tau = part.motor_torque + viscous * part.motor_v + dry * np.tanh(part.motor_v / SIGN)
        if behind or effect in _LAWS:
            felt = part.maps[:, column] if behind else np.eye(n)[[where]]
            law = _BEHIND[effect](part, column) if behind else _LAWS[effect](part, where)
            felt = felt * law[:, None]
            spread = np.maximum(
                np.where(np.ptp(felt, axis=0) > 0.0, felt.std(axis=0), abs(felt).max(axis=0)), 1e-9
            )
            own = float(share * (scale / spread).min()) * (sign if effect == "torque_bias" else 1.0)
            tau = tau + sizes.setdefault(effect, own) * felt
        elif effect == "torque_gain":
            tau[:, where] *= 1.0 + sizes[effect]
        elif effect == "time_delay":
            tau = CubicSpline(part.time, tau)(np.maximum(part.time - sizes[effect], 0.0))
        logged = part.logged + (sizes[effect] * part.offset[where] if effect == "encoder_offset" else 0.0)
        role = "validation" if number == 2 else "identification"
        trials.append(_trial(f"t{number}", role, part.time, logged, tau, 0.01 * scale, rng))
    header = {
        "schema": "excite.log/1",
        "robot": "robot.yaml",
        "base": "fixed",
        "rate_hz": RATE_HZ,
        "joints": list(machine.motors),
        "torque": "motor_side",
        "modelled": ["rigid_body_fixed", *(name for name, here in fitted.items() if here)],
        "coupling": machine.coupling,
        "trials": [{"file": f"{t.name}.parquet", "role": t.role} for t in trials],
    }
    log = Log(LogHeader.model_validate(header), tuple(trials), robot_text=machine.robot.urdf)
    return Case(machine.robot, log, effect, place, sizes.get(effect, 0.0))


def _trial(
    name: str,
    role: str,
    time: np.ndarray,
    q: np.ndarray,
    tau: np.ndarray,
    noise: np.ndarray,
    rng: np.random.Generator,
) -> Trial:
    """A trial at the log's rate, with the noise of its torques and 20 µrad of its encoders."""
    time, q, tau = time[::FINE], q[::FINE], tau[::FINE]
    tau = tau + noise * rng.standard_normal(tau.shape)
    return Trial(name=name, role=role, time=time, q=q + 2e-5 * rng.standard_normal(q.shape), tau=tau)
