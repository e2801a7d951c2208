"""A robot as a page's replay has it: the tree of its joints, its bodies, its soles, the ground."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from defusedxml.ElementTree import fromstring
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import RobotError
from excite.logs.columns import BASE_POSE
from excite.report.replay.tracks import FRAMES_HZ, joint_bounds, pack_table, packed_indices
from excite.robot.joint_values import Limits
from excite.robot.links import link_placement
from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE, collision_shapes
from excite.robot.shapes.mesh_files import read_meshes

# Bodies of a robot as few triangles, for a picture.

Triangles = NDArray[np.int64]

# Cells along the longest side of a body, of which each keeps one corner. Of G1's 35 meshes of 290 000 triangles 24
# cells leave 58 000, 0.37 MB on the page, on which a hand's fingers can still be told; 12 leave 0.14, 48 0.77 MB.
CELLS = 24

_SHORTEST_BONE = 0.005
# Radius of a rod, as a share of the median length: looked at on a xArm 7 and a G1, of which all rods can be told.
_THICK = 0.15


@dataclass(frozen=True, eq=False)
class Body:
    """A part of a robot that moves with a joint.

    Attributes:
        link: name of its link.
        joint: index of the model joint that carries it, 0 for the world.
        corners: ``(n, 3)`` in the frame of that joint [m].
        triangles: ``(m, 3)`` indices of corners, anticlockwise from outside.
    """

    link: str
    joint: int
    corners: Array
    triangles: Triangles


def visible_bodies(robot: Robot) -> tuple[Body, ...]:
    """What is to be seen of a robot: its visual meshes, else its collision meshes or shapes, else its bones.

    Meshes are taken where all of a kind are STL, which is read at once: a Collada file takes a second, and what it
    shows beyond the collision meshes is paint. Corners are merged in a grid of :data:`CELLS` along a body.

    Returns:
        The bodies; of a robot without geometry, or whose meshes are not there, a rod from each joint to the next.
    """
    try:
        return tuple(_of_meshes(robot)) or tuple(_of_shapes(robot))
    except RobotError:
        return tuple(_bone_bodies(robot))


def merge_corners(corners: Array, triangles: Triangles, cells: int = CELLS) -> tuple[Array, Triangles]:
    """Fewer corners: those in one cell of a grid become their mean (Rossignac and Borrel 1993, section 4).

    Args:
        corners: ``(n, 3)`` [m].
        triangles: ``(m, 3)``.
        cells: along the longest side.

    Returns:
        Corners and triangles; those that became lines or points are left out, and so are their doubles.
    """
    low = corners.min(axis=0)
    size = max(float(np.ptp(corners, axis=0).max()), 1e-9) / cells
    cell = np.minimum(((corners - low) / size).astype(np.int64), cells - 1)
    key = (cell[:, 0] * cells + cell[:, 1]) * cells + cell[:, 2]
    member, used = _renumber(key, cells**3)
    count = np.bincount(member)
    means = np.column_stack([np.bincount(member, corners[:, i]) / count for i in range(3)])
    left = member[triangles]
    a, b, c = left.T
    left = left[(a != b) & (b != c) & (c != a)]
    if not len(left):
        return means, left
    # A triangle's corners in one order, beginning with the least, so that the same one is found again.
    start = np.argmin(left, axis=1)
    a, b, c = (left[np.arange(len(left)), (start + k) % 3] for k in range(3))
    n = len(used)
    each = np.unique((a * n + b) * n + c)
    left = np.column_stack([each // n**2, each // n % n, each % n])
    again, used = _renumber(left.ravel(), n)
    return means[used], again.reshape(left.shape)


def _renumber(values: NDArray[np.int64], most: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Whole numbers below ``most`` counted anew, in their order, and those that there are."""
    present = np.bincount(values, minlength=most) > 0
    return (np.cumsum(present) - 1)[values], np.flatnonzero(present)


