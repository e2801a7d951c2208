"""Cases of a standing robot in the benchmark: sensors, motions, true inertial parameters, external forces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
import pinocchio as pin
from scipy.signal import butter, sosfiltfilt

from excite.arrays import Array
from excite.errors import NoSolutionError
from excite.logs.header_blocks import SensorHeader, TrialHeader
from excite.logs.log import LogHeader, Trial
from excite.logs.robot import robot_in_log
from excite.motion.generators.generator import leg_joints
from excite.motion.generators.registry import make_generator
from excite.motion.motion import Motion, interpolate_motion
from excite.robot.loading import build_robot, load_robot
from excite.robot.robot import Foot, Robot
from excite.safety.check import check_motion
from excite.safety.filter import filter_candidate
from excite.simulation.true_parameters import nominal_truth, scattered_parameters
from excite.simulation.virtual_robot import Recording

# A standing robot of a blind benchmark before anything is hidden in it: sensors, motions, true inertials.

SensorKind = Literal["force_plate", "foot_ft"]

ROBOTS = ("g1", "talos", "hrp2like", "human")
# Standard deviations of force [N] and moment [N·m] of a sensor.
_NOISE_FORCE, _NOISE_MOMENT = (0.5, 2.0), (0.1, 0.3)
_PERSON_STRENGTH = 2.0
_SCATTER = 0.08


@dataclass(frozen=True, eq=False)
class Stand:
    """A robot on its feet and the session that it is to run.

    Attributes:
        robot: the nominal robot with the sensors of the log.
        header: of the log.
        motions: one a trial; the last repeats the first.
        phi: ``(10·n_segments,)`` true inertial parameters.
        noise: factor on the usual noise.
    """

    robot: Robot
    header: LogHeader
    motions: tuple[Motion, ...]
    phi: Array
    noise: float

    @property
    def free(self) -> bool:
        """Whether the log says that inertial parameters are identified."""
        return "rigid_body" in self.header.modelled


def stand_of(name: str, sensors: SensorKind, fixed: bool, noise: float, rng: np.random.Generator) -> Stand:
    """Draw a robot's session.

    Args:
        name: of a bundled robot with two feet.
        sensors: ``force_plate`` or ``foot_ft``.
        fixed: whether its inertial parameters are the model's; else they are scattered.
        noise: factor on the usual noise.
        rng: source of all that is drawn.

    Returns:
        The stand.
    """
    robot = standing_robot(name)
    motions, n_validation = session_programme(robot, rng)
    again = replace(motions[0], name=f"trial_{len(motions):02d}")
    trials = [
        TrialHeader(
            file=f"{motion.name}.parquet",
            role="identification" if k < len(motions) - n_validation else "validation",
        )
        for k, motion in enumerate(motions)
    ]
    trials.append(TrialHeader(file=f"{again.name}.parquet", role="identification", repeats=trials[0].file))
    header = LogHeader(
        schema="excite.log/1",
        robot="robot.urdf",
        base="floating",
        gravity=robot.description.gravity,
        rate_hz=RATE_HZ,
        joints=robot.joint_names,
        base_link=robot.base_link,
        wrench="on_robot_in_sensor_frame",
        sensors=tuple(_mount_sensor(robot, foot, sensors, noise, rng) for foot in robot.feet),
        modelled=("rigid_body_fixed" if fixed else "rigid_body",),
        trials=tuple(trials),
    )
    truth = nominal_truth(robot) if fixed else scattered_parameters(robot, rng, scatter=_SCATTER)
    return Stand(robot_in_log(robot, header), header, (*motions, again), truth.phi, noise)


def standing_robot(name: str) -> Robot:
    """A bundled robot as a bare URDF tells it, joints that the log lacks at zero; a person is a strong one."""
    robot = load_robot(name)
    if robot.description.locked_joints:
        locked = dict.fromkeys(robot.description.locked_joints, 0.0)
        robot = build_robot(robot.description.model_copy(update={"locked_joints": locked}), robot.source)
    if name == "human":
        limits = replace(robot.limits, torque=_PERSON_STRENGTH * robot.limits.torque)
        robot = replace(robot, limits=limits)
    return robot


def _mount_sensor(
    robot: Robot, foot: Foot, kind: SensorKind, noise: float, rng: np.random.Generator
) -> SensorHeader:
    """A sensor near the ankle, or a plate near where the foot stands; some hang upside down."""
    shift = rng.uniform(-1.0, 1.0, 3)
    turned = (np.pi, 0.0, 0.0) if rng.random() < 0.4 else (0.0, 0.0, 0.0)
    forces, moments = noise * rng.uniform(*_NOISE_FORCE), noise * rng.uniform(*_NOISE_MOMENT)
    excludes: tuple[str, ...]
    if kind == "foot_ft":
        place, parent, excludes = 0.015 * shift - [0.0, 0.0, 0.015], foot.link, (foot.link,)
    else:
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, robot.rest)
        sole = data.oMi[foot.joint].act(foot.placement.translation)
        place, parent, excludes = sole + shift * [0.06, 0.03, 0.012] - [0.0, 0.0, 0.012], "world", ()
    x, y, z = (round(float(value), 6) for value in place)
    return SensorHeader(
        name=foot.name if kind == "foot_ft" else foot.name.replace("foot", "plate"),
        kind=kind,
        parent=parent,
        xyz=(x, y, z),
        rpy=turned,
        foot=foot.link,
        excludes=excludes,
        noise_force=float(forces),
        noise_moment=float(moments),
    )


# The trials of a standing robot: motions of the toolkit's own generators, found safe, at a calm pace.

RATE_HZ = 100.0
_SHORTEST_S, _LONGEST_S = 7.0, 17.0
_TRIES = 12
# Planned motions use all that the limits allow; a laboratory runs them slower.
_PACE = {"random_joint": (0.55, 0.75), "fourier": (0.7, 1.0), "squat": (0.55, 0.75), "leg_swing": (0.8, 0.95)}
# One trial a row: generators to choose from.
_STANDING, _SQUATTING, _SWINGING = ("random_joint", "fourier"), ("squat",), ("leg_swing",)


def session_programme(robot: Robot, rng: np.random.Generator) -> tuple[tuple[Motion, ...], int]:
    """Motions of a session, each at least seven seconds long.

    Args:
        robot: a robot with two feet.
        rng: source of all that is drawn.

    Returns:
        Identification motions, then validation motions, and how many of the latter there are.

    Raises:
        NoSolutionError: no safe motion was found.
    """
    first, second = rng.permutation(2)
    # Now and then the same leg swings in both trials.
    legs = (int(first), int(first if rng.random() < 0.2 else second))
    tasks = [
        (_STANDING, None),
        (_SQUATTING, None),
        (_SWINGING, legs[0]),
        (_SWINGING, legs[1]),
        (_STANDING if rng.random() < 0.5 else _SQUATTING, None),
        (_SWINGING, int(rng.integers(2))),
    ]
    trials = [_build_trial(robot, names, leg, rng) for names, leg in tasks]
    return tuple(motion.renamed(f"trial_{k:02d}") for k, motion in enumerate(trials)), 2


def _build_trial(robot: Robot, names: tuple[str, ...], leg: int | None, rng: np.random.Generator) -> Motion:
    pieces: list[Motion] = []
    while sum(piece.duration for piece in pieces) < _SHORTEST_S:
        pieces.append(_build_piece(robot, str(rng.choice(names)), leg, rng))
    return _join_pieces(pieces)


def _build_piece(robot: Robot, name: str, leg: int | None, rng: np.random.Generator) -> Motion:
    generator = make_generator(name)
    aims = generator.aims(robot)
    if leg is not None:
        aims = tuple(robot.joint_names[i] for i in leg_joints(robot, robot.feet[leg]))
    for _ in range(_TRIES):
        seed, target = int(rng.integers(1 << 53)), str(rng.choice(aims))
        pace = float(rng.uniform(*_PACE[name]))
        motion = filter_candidate(robot, generator.draw(robot, seed, (target,), name)).motion
        if motion is None or motion.duration > pace * _LONGEST_S:
            continue
        slow = _slow_motion(robot, motion, pace)
        if check_motion(robot, slow).safe:
            return slow
    raise NoSolutionError(
        f"{_TRIES} candidates of {name!r} for {robot.name} were all unsafe", remedy="take another seed"
    )


def _slow_motion(robot: Robot, motion: Motion, pace: float) -> Motion:
    slow = replace(motion, time=motion.time / pace, v=motion.v * pace, a=motion.a * pace**2)
    time = slow.time[0] + np.arange(int(slow.duration * RATE_HZ) + 1) / RATE_HZ
    return interpolate_motion(slow, robot, time)


def _join_pieces(pieces: list[Motion]) -> Motion:
    """Pieces that all start and end at rest in the same posture, one after the other."""
    starts = np.cumsum([0.0, *(piece.duration + 1.0 / RATE_HZ for piece in pieces)])
    times = [piece.time - piece.time[0] + start for piece, start in zip(pieces, starts, strict=False)]
    names = pieces[0].contacts
    return replace(
        pieces[0],
        time=np.concatenate(times),
        q=np.vstack([piece.q for piece in pieces]),
        v=np.vstack([piece.v for piece in pieces]),
        a=np.vstack([piece.a for piece in pieces]),
        contacts={name: np.concatenate([piece.contacts[name] for piece in pieces]) for name in names},
    )


# Forces on a standing robot that its log does not know.

Vector = tuple[float, float, float]
"""Three coordinates."""


class Pull(Protocol):
    """A force on a point of a link.

    Attributes:
        joint: index of the model joint that carries the link.
        point: in that joint's frame [m].
    """

    @property
    def joint(self) -> int:
        """Index of the model joint that carries the link."""
        ...

    @property
    def point(self) -> Vector:
        """The point in that joint's frame [m]."""
        ...

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N] at ``time (n,)`` on a point at ``place (n, 3)`` with ``speed (n, 3)``."""
        ...


@dataclass(frozen=True)
class Tether:
    """A cable: a force that is constant but for a spring about the place where it was hooked on.

    Attributes:
        steady: [N]
        stiffness: [N/m]
        hooked: [m]
    """

    joint: int
    point: Vector
    steady: Vector
    stiffness: float
    hooked: Vector

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N]: the steady one less the spring's, by the distance from where it was hooked on."""
        return np.asarray(np.array(self.steady) - self.stiffness * (place - np.array(self.hooked)))


