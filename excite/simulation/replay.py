"""Does the robot stay on its feet, and does it follow, when a motion is really run?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.motion.motion import Motion, interpolate
from excite.robot.robot import Robot
from excite.simulation.execution import execute
from excite.simulation.recording import Recording
from excite.simulation.virtual_robot import VirtualRobot, nominal_robot

# A base that tilts or sinks further than this from where the motion wants it has fallen.
FALL_TILT_RAD = 0.5
_FALL_COSINE = math.cos(FALL_TILT_RAD)
FALL_HEIGHT_M = 0.15
FALL_END_TILT_RAD = 0.1
# A foot has this long after touchdown to come to rest before its slip counts.
_TOUCHDOWN_S = 0.05


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
        lift_m: by foot, for each phase, largest height of the sole's lowest corner above the ground.
        self_collided: whether parts of the robot other than its soles touched each other or the ground.
        max_tracking_error_rad: largest difference between commanded and actual joint position.
        torque_saturation: share of samples at which some joint's torque was at its limit.
    """

    motion: str
    fell: bool
    fell_at_s: float | None
    max_tilt_rad: float
    slip_m: Mapping[str, tuple[float, ...]]
    lift_m: Mapping[str, tuple[float, ...]]
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

    def summary(self) -> str:
        """One line."""
        end = f"fell at {self.fell_at_s:.2f} s" if self.fell_at_s is not None else "stayed up"
        touch = ", touched itself" if self.self_collided else ""
        return (
            f"{self.motion}: {end}{touch}, tilt {self.max_tilt_rad:.3f} rad, "
            f"slip {1e3 * self.max_slip_m:.1f} mm, tracking {self.max_tracking_error_rad:.4f} rad"
        )


def replay(
    subject: Robot | VirtualRobot, motion: Motion, *, mass_error: float = 0.0, friction_error: float = 0.0
) -> Replay:
    """Run a motion once, with contacts between the robot's own parts, and say what became of it.

    Args:
        subject: a robot (then the model itself is simulated) or a virtual robot.
        motion: the motion.
        mass_error: relative change of the mass and inertia of all segments, 0.1 for a tenth more.
        friction_error: relative change of the soles' friction, -0.3 for a floor a third more slippery.

    Returns:
        What happened.

    Raises:
        MotionError: the motion is not for this robot, or the simulation diverged.
    """
    virtual = nominal_robot(subject) if isinstance(subject, Robot) else subject
    virtual = replace(
        virtual,
        truth=replace(virtual.truth, phi=(1.0 + mass_error) * virtual.truth.phi),
        world=replace(virtual.world, sole_friction=virtual.world.sole_friction * (1.0 + friction_error)),
    )
    return watched_run(virtual, motion).replay


@dataclass(frozen=True, eq=False)
class WatchedRun:
    """A run and what became of it.

    Attributes:
        recording: what happened, up to the fall if there was one.
        replay: the judgement.
    """

    recording: Recording
    replay: Replay


def watched_run(virtual: VirtualRobot, motion: Motion, session_s: float = 0.0) -> WatchedRun:
    """Run a motion, note what touches what, stop when the robot falls; errors as in :func:`replay`."""
    robot = virtual.robot
    planned = _planned(robot, motion)
    watched = replace(virtual, world=replace(virtual.world, watch_touches=True))
    run = execute(
        watched, motion, stop=_Fall(planned) if robot.floating and robot.feet else None, session_s=session_s
    )
    return WatchedRun(run, _judge(virtual, planned, run))


