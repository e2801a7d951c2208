"""A motion over time as a page's replay has it: configurations, balance, contact, and the margins of every limit."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, Flags, Indices
from excite.errors import ExciteError
from excite.motion.motion import Motion, jerk_peaks
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


class Margin(NamedTuple):
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
    where: Indices
    places: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Ready for the page."""
        used, where = np.unique(self.where, return_inverse=True)
        title, unit = MARGINS[self.name]
        return {
            "name": self.name,
            "title": title,
            "unit": unit,
            "required": self.required,
            "values": pack_table(self.values),
            "where": packed_indices(where),
            "places": [self.places[int(i)] for i in used],
        }


class Nearest(NamedTuple):
    """The two nearest bodies over time.

    Attributes:
        joints: that carry them, ``(n, 2)``.
        points: nearest points of the two, each in the frame of its joint, ``(n, 6)`` [m].
    """

    joints: Indices
    points: Array


class Tracks(NamedTuple):
    """A motion at :data:`FRAMES_HZ`.

    Attributes:
        robot: that moves.
        motion: at those instants.
        com: centre of mass on the ground's plane, ``(n, 3)`` [m], world frame.
        zmp: zero-moment point on the ground, ``(n, 2)`` [m]; None of a robot without feet.
        contacts: ``(n, n_feet)``.
        torque: that the drives must deliver, ``(n, n_joints)`` [N·m or N].
        nearest: bodies; None without geometry.
        margins: of what applies to the robot.
    """

    robot: Robot
    motion: Motion
    com: Array
    zmp: Array | None
    contacts: Flags
    torque: Array
    nearest: Nearest | None
    margins: tuple[Margin, ...]

    def to_json(self) -> dict[str, Any]:
        """Ready for the page: ``name``, ``time``, ``q``, ``com``, ``zmp``, ``contacts``, ``signals``, ``margins``, …"""
        motion, limits, nearest = self.motion, self.robot.limits, self.nearest
        bounds = (limits.velocity, limits.torque)
        speed, torque = ([-most, most] for most in bounds)
        return {
            "name": motion.name,
            "time": pack_table(motion.time - motion.time[0]),
            "q": pack_table(motion.q),
            "com": pack_table(self.com),
            "zmp": None if self.zmp is None else pack_table(self.zmp),
            "contacts": packed_indices(self.contacts) if self.contacts.size else None,
            # Positions are those that the configurations hold.
            "signals": [
                {
                    "title": "position",
                    "unit": "rad",
                    "from": self.robot.n_base_q,
                    "limits": joint_bounds(limits.position_lower, limits.position_upper),
                },
                {
                    "title": "velocity",
                    "unit": "rad/s",
                    "values": pack_table(motion.joint_velocities()),
                    "limits": joint_bounds(*speed),
                },
                {
                    "title": "torque",
                    "unit": "N·m",
                    "values": pack_table(self.torque),
                    "limits": joint_bounds(*torque),
                },
            ],
            "closest": None
            if nearest is None
            else {"joints": packed_indices(nearest.joints), "points": pack_table(nearest.points)},
            "margins": [margin.to_json() for margin in self.margins],
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
    # A rate below the motion's own leaves the motion's own.
    sweep = Sweep(robot, motion.resampled(robot, FRAMES_HZ), 1.0)
    n = sweep.fine.n_samples
    torque = np.full((n, robot.n_joints), np.nan)
    torque[sweep.torque_samples] = drive_torques(sweep)
    margins, nearest = [*_limit_margins(robot, sweep.fine, torque)], None
    with suppress(ExciteError):  # A robot without geometry; the check says so.
        nearest = _nearest_bodies(sweep, margins)
    if robot.feet:
        edge = support_margin(sweep, sweep.zmp)
        margins.append(Margin("zmp_m", ZMP_MARGIN, edge, np.zeros(n, dtype=np.int64), ("support polygon",)))
    return Tracks(
        robot,
        sweep.fine,
        sweep.dynamics.com,
        sweep.zmp if robot.feet else None,
        sweep.contacts,
        torque,
        nearest,
        tuple(margins),
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
        values = np.where(np.isfinite(room).all(axis=1), known.min(axis=1), np.nan)
        yield Margin(name, 0.0, values, np.argmin(known, axis=1), robot.joint_names)


@lru_cache(maxsize=1)
def _geometry_data(robot: Robot) -> pin.GeometryData:
    """For all motions of a robot: it takes 4 ms of G1's 505 pairs, and more the first time."""
    return geometry_data(watched_model(robot)[0])


def _nearest_bodies(sweep: Sweep, margins: list[Margin]) -> Nearest | None:
    """The nearest pair of bodies, and the margin of its distance, which is added."""
    robot, motion, distances = sweep.robot, sweep.fine, Distances(sweep)
    if not distances.n_pairs:
        return None
    geometry, data, found = distances.geometry, robot.model.createData(), _geometry_data(robot)
    objects = geometry.geometryObjects
    ends = [(objects[pair.first], objects[pair.second]) for pair in geometry.collisionPairs]
    pairs, joints, points = [], [], []
    for k, (pair, least) in enumerate(nearest_pairs(distances, motion.time[::_EVERY])):
        pin.updateGeometryPlacements(robot.model, data, geometry, found, motion.q[k * _EVERY])
        result = pin.computeDistance(geometry, found, pair)
        both = [body.parentJoint for body in ends[pair]]
        near = (result.getNearestPoint1(), result.getNearestPoint2())
        pairs.append((pair, least))
        joints.append(both)
        points.append(
            np.concatenate([data.oMi[j].actInv(point) for j, point in zip(both, near, strict=True)])
        )
    n, (which, least) = motion.n_samples, np.array(pairs).T
    here = np.arange(n) // _EVERY
    # Straight between the instants of it.
    values = np.interp(np.arange(n), np.arange(0, n, _EVERY), least)
    places = tuple(f"{first.name} – {second.name}" for first, second in ends)
    margin = float(robot.description.collision.margin)
    margins.append(Margin("self_collision_m", margin, values, which.astype(np.int64)[here], places))
    return Nearest(np.array(joints)[here], np.array(points)[here])


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
    table = np.asarray(values, dtype=float).reshape(len(values), -1)
    known = np.isfinite(table)
    low, high = (
        np.nan_to_num(end(table, axis=0, where=known, initial=far), posinf=0.0, neginf=0.0)
        for end, far in ((np.min, np.inf), (np.max, -np.inf))
    )
    step = (high - low) / _STEPS
    scaled = np.divide(table - low, step, out=np.zeros_like(table), where=known & (step > 0.0))
    return _pack_numbers(np.where(known, np.rint(scaled), _UNKNOWN), low, step)


def packed_indices(values: NDArray[Any]) -> dict[str, Any]:
    """Whole numbers below 65536, ``(n, m)`` or ``(n,)``, kept as they are."""
    table = np.asarray(values).reshape(len(values), -1)
    return _pack_numbers(table, np.zeros(table.shape[1]), np.ones(table.shape[1]))


def _pack_numbers(numbers: NDArray[Any], low: Array, step: Array) -> dict[str, Any]:
    # Column after column: neighbours in time are alike, neighbours in a row are not.
    # Level 6, for 9 takes half as long again to save 0.1 % of the motions' size.
    differences = np.diff(numbers.astype("<u2"), axis=0, prepend=np.zeros((1, len(low)), "<u2"))
    data = base64.b64encode(zlib.compress(np.ascontiguousarray(differences.T).tobytes(), 6))
    return {"rows": len(numbers), "low": low.tolist(), "step": step.tolist(), "data": data.decode("ascii")}