def _of_meshes(robot: Robot) -> Iterator[Body]:
    root = fromstring(robot.urdf)
    for kind in ("visual", "collision"):
        files = [Path(m.get("filename", "")) for m in root.iterfind(f"link/{kind}/geometry/mesh")]
        if files and all(file.suffix.lower() == ".stl" for file in files):
            break
    else:
        return
    points = read_meshes(files)
    for link in root.findall("link"):
        name = link.get("name", "")
        for element in link.findall(kind):
            solid = element.find("geometry/*")
            if solid is None:
                continue
            joint, placement = link_placement(robot.model, name, robot.source, f"link {name!r}")
            if solid.tag == "mesh":
                # An STL file's corners stand triangle after triangle.
                corners = points[Path(solid.get("filename", ""))] * _element_numbers(
                    solid, "scale", (1.0, 1.0, 1.0)
                )
                triangles = np.arange(len(corners)).reshape(-1, 3)
            else:
                corners, triangles = solid_triangles(solid.tag, _solid_size(solid))
            corners, triangles = merge_corners(corners, triangles)
            yield _place_body(name, joint, placement * _element_origin(element), corners, triangles)


def _of_shapes(robot: Robot) -> Iterator[Body]:
    for shape in collision_shapes(robot):
        if shape.link == TABLE:
            continue
        if shape.vertices is not None and shape.faces is not None:
            corners, triangles = shape.vertices, shape.faces
        else:
            corners, triangles = solid_triangles(shape.kind, shape.size)
        yield _place_body(shape.link, shape.joint, shape.placement, corners, triangles)


def _bone_bodies(robot: Robot) -> Iterator[Body]:
    """Rods from each joint to those that it carries, and from the last ones through what they carry."""
    model, found = robot.model, []
    for joint in range(1, model.njoints):
        ends = [model.jointPlacements[child].translation for child in model.children[joint]]
        ends = ends or [2.0 * model.inertias[joint].lever]
        found += [(joint, np.array(end)) for end in ends if np.linalg.norm(end) > _SHORTEST_BONE]
    usual = float(np.median([np.linalg.norm(end) for _, end in found])) if found else 0.0
    for joint, end in found:
        length = float(np.linalg.norm(end))
        corners, triangles = solid_triangles("capsule", (_THICK * usual, length))
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / length)
        link = robot.segments[joint - 1].link
        yield _place_body(link, joint, pin.SE3(turn.matrix(), 0.5 * end), corners, triangles)


def _place_body(link: str, joint: int, pose: pin.SE3, corners: Array, triangles: Triangles) -> Body:
    return Body(link, joint, corners @ pose.rotation.T + pose.translation, triangles)


def _solid_size(solid: ElementTree.Element) -> tuple[float, ...]:
    if solid.tag == "box":
        return tuple(_element_numbers(solid, "size", (1.0, 1.0, 1.0)))
    return tuple(float(solid.get(name, "0")) for name in ("radius", "length") if solid.get(name))


def _element_origin(element: ElementTree.Element) -> pin.SE3:
    origin = element.find("origin")
    if origin is None:
        return pin.SE3.Identity()
    zero = (0.0, 0.0, 0.0)
    return pin.SE3(
        pin.rpy.rpyToMatrix(*_element_numbers(origin, "rpy", zero)), _element_numbers(origin, "xyz", zero)
    )


def _element_numbers(element: ElementTree.Element, name: str, otherwise: tuple[float, ...]) -> Array:
    text = element.get(name)
    return np.array(otherwise if text is None else [float(part) for part in text.split()])


# Boxes, balls, cylinders and capsules as triangles.

# Corners around: a cylinder's edge stays within 3 % of its radius.
_AROUND = 14
_RINGS = 3


def solid_triangles(kind: str, size: tuple[float, ...]) -> tuple[Array, NDArray[np.int64]]:
    """Corners ``(n, 3)`` [m] and triangles ``(m, 3)`` of a solid in its own frame, anticlockwise from outside.

    Args:
        kind: ``box``, ``sphere``, ``cylinder`` or ``capsule``; anything else has none.
        size: as of :class:`~excite.robot.shapes.shape.Shape`.
    """
    if kind == "box":
        corners, triangles = _turned_body([(-0.5, 0.5**0.5), (0.5, 0.5**0.5)], (-0.5, 0.5), 4)
        return corners * np.array(size), triangles
    if kind not in {"sphere", "cylinder", "capsule"}:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    radius, half = size[0], 0.5 * size[1] if kind != "sphere" else 0.0
    if kind == "cylinder":
        return _turned_body([(-half, radius), (half, radius)], (-half, half))
    rise = np.linspace(0.0, 0.5 * np.pi, _RINGS, endpoint=False)
    upper = [(half + radius * float(np.sin(t)), radius * float(np.cos(t))) for t in rise]
    lower = [(-height, width) for height, width in reversed(upper)]
    # A ball's two halves share their equator.
    return _turned_body(lower + upper[kind == "sphere" :], (-half - radius, half + radius))


