"""A motion over time as a page's replay has it: configurations, balance, contact, and the margins of every limit."""

from __future__ import annotations

import base64
import zlib
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
from excite.robot.joint_values import Limits
from excite.robot.robot import Robot
from excite.robot.shapes.collision import geometry_data, watched_model
from excite.safety.checks.collision import Distances
from excite.safety.checks.ground import ZMP_MARGIN, support_margin
from excite.safety.checks.joints import drive_torques
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import MARGINS

# Instants a second: between two of them at 10 rad/s² a joint strays 1.4 mrad from a straight line, which nobody sees.
FRAMES_HZ = 30.0
# Of distances every third, as the check begins: 0.3 ms each of G1's 505 pairs, which else were most of the page's time.
_EVERY = 3
# Distances that are asked for at once: those of the first may show that the others are farther.
_TOGETHER = 8


@dataclass(frozen=True, eq=False)
class Margin:
    """How far a motion stays from one kind of limit, over time.

    Attributes:
        name: field of :class:`~excite.safety.verdict.Margins`.
        required: what the check asks for.
        values: ``(n,)``, NaN where it cannot be computed.
        where: ``(n,)`` index in ``places`` of what is nearest to its limit.
        places: joints, or pairs of bodies.
    """

    name: str
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
    title, unit = MARGINS[margin.name]
    return {
        "name": margin.name,
        "title": title,
        "unit": unit,
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
        nearest = _nearest_margin(sweep)
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
        margins.append(Margin("zmp_m", ZMP_MARGIN, edge, where, ("support polygon",)))
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
    jerk = np.maximum(np.vstack([peaks[:1], peaks]), np.vstack([peaks, peaks[-1:]]))
    left = {
        "joint_position_rad": np.minimum(q - limits.position_lower, limits.position_upper - q),
        "joint_velocity_rad_s": limits.velocity - np.abs(v),
        "joint_acceleration_rad_s2": limits.acceleration - np.abs(a),
        "joint_jerk_rad_s3": limits.jerk - jerk,
        "joint_torque_nm": limits.torque - np.abs(torque),
    }
    for name, room in left.items():
        known = np.where(np.isfinite(room), room, np.inf)
        where = np.argmin(known, axis=1)
        values = np.where(np.isfinite(room).all(axis=1), known[np.arange(len(room)), where], np.nan)
        yield Margin(name, 0.0, values, where, robot.joint_names)


@lru_cache(maxsize=1)
def _geometry_data(robot: Robot) -> pin.GeometryData:
    """For all motions of a robot: it takes 4 ms of G1's 505 pairs, and more the first time."""
    return geometry_data(watched_model(robot)[0])


def _nearest_margin(sweep: Sweep) -> tuple[Margin, NDArray[np.int64], Array] | None:
    """Distance of the nearest pair of bodies, the joints that carry them, and their nearest points."""
    robot, motion, distances = sweep.robot, sweep.fine, Distances(sweep)
    geometry = distances.geometry
    if not distances.n_pairs:
        return None
    data, found = robot.model.createData(), _geometry_data(robot)
    n = motion.n_samples
    values, where = np.empty(n), np.empty(n, dtype=np.int64)
    joints, points = np.empty((n, 2), dtype=np.int64), np.empty((n, 6))
    objects = geometry.geometryObjects
    ends = [(objects[pair.first], objects[pair.second]) for pair in geometry.collisionPairs]
    for k, (pair, least) in enumerate(nearest_pairs(distances, motion.time[::_EVERY])):
        pin.updateGeometryPlacements(robot.model, data, geometry, found, motion.q[k * _EVERY])
        result = pin.computeDistance(geometry, found, pair)
        both = [body.parentJoint for body in ends[pair]]
        near = [result.getNearestPoint1(), result.getNearestPoint2()]
        here = slice(k * _EVERY, (k + 1) * _EVERY)
        values[here], where[here], joints[here] = least, pair, both
        local = (data.oMi[joint].actInv(point) for joint, point in zip(both, near, strict=True))
        points[here] = np.concatenate([*local])
    # Straight between the instants of it.
    values = np.interp(np.arange(n), np.arange(0, n, _EVERY), values[::_EVERY])
    places = tuple(f"{first.name} – {second.name}" for first, second in ends)
    margin = Margin("self_collision_m", float(robot.description.collision.margin), values, where, places)
    return margin, joints, points


def nearest_pairs(distances: Distances, times: Array) -> Iterator[tuple[int, float]]:
    """The pair of least distance and that distance [m], at one time after the other.

    No distance is computed of pairs that balls about their bodies keep further apart than another pair is, nor of
    those that were so far apart that they cannot have come as near since.
    """
    least, ways = distances.at_least(times), distances.ways(times)
    nearest = 0
    for k, here in enumerate(least):
        time = float(times[k])
        if k:
            np.maximum(here, least[k - 1] - ways[k - 1], out=here)
        # The pair that was nearest before is near still, and few can be nearer.
        here[nearest] = distances.at(time, np.array([nearest]))[0]
        open_ = np.flatnonzero(here < here[nearest])
        while len(open_):
            few = open_[np.argsort(here[open_])[:_TOGETHER]]
            here[few] = distances.at(time, few)
            nearest = min([nearest, *few.tolist()], key=lambda pair: here[pair])
            rest = np.setdiff1d(open_, few)
            open_ = rest[here[rest] < here[nearest]]
        yield nearest, float(here[nearest])


# Arrays as a page carries them: 16 bits a number, differences in time, compressed, in base64.
#
# A number is known to a 65535th of its column's range, which of an angle over a whole turn is 0.1 mrad and of
# a metre 15 µm: less than a picture shows, and a quarter of single precision's size once neighbours are
# compressed.

_STEPS = 65534
# Stands for NaN.
_UNKNOWN = 65535


def pack_table(values: Array) -> dict[str, Any]:
    """A table of numbers, ``(n, m)`` or ``(n,)``, each column scaled by itself; what is not finite becomes NaN.

    Returns:
        ``rows``, ``low`` and ``step`` (one a column), and ``data``.
    """
    table = np.asarray(values, dtype=float)
    table = table.reshape(len(table), -1)
    known = np.isfinite(table)
    low = np.min(table, axis=0, where=known, initial=np.inf)
    high = np.max(table, axis=0, where=known, initial=-np.inf)
    low, high = (np.where(np.isfinite(end), end, 0.0) for end in (low, high))
    step = (high - low) / _STEPS
    scaled = np.divide(table - low, step, out=np.zeros_like(table), where=known & (step > 0.0))
    numbers = np.where(known, np.rint(scaled), _UNKNOWN).astype(np.uint16)
    return {
        "rows": len(table),
        "low": low.tolist(),
        "step": step.tolist(),
        "data": _compress_differences(
            np.diff(numbers, axis=0, prepend=np.zeros((1, numbers.shape[1]), np.uint16))
        ),
    }


def unpack_table(block: dict[str, Any]) -> Array:
    """The table of :func:`pack_table`, ``(n, m)``."""
    low, step = np.array(block["low"]), np.array(block["step"])
    numbers = np.frombuffer(zlib.decompress(base64.b64decode(block["data"])), "<u2")
    numbers = np.cumsum(numbers.reshape(len(low), block["rows"]).T, axis=0, dtype=np.uint16)
    return np.where(numbers == _UNKNOWN, np.nan, low + step * numbers)


def packed_indices(values: NDArray[Any]) -> dict[str, Any]:
    """Whole numbers below 65536, ``(n, m)`` or ``(n,)``, kept as they are."""
    table = np.asarray(values).astype(np.uint16)
    table = table.reshape(len(table), -1)
    first = np.zeros((1, table.shape[1]), np.uint16)
    width = table.shape[1]
    return {
        "rows": len(table),
        "low": [0.0] * width,
        "step": [1.0] * width,
        "data": _compress_differences(np.diff(table, axis=0, prepend=first)),
    }


def _compress_differences(differences: NDArray[np.uint16]) -> str:
    # Column after column: neighbours in time are alike, neighbours in a row are not.
    # Level 6, for 9 takes half as long again to save 0.1 % of the motions' size.
    content = np.ascontiguousarray(differences.T).astype("<u2").tobytes()
    return base64.b64encode(zlib.compress(content, 6)).decode("ascii")
