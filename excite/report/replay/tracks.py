"""A motion over time as a page's replay has it: configurations, balance, contact, and the margins of every limit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import ExciteError
from excite.motion.motion import Motion, jerk_peaks
from excite.report.replay.nearest import nearest_pairs
from excite.report.replay.packed import pack_table, packed_indices
from excite.robot.joint_values import Limits
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model, geometry_data
from excite.safety.checks.balance import ZMP_MARGIN, support_margin
from excite.safety.checks.sweep import Sweep
from excite.safety.checks.torque import drive_torques

# Instants a second: between two of them at 10 rad/s² a joint strays 1.4 mrad from a straight line, which nobody sees.
FRAMES_HZ = 30.0
# Of distances every third, as the check begins: 0.3 ms each of G1's 505 pairs, which else were most of the page's time.
_EVERY = 3


@dataclass(frozen=True, eq=False)
class Margin:
    """How far a motion stays from one kind of limit, over time.

    Attributes:
        name: field of :class:`~excite.safety.verdict.Margins`.
        title: for reading.
        unit: of the values.
        required: what the check asks for.
        values: ``(n,)``, NaN where it cannot be computed.
        where: ``(n,)`` index in ``places`` of what is nearest to its limit.
        places: joints, or pairs of bodies.
    """

    name: str
    title: str
    unit: str
    required: float
    values: Array
    where: NDArray[np.int64]
    places: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Tracks:
    """A motion at :data:`FRAMES_HZ`.

    Attributes:
        motion: at those instants.
        limits: of the robot's joints.
        com: centre of mass on the ground's plane, ``(n, 3)`` [m], world frame.
        zmp: zero-moment point on the ground, ``(n, 2)`` [m]; None of a robot without feet.
        contacts: ``(n, n_feet)``.
        torque: that the drives must deliver, ``(n, n_joints)`` [N·m or N].
        closest: of the two nearest bodies the joints that carry them, ``(n, 2)``; None without geometry.
        points: the nearest points of the two, each in the frame of its joint, ``(n, 6)`` [m].
        margins: of what applies to the robot.
    """

    motion: Motion
    limits: Limits
    com: Array
    zmp: Array | None
    contacts: NDArray[np.bool_]
    torque: Array
    closest: NDArray[np.int64] | None
    points: Array
    margins: tuple[Margin, ...]

    def _signals(self) -> list[dict[str, Any]]:
        """Positions, which the configurations hold, speeds and torques of the joints, each with its limits."""
        limits, motion = self.limits, self.motion
        first = motion.q.shape[1] - len(motion.joint_names)
        return [
            {
                "title": "position",
                "unit": "rad",
                "from": first,
                "limits": joint_bounds(limits.position_lower, limits.position_upper),
            },
            {
                "title": "velocity",
                "unit": "rad/s",
                "values": pack_table(motion.joint_velocities()),
                "limits": joint_bounds(-limits.velocity, limits.velocity),
            },
            {
                "title": "torque",
                "unit": "N·m",
                "values": pack_table(self.torque),
                "limits": joint_bounds(-limits.torque, limits.torque),
            },
        ]

    def to_json(self) -> dict[str, Any]:
        """Ready for the page: ``name``, ``time``, ``q``, ``com``, ``zmp``, ``contacts``, ``signals``, ``margins``, …"""
        motion = self.motion
        content: dict[str, Any] = {
            "name": motion.name,
            "time": pack_table(motion.time - motion.time[0]),
            "q": pack_table(motion.q),
            "com": pack_table(self.com),
            "zmp": None if self.zmp is None else pack_table(self.zmp),
            "contacts": packed_indices(self.contacts) if self.contacts.size else None,
            "signals": self._signals(),
            "closest": None,
            "margins": [_margin_json(margin) for margin in self.margins],
        }
        if self.closest is not None:
            content["closest"] = {"joints": packed_indices(self.closest), "points": pack_table(self.points)}
        return content


def _margin_json(margin: Margin) -> dict[str, Any]:
    used, where = np.unique(margin.where, return_inverse=True)
    return {
        "name": margin.name,
        "title": margin.title,
        "unit": margin.unit,
        "required": margin.required,
        "values": pack_table(margin.values),
        "where": packed_indices(where),
        "places": [margin.places[int(i)] for i in used],
    }


def joint_bounds(lower: Array, upper: Array) -> list[list[float | None]]:
    """Limits of the joints, ``(n_joints,)`` each, as JSON has them: null where there is none."""
    pairs = zip(lower, upper, strict=True)
    return [[float(end) if np.isfinite(end) else None for end in pair] for pair in pairs]


def motion_tracks(robot: Robot, motion: Motion) -> Tracks:
    """What is to be seen of a motion, at :data:`FRAMES_HZ`.

    Margins are those of the instants shown. The check, which looks between samples too, finds a little less.

    Raises:
        ExciteError: the motion lacks what its robot needs, such as contact flags.
    """
    shown = motion.resampled(robot, FRAMES_HZ)
    # A rate below the motion's own leaves the motion's own.
    sweep = Sweep(robot, shown, 1.0)
    n = sweep.fine.n_samples
    torque = np.full((n, robot.n_joints), np.nan)
    torque[sweep.torque_samples] = drive_torques(sweep)
    margins = [*_limit_margins(robot, sweep.fine, torque)]
    closest, points = None, np.zeros((n, 6))
    try:
        nearest = _nearest_margin(robot, sweep.fine)
    except ExciteError:
        nearest = None  # A robot without geometry; the check says so.
    if nearest is not None:
        margin, closest, points = nearest
        margins.append(margin)
    zmp = None
    if robot.feet:
        zmp = sweep.zmp
        edge = support_margin(sweep, zmp)
        where = np.zeros(n, dtype=np.int64)
        title = "ZMP to the edge of support"
        margins.append(Margin("zmp_m", title, "m", ZMP_MARGIN, edge, where, ("support polygon",)))
    return Tracks(
        motion=sweep.fine,
        limits=robot.limits,
        com=sweep.dynamics.com,
        zmp=zmp,
        contacts=sweep.contacts,
        torque=torque,
        closest=closest,
        points=points,
        margins=tuple(margins),
    )


def _limit_margins(robot: Robot, motion: Motion, torque: Array) -> Iterator[Margin]:
    limits = robot.limits
    q, v, a = motion.joint_positions(), motion.joint_velocities(), motion.joint_accelerations()
    peaks = jerk_peaks(motion.time, q, v, a)
    left = {
        "joint_position_rad": (
            "joint position",
            "rad",
            np.minimum(q - limits.position_lower, limits.position_upper - q),
        ),
        "joint_velocity_rad_s": ("joint velocity", "rad/s", limits.velocity - np.abs(v)),
        "joint_acceleration_rad_s2": ("joint acceleration", "rad/s²", limits.acceleration - np.abs(a)),
        "joint_jerk_rad_s3": (
            "joint jerk",
            "rad/s³",
            limits.jerk - np.maximum(np.vstack([peaks[:1], peaks]), np.vstack([peaks, peaks[-1:]])),
        ),
        "joint_torque_nm": ("joint torque", "N·m", limits.torque - np.abs(torque)),
    }
    for name, (title, unit, room) in left.items():
        known = np.where(np.isfinite(room), room, np.inf)
        where = np.argmin(known, axis=1)
        values = np.where(np.isfinite(room).all(axis=1), known[np.arange(len(room)), where], np.nan)
        yield Margin(name, title, unit, 0.0, values, where, robot.joint_names)


@lru_cache(maxsize=1)
def _geometry_data(robot: Robot) -> pin.GeometryData:
    """For all motions of a robot: no answer depends on what was asked before, and it takes 4 ms of G1's 505 pairs."""
    return geometry_data(collision_model(robot))