def _turned_body(
    rings: list[tuple[float, float]], poles: tuple[float, float], around: int = _AROUND
) -> tuple[Array, NDArray[np.int64]]:
    """A body turned about z, of rings (height, radius) from below and the heights of its lowest and highest point.

    A square has corners in the diagonals, a rounder outline the first on the x axis.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False) + (0.25 * np.pi if around == 4 else 0.0)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    levels = [np.column_stack([radius * circle, np.full(around, height)]) for height, radius in rings]
    corners = np.vstack([*levels, [[0.0, 0.0, poles[0]], [0.0, 0.0, poles[1]]]])
    here, bottom = np.arange(around), len(corners) - 2
    after, last = np.roll(here, -1), (len(rings) - 1) * around
    triangles = [np.column_stack([np.full(around, bottom), after, here])]
    for below in range(0, last, around):
        above = below + around
        triangles.append(np.column_stack([below + here, below + after, above + after]))
        triangles.append(np.column_stack([below + here, above + after, above + here]))
    triangles.append(np.column_stack([last + here, last + after, np.full(around, bottom + 1)]))
    return corners, np.vstack(triangles)


# The robot that does not change in time.

# Corners are numbered with 16 bits, the last of which stands for what is not known.
_MOST_CORNERS = 65535


def robot_scene(robot: Robot) -> dict[str, Any]:
    """Everything of a robot that does not change in time, ready for JSON.

    Returns:
        ``joints``: of every model joint from 1 its ``parent`` (0 is the world), ``xyz`` and ``quat`` (x y z w) of its
        placement in the parent's frame, ``free`` for a free base, else ``turn`` and ``slide``, the axes [no unit] about
        which it turns and along which it slides, in its own frame, and ``name``. They stand as in the configuration.
        ``bodies``: see :class:`Body`. ``feet``: ``name``, ``joint``, and corners of the
        ``sole`` in its frame. ``ground``: its height [m], null where there is none.
    """
    parts = [
        {
            "link": body.link,
            "joint": body.joint,
            "corners": pack_table(body.corners),
            "triangles": packed_indices(body.triangles),
        }
        for body in visible_bodies(robot)
        if 0 < len(body.triangles) and len(body.corners) < _MOST_CORNERS
    ]
    feet = [
        {"name": foot.name, "joint": foot.joint, "sole": [_round_values(corner) for corner in foot.sole]}
        for foot in robot.feet
    ]
    table = robot.description.collision.table_height
    ground = 0.0 if robot.floating else table
    return {"joints": joint_tree(robot.model), "bodies": parts, "feet": feet, "ground": ground}


def joint_tree(model: pin.Model) -> list[dict[str, Any]]:
    """The part ``joints`` of :func:`robot_scene`: of joints with one coordinate, and a free base."""
    joints = []
    for index in range(1, model.njoints):
        placement = model.jointPlacements[index]
        joint: dict[str, Any] = {
            "name": str(model.names[index]),
            "parent": int(model.parents[index]),
            "xyz": _round_values(placement.translation),
            "quat": _round_values(pin.Quaternion(placement.rotation).coeffs()),
        }
        if model.joints[index].nq == 1:
            slide, turn = _joint_axes(model, index)
            joint |= {"turn": _round_values(turn), "slide": _round_values(slide)}
        else:
            joint["free"] = True
        joints.append(joint)
    return joints


def _joint_axes(model: pin.Model, index: int) -> tuple[Array, Array]:
    """Along which a joint of one coordinate slides and about which it turns, in its own frame, ``(3,)`` each."""
    data = model.createData()
    jacobian = pin.computeJointJacobian(model, data, pin.neutral(model), index)
    column = np.asarray(jacobian).reshape(6, model.nv)[:, model.idx_vs[index]]
    return column[:3], column[3:]


def _round_values(values: Array) -> list[float]:
    return [round(float(value), 7) + 0.0 for value in values]


# A trial of a record as a page's replay has it: the robot as it was measured, and a ghost beside it.


@dataclass(frozen=True, eq=False)
class TrialFrames:
    """A trial at :data:`~excite.report.replay.tracks.FRAMES_HZ`.

    Attributes:
        name: of the trial.
        time: ``(n,)`` [s], from zero.
        q: measured configurations, ``(n, nq)``; joints that were not recorded rest.
        ghost: what the other robot is, and its configurations, ``(n, nq)``; None without one.
        limits: of the joints.
    """

    name: str
    time: Array
    q: Array
    ghost: tuple[str, Array] | None
    limits: Limits

    def to_json(self) -> dict[str, Any]:
        """Of the content of :meth:`~excite.report.replay.tracks.Tracks.to_json` what a record tells."""
        first = self.q.shape[1] - len(self.limits.position_lower)
        signal: dict[str, Any] = {"title": "position", "unit": "rad", "from": first, "label": "measured"}
        signal["limits"] = joint_bounds(self.limits.position_lower, self.limits.position_upper)
        content: dict[str, Any] = {
            "name": self.name,
            "time": pack_table(self.time),
            "q": pack_table(self.q),
            "label": "measured",
            "signals": [signal],
        }
        if self.ghost is not None:
            label, q = self.ghost
            content["ghost"] = {"label": label, "q": pack_table(q)}
            if (q[:, first:] != self.q[:, first:]).any():
                # Where the base alone departs, joints have nothing to compare.
                signal |= {"other": pack_table(q[:, first:]), "otherLabel": label}
        return content


def trial_frames(
    robot: Robot,
    name: str,
    time: Array,
    measured: Array,
    joints: tuple[str, ...],
    *,
    base: Array | None = None,
    ghost: tuple[str, Array] | None = None,
) -> TrialFrames:
    """What is to be seen of a trial.

    Args:
        robot: the robot.
        name: of the trial.
        time: ``(n,)`` [s], increasing.
        measured: positions, ``(n, n_joints)`` [rad or m].
        joints: of the columns; those of :data:`~excite.logs.columns.BASE_POSE` are a free base's pose.
        base: poses of a free base, ``(n, 7)``: x y z qx qy qz qw; None where they were not recorded, or are columns.
        ghost: what the other robot is, and its positions, ``(n, n_joints)``.
    """
    frames = np.linspace(time[0], time[-1], max(2, round(float(time[-1] - time[0]) * FRAMES_HZ) + 1))
    here = np.tile(robot.rest, (len(frames), 1))
    if base is not None and robot.floating:
        here[:, :7] = base[np.searchsorted(time, frames).clip(0, len(time) - 1)]
    here = _posed_configurations(robot, here, joints, frames, time, measured)
    other = None
    if ghost is not None:
        other = (ghost[0], _posed_configurations(robot, here, joints, frames, time, ghost[1]))
    return TrialFrames(name, frames - frames[0], here, other, robot.limits)


def _posed_configurations(
    robot: Robot, q: Array, joints: tuple[str, ...], frames: Array, time: Array, positions: Array
) -> Array:
    """Configurations ``(n_frames, nq)`` with the joints, and the base where it is among them, at their positions."""
    found = q.copy()
    turning = [k for k, joint in enumerate(joints) if joint not in BASE_POSE]
    columns = [robot.n_base_q + robot.joint_index(joints[k]) for k in turning]
    found[:, columns] = _values_at(frames, time, positions[:, turning])
    if len(turning) < len(joints) and robot.floating:
        pose = [joints.index(name) for name in BASE_POSE]
        found[:, :7] = positions[np.searchsorted(time, frames).clip(0, len(time) - 1)][:, pose]
    return found


def _values_at(frames: Array, time: Array, values: Array) -> Array:
    return np.column_stack([np.interp(frames, time, column) for column in values.T])
