"""Does the robot stay on its feet, and does it follow, when a motion is really run?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array, Flags, runs_of
from excite.motion.motion import Motion, interpolate_motion
from excite.regressor.kernels import forward_kinematics
from excite.robot.robot import Robot
from excite.simulation.execution import Machine, Stop, execute_motion
from excite.simulation.virtual_robot import Plant, Recording, VirtualRobot

# A robot whose base is tilted further than this against the motion when that ends is on its way down.
FALL_END_TILT_RAD = 0.1


@dataclass(frozen=True)
class Replay:
    """What became of a motion on a simulated robot.

    Attributes:
        motion: name of the motion.
        fell: whether the base tilted by more than 0.5 rad or sank by more than 0.15 m against the motion.
        fell_at_s: when, None if it did not.
        max_tilt_rad: largest angle between the base and where the motion wants it.
        slip_m: by foot, for each phase in which the motion has it on the ground: largest horizontal
            distance of the sole's centre from where it stood at the start of the phase.
        self_collided: whether parts of the robot other than its soles touched each other or the ground.
        max_tracking_error_rad: largest difference between commanded and actual joint position.
        torque_saturation: share of samples at which some joint's torque was at its limit.
    """

    motion: str
    fell: bool
    fell_at_s: float | None
    max_tilt_rad: float
    slip_m: Mapping[str, tuple[float, ...]]
    self_collided: bool
    max_tracking_error_rad: float
    torque_saturation: float

    @property
    def max_slip_m(self) -> float:
        """Largest slip of any foot in any phase [m]; 0 without feet."""
        return max((slip for phases in self.slip_m.values() for slip in phases), default=0.0)

    @property
    def on_its_feet(self) -> bool:
        """Whether it neither fell nor touched itself."""
        return not self.fell and not self.self_collided


@dataclass(frozen=True, eq=False)
class WatchedRun:
    """A run and what became of it.

    Attributes:
        recording: what happened, up to the fall if there was one.
        replay: the judgement.
    """

    recording: Recording
    replay: Replay


def watched_run(
    virtual: VirtualRobot,
    motion: Motion,
    session_s: float = 0.0,
    *,
    may_slip_m: float | None = None,
    forces: bool = True,
    machine: Machine | None = None,
) -> WatchedRun:
    """Run a motion, note what touches what, stop when the robot falls; errors as in :func:`replay_motion`.

    Args:
        virtual: the robot.
        motion: the motion.
        session_s: when the run starts within its session [s].
        may_slip_m: stop as well as soon as a standing robot touches itself or slips by more than this [m].
        forces: whether the recording has contact wrenches and what sensors read.
        machine: the robot compiled so that touches are watched; compiled for this run alone, if None.
    """
    robot = virtual.robot
    planned = _planned_motion(robot, motion)
    machine = Machine(virtual, watch=True) if machine is None else machine
    stop: Stop | None = None
    if robot.floating and robot.feet:
        stop = Fall(planned) if may_slip_m is None else FirstFault(robot, planned, may_slip_m)
    run = execute_motion(virtual, motion, stop=stop, session_s=session_s, forces=forces, machine=machine)
    return WatchedRun(run, _judge_replay(robot, planned, run))


def _judge_replay(robot: Robot, planned: Motion, run: Recording) -> Replay:
    tilt, sink = np.zeros(1), np.zeros(1)
    if robot.floating and robot.feet:
        wanted = planned.q[: len(run.q)]
        # Angle between the base's vertical axis and the planned one [rad], and how far it sank [m].
        cosine = np.einsum("ni,ni->n", vertical_axis(run.q[:, 3:7]), vertical_axis(wanted[:, 3:7]))
        tilt, sink = np.arccos(np.clip(cosine, -1.0, 1.0)), wanted[:, 2] - run.q[:, 2]
    lost = (tilt > FALL_TILT_RAD) | (sink > FALL_HEIGHT_M)
    lost[-1] |= tilt[-1] > FALL_END_TILT_RAD
    fallen = np.flatnonzero(lost)
    return Replay(
        motion=planned.name,
        fell=bool(len(fallen)),
        fell_at_s=float(run.time[fallen[0]]) if len(fallen) else None,
        max_tilt_rad=float(tilt.max()),
        slip_m=_foot_slips(robot, run, planned),
        self_collided=bool(run.touches.any()),
        max_tracking_error_rad=float(np.abs(run.q[:, robot.n_base_q :] - run.q_cmd).max()),
        torque_saturation=float(run.clipped.any(axis=1).mean()),
    )


def _planned_motion(robot: Robot, motion: Motion) -> Motion:
    """The motion at the instants at which a run is sampled."""
    rate = robot.description.sensors.rate_hz
    n = int(np.floor(motion.duration * rate + 1e-9)) + 1
    return interpolate_motion(
        motion, robot, motion.time[0] + np.minimum(np.arange(n) / rate, motion.duration)
    )


def _foot_slips(robot: Robot, run: Recording, planned: Motion) -> dict[str, tuple[float, ...]]:
    """Slip of each foot in each of its phases on the ground [m]."""
    slip: dict[str, tuple[float, ...]] = {}
    if not robot.feet:
        return slip
    placements, phases = forward_kinematics(robot.model, run.q), standing_phases(robot, planned)
    for foot in robot.feet:
        points = placements.point(foot.joint, foot.placement.translation)[:, :2]
        slip[foot.name] = tuple(
            float(np.linalg.norm(points[start:end] - points[start], axis=1).max())
            for start, end in phases[foot.name]
            if start < len(points)
        )
    return slip


# When a run is over before its motion is: the robot has fallen, or has done what it may not do.

# A base that tilts or sinks further than this from where the motion wants it has fallen.
FALL_TILT_RAD = 0.5
FALL_HEIGHT_M = 0.15
# MuJoCo's place of a foot and pinocchio's differ by rounding: a slip that ends a run is one by either.
_CLEARLY = 1.0 + 1e-6


class Fall:
    """Ends a run as soon as the base has left the motion for good."""

    def __init__(self, planned: Motion) -> None:
        # Looked at at every sample: in plain numbers, which takes a tenth of what arrays of one row take.
        self.vertical, self.height = vertical_axis(planned.q[:, 3:7]).tolist(), planned.q[:, 2].tolist()

    def __call__(self, sample: int, plant: Plant) -> bool:
        """Whether the base is lost after the step that began at a sample."""
        height, w, x, y, z = plant.data.qpos[plant.qpos[2:7]].tolist()
        a, b, c = self.vertical[sample]
        cosine = 2.0 * a * (x * z + w * y) + 2.0 * b * (y * z - w * x) + c * (1.0 - 2.0 * (x * x + y * y))
        return bool(cosine < math.cos(FALL_TILT_RAD) or self.height[sample] - height > FALL_HEIGHT_M)


class FirstFault:
    """Ends a run as soon as the robot falls, touches itself or the ground, or slips: its verdict cannot change."""

    def __init__(self, robot: Robot, planned: Motion, slip_m: float) -> None:
        """Of a planned motion at the instants of the run's samples; ``slip_m`` is what a foot may slip in a phase."""
        self._fall, self._limit = Fall(planned), slip_m * _CLEARLY
        self._bodies = np.array([foot.joint for foot in robot.feet])
        self._centres = np.array([foot.placement.translation for foot in robot.feet])[:, :, None]
        shape = (planned.n_samples, len(robot.feet))
        self._starts: Flags = np.zeros(shape, dtype=bool)
        self._counts: Flags = np.zeros(shape, dtype=bool)
        for number, phases in enumerate(standing_phases(robot, planned).values()):
            for start, end in phases:
                self._starts[start, number], self._counts[start:end, number] = True, True
        self._stood = np.zeros((len(robot.feet), 2))
        self._looked: Flags = np.asarray(self._starts.any(axis=1))
        # Feet that stand are looked at so often [s]: looking takes as long as two steps of the physics.
        self._looked[:: max(1, round(0.05 * robot.description.sensors.rate_hz))] = True
        if math.isinf(slip_m):
            self._looked[:] = False

    def __call__(self, sample: int, plant: Plant) -> bool:
        """Whether something went wrong at a sample."""
        if plant.touching or self._fall(sample, plant):
            return True
        if not self._looked[sample]:
            return False
        data = plant.data
        # MuJoCo's bodies are where they were when the step began.
        turned = data.xmat[self._bodies].reshape(-1, 3, 3) @ self._centres
        points = data.xpos[self._bodies, :2] + turned[:, :2, 0]
        starts = self._starts[sample]
        if starts.any():
            self._stood[starts] = points[starts]
        slip = np.hypot(*(points - self._stood).T)
        return bool((slip[self._counts[sample]] > self._limit).any())


def standing_phases(robot: Robot, planned: Motion) -> dict[str, list[tuple[int, int]]]:
    """Half-open ranges of samples in which each foot stands and its slip counts, by name of the foot."""
    # A foot has this long after touchdown to come to rest before its slip counts.
    settle = round(0.05 * robot.description.sensors.rate_hz)
    found = {}
    for foot in robot.feet:
        flags = planned.contacts.get(foot.name, np.ones(planned.n_samples, dtype=bool))
        phases = [(start + settle if start > 0 else 0, end) for start, end in runs_of(flags)]
        found[foot.name] = [(start, end) for start, end in phases if end > start]
    return found


def vertical_axis(quaternions: Array) -> Array:
    """The body's z axis in the world for quaternions x y z w, ``(n, 3)``."""
    x, y, z, w = quaternions.T
    return np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x**2 + y**2)])