def _judge(virtual: VirtualRobot, planned: Motion, run: Recording) -> Replay:
    robot = virtual.robot
    tilt, sink = np.zeros(1), np.zeros(1)
    if robot.floating and robot.feet:
        tilt, sink = _departure(run.q, planned.q[: len(run.q)])
    lost = (tilt > FALL_TILT_RAD) | (sink > FALL_HEIGHT_M)
    # A robot that has not come upright again when the motion ends is on its way down.
    lost[-1] |= tilt[-1] > FALL_END_TILT_RAD
    fallen = np.flatnonzero(lost)
    slip, lift = _feet(robot, run, planned)
    saturated = np.abs(run.tau_motor) >= 0.999 * virtual.drives.torque_limit
    return Replay(
        motion=planned.name,
        fell=bool(len(fallen)),
        fell_at_s=float(run.time[fallen[0]]) if len(fallen) else None,
        max_tilt_rad=float(tilt.max()),
        slip_m=slip,
        lift_m=lift,
        self_collided=bool(run.touches.any()),
        max_tracking_error_rad=float(np.abs(run.q[:, robot.n_base_q :] - run.q_cmd).max()),
        torque_saturation=float(saturated.any(axis=1).mean()),
    )


def _planned(robot: Robot, motion: Motion) -> Motion:
    """The motion at the instants at which a run is sampled."""
    rate = robot.description.sensors.rate_hz
    n = int(np.floor(motion.duration * rate + 1e-9)) + 1
    return interpolate(motion, robot, motion.time[0] + np.minimum(np.arange(n) / rate, motion.duration))


def _departure(q: Array, planned: Array) -> tuple[Array, Array]:
    """Angle between the base's vertical axis and the planned one [rad], and how far it sank [m]."""
    cosine = np.einsum("ni,ni->n", _vertical_axis(q[:, 3:7]), _vertical_axis(planned[:, 3:7]))
    return np.arccos(np.clip(cosine, -1.0, 1.0)), planned[:, 2] - q[:, 2]


def _vertical_axis(quaternions: Array) -> Array:
    """The body's z axis in the world for quaternions x y z w, ``(n, 3)``."""
    x, y, z, w = quaternions.T
    return np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x**2 + y**2)])


class _Fall:
    """Ends a run as soon as the base has left the motion for good."""

    def __init__(self, planned: Motion):
        # Looked at at every sample: in plain numbers, which takes a tenth of what arrays of one row take.
        self.vertical, self.height = _vertical_axis(planned.q[:, 3:7]).tolist(), planned.q[:, 2].tolist()

    def __call__(self, sample: int, qpos: Array) -> bool:
        height, w, x, y, z = qpos[2:7].tolist()
        a, b, c = self.vertical[sample]
        cosine = 2.0 * a * (x * z + w * y) + 2.0 * b * (y * z - w * x) + c * (1.0 - 2.0 * (x * x + y * y))
        return bool(cosine < _FALL_COSINE or self.height[sample] - height > FALL_HEIGHT_M)


def _feet(
    robot: Robot, run: Recording, planned: Motion
) -> tuple[dict[str, tuple[float, ...]], dict[str, tuple[float, ...]]]:
    """Slip and lift of each foot in each of its phases on the ground."""
    slip: dict[str, tuple[float, ...]] = {}
    lift: dict[str, tuple[float, ...]] = {}
    model, data = robot.model, robot.model.createData()
    centres = np.zeros((len(run.q), len(robot.feet), 3))
    heights = np.zeros((len(run.q), len(robot.feet)))
    for row, q in enumerate(run.q) if robot.feet else ():
        pin.forwardKinematics(model, data, q)
        for number, foot in enumerate(robot.feet):
            pose = data.oMi[foot.joint]
            centres[row, number] = pose.act(foot.placement.translation)
            heights[row, number] = (foot.sole @ pose.rotation[2] + pose.translation[2]).min()
    settle = round(_TOUCHDOWN_S * robot.description.sensors.rate_hz)
    for number, foot in enumerate(robot.feet):
        flags = planned.contacts.get(foot.name, np.ones(len(planned.time), dtype=bool))[: len(run.q)]
        phases = [(start + settle if start > 0 else 0, end) for start, end in _runs(flags)]
        phases = [(start, end) for start, end in phases if end > start]
        points = centres[:, number, :2]
        slip[foot.name] = tuple(
            float(np.linalg.norm(points[start:end] - points[start], axis=1).max()) for start, end in phases
        )
        lift[foot.name] = tuple(float(heights[start:end, number].max()) for start, end in phases)
    return slip, lift


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open index ranges over which ``flags`` is True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(start), int(end)) for start, end in zip(edges[::2], edges[1::2], strict=True)]