@dataclass(frozen=True)
class Table:
    """Something soft to lean on, below ``height``; the force rises over ``depth`` and then stays.

    Attributes:
        height: [m]
        depth: over which it gives way [m].
        load: once it is pressed down [N].
        friction: horizontal share of that, by direction.
    """

    joint: int
    point: Vector
    height: float
    depth: float
    load: float
    friction: tuple[float, float]

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N]: up by how deep the point is, and friction along its share of that."""
        s = np.clip((self.height - place[:, 2]) / self.depth, 0.0, 1.0)
        press = self.load * s**2 * (3.0 - 2.0 * s)
        return np.asarray(press[:, None] * np.array([*self.friction, 1.0]))


@dataclass(frozen=True)
class Jostle:
    """Somebody who pushes at random, otherwise in every trial.

    Attributes:
        size: standard deviation of each component [N].
        seed: of the numbers.
    """

    joint: int
    point: Vector
    size: float
    seed: int

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N]: eight waves of 0.1 to 1.5 Hz along each axis, drawn by seed and trial."""
        rng = np.random.default_rng([self.seed, trial])
        hertz, phase = rng.uniform(0.1, 1.5, (8, 3)), rng.uniform(0.0, 2.0 * np.pi, (8, 3))
        waves = np.sin(2.0 * np.pi * hertz * time[:, None, None] + phase)
        return np.asarray(0.5 * self.size * waves.sum(axis=1))