def _nearest_margin(robot: Robot, motion: Motion) -> tuple[Margin, NDArray[np.int64], Array] | None:
    """Distance of the nearest pair of bodies, the joints that carry them, and their nearest points."""
    geometry = collision_model(robot)
    if not len(geometry.collisionPairs):
        return None
    data, found = robot.model.createData(), _geometry_data(robot)
    n = motion.n_samples
    values, where = np.empty(n), np.empty(n, dtype=np.int64)
    joints, points = np.empty((n, 2), dtype=np.int64), np.empty((n, 6))
    objects, pairs = geometry.geometryObjects, geometry.collisionPairs
    carriers = [one.parentJoint for one in objects]
    ends = [(pair.first, pair.second) for pair in pairs]
    for k, pair in enumerate(nearest_pairs(robot, data, found, motion.q[::_EVERY])):
        result = found.distanceResults[pair]
        both = [carriers[end] for end in ends[pair]]
        near = [result.getNearestPoint1(), result.getNearestPoint2()]
        here = slice(k * _EVERY, (k + 1) * _EVERY)
        values[here], where[here] = result.min_distance, pair
        joints[here] = both
        points[here] = np.concatenate(
            [data.oMi[joint].actInv(point) for joint, point in zip(both, near, strict=True)]
        )
    # Straight between the instants of it.
    values = np.interp(np.arange(n), np.arange(0, n, _EVERY), values[::_EVERY])
    names = [one.name for one in objects]
    places = tuple(f"{names[first]} – {names[second]}" for first, second in ends)
    required = float(robot.description.collision.margin)
    margin = Margin("self_collision_m", "distance between bodies", "m", required, values, where, places)
    return margin, joints, points