@dataclass(frozen=True)
class Drag:
    """A cable bundle that rubs: a force against the point's velocity.

    Attributes:
        damping: [N·s/m]
    """

    joint: int
    point: Vector
    damping: float

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N] against the velocity."""
        return -self.damping * speed


@dataclass(frozen=True)
class Slosh:
    """A tank on the robot: a mass on a spring, driven by the tank's own acceleration, that pushes back.

    Attributes:
        mass: that moves [kg]; its weight is in the model.
        hertz: of its oscillation.
        ratio: damping ratio.
    """

    joint: int
    point: Vector
    mass: float
    hertz: float
    ratio: float

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N], horizontal: that of an oscillator driven by the point's acceleration."""
        from scipy.signal import cont2discrete, lfilter

        omega = 2.0 * np.pi * self.hertz
        step = float(time[1] - time[0])
        acceleration = np.gradient(speed, step, axis=0)
        # x'' + 2ζω x' + ω² x = −a; beyond the rigid mass, which the model has, the wall feels m (x'' + …) = m x''.
        numerator, denominator = [-1.0, 0.0, 0.0], [1.0, 2.0 * self.ratio * omega, omega**2]
        top, bottom, _ = cont2discrete((numerator, denominator), step, method="bilinear")
        out = -self.mass * lfilter(np.ravel(top), bottom, acceleration, axis=0)
        return np.column_stack([out[:, :2], np.zeros(len(time))])


# From what perfect sensors would log to what a laboratory does: noise, then the filters of its recorder.

# Joint angles [rad], base position [m] and orientation [rad], standard deviations before the filter.
_JOINTS, _POSITION, _ORIENTATION = 1e-4, 3e-4, 3e-4
_KINEMATICS_HZ, _WRENCH_HZ = 5.0, 25.0


def trial_of(
    robot: Robot, recording: Recording, header: TrialHeader, noise: float, rng: np.random.Generator
) -> Trial:
    """The trial as it is logged.

    Args:
        robot: with the sensors, whose noise counts.
        recording: what perfect sensors would log.
        header: of the trial.
        noise: factor on the usual noise of kinematics; 0 for none at all.
        rng: source of the noise.
    """
    n = len(recording.time)
    rate = 1.0 / float(recording.time[1] - recording.time[0])
    q = recording.q[:, 7:] + noise * _JOINTS * rng.standard_normal((n, robot.n_joints))
    position = recording.q[:, :3] + noise * _POSITION * rng.standard_normal((n, 3))
    turns = noise * _ORIENTATION * rng.standard_normal((n, 3))
    quaternions = np.array(
        [
            (pin.Quaternion(row) * pin.Quaternion(pin.exp3(turn))).coeffs()
            for row, turn in zip(recording.q[:, 3:7], turns, strict=True)
        ]
    )
    quaternions = _filter_values(quaternions, rate, _KINEMATICS_HZ)
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    wrenches = {}
    for sensor in robot.sensors:
        sigma = np.repeat([sensor.noise_force, sensor.noise_moment], 3) * (noise > 0.0)
        logged = recording.wrenches[sensor.name] + sigma * rng.standard_normal((n, 6))
        wrenches[sensor.name] = _filter_values(logged, rate, _WRENCH_HZ)
    return Trial(
        name=recording.name,
        role=header.role,
        time=recording.time,
        q=_filter_values(q, rate, _KINEMATICS_HZ),
        base=np.hstack([_filter_values(position, rate, _KINEMATICS_HZ), quaternions]),
        wrenches=wrenches,
    )


def _filter_values(values: Array, rate: float, cutoff: float) -> Array:
    return np.asarray(sosfiltfilt(butter(4, cutoff, fs=rate, output="sos"), values, axis=0))
