"""A robot as a page's replay has it: its joints, bodies and soles, the ground; and a trial of a record."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from defusedxml.ElementTree import fromstring

from excite.arrays import Array, Indices
from excite.errors import RobotError
from excite.motion.content import BASE_POSE
from excite.report.replay.tracks import FRAMES_HZ, joint_bounds, pack_table, packed_indices
from excite.robot.links import link_placement
from excite.robot.robot import Robot
from excite.robot.shapes.collision import SURROUNDINGS, collision_shapes
from excite.robot.shapes.link_shapes import hull_faces, numbers_of
from excite.robot.shapes.mesh_files import read_meshes
from excite.robot.shapes.shape import Shape, place_points
from excite.robot.urdf.numbers import read_origin

# Bodies of a robot as few triangles, for a picture.

Triangles = Indices

# Cells along the longest side of a body, of which each keeps one corner. Of G1's 35 meshes of 290 000 triangles 24
# cells leave 58 000, 0.37 MB on the page, on which a hand's fingers can still be told; 12 leave 0.14, 48 0.77 MB.
CELLS = 24


class Body(NamedTuple):
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
    with suppress(RobotError):
        if meshes := tuple(_mesh_bodies(robot)):
            return meshes
    return shape_bodies(robot)


@lru_cache(maxsize=1)
def shape_bodies(robot: Robot) -> tuple[Body, ...]:
    """What robots are judged to touch with: their collision shapes, without a table; else rods as above."""
    try:
        shapes = [shape for shape in collision_shapes(robot) if shape.link not in SURROUNDINGS]
    except RobotError:
        return tuple(_bone_bodies(robot))
    return tuple(_place_body(s.link, s.joint, s.placement, *shape_triangles(s)) for s in shapes)


def merge_corners(corners: Array, triangles: Triangles) -> tuple[Array, Triangles]:
    """Fewer corners: those in one cell of a grid become their mean (Rossignac and Borrel 1993, section 4).

    Args:
        corners: ``(n, 3)`` [m].
        triangles: ``(m, 3)``.

    Returns:
        Corners and triangles; those that became lines or points are left out, and so are their doubles.
    """
    size = max(float(np.ptp(corners, axis=0).max()), 1e-9) / CELLS
    cell = np.minimum(((corners - corners.min(axis=0)) / size).astype(np.int64), CELLS - 1)
    _, member = np.unique(cell @ [CELLS**2, CELLS, 1], return_inverse=True)
    means = (
        np.column_stack([np.bincount(member, column) for column in corners.T]) / np.bincount(member)[:, None]
    )
    left = member[triangles]
    left = left[(left != np.roll(left, 1, axis=1)).all(axis=1)]
    # A triangle's corners in one order, beginning with the least, so that the same one is found again.
    order = (np.argmin(left, axis=1)[:, None] + np.arange(3)) % 3
    left = np.take_along_axis(left, order, axis=1)
    _, first = np.unique(left @ [len(means) ** 2, len(means), 1], return_index=True)
    used, again = np.unique(left[first], return_inverse=True)
    return means[used], again.reshape(-1, 3)


def _mesh_bodies(robot: Robot) -> Iterator[Body]:
    root = fromstring(robot.urdf)
    for kind in ("visual", "collision"):
        files = [Path(m.get("filename", "")) for m in root.iterfind(f"link/{kind}/geometry/mesh")]
        if files and all(file.suffix.lower() == ".stl" for file in files):
            break
    else:
        return
    points = read_meshes(files)
    pairs = [(link, element) for link in root.findall("link") for element in link.findall(kind)]
    for link, element in pairs:
        solid, name = element.find("geometry/*"), link.get("name", "")
        if solid is None:
            continue
        if solid.tag == "mesh":
            # An STL file's corners stand triangle after triangle.
            corners = points[Path(solid.get("filename", ""))] * numbers_of(solid.get("scale", "1 1 1"))
            triangles = np.arange(len(corners)).reshape(-1, 3)
        else:
            sizes = [solid.get(name, "") for name in ("size", "radius", "length")]
            corners, triangles = solid_triangles(solid.tag, tuple(numbers_of(" ".join(sizes))))
        joint, placement = link_placement(robot.model, name, robot.source, f"link {name!r}")
        placement = placement * read_origin(element)
        yield _place_body(name, joint, placement, *merge_corners(corners, triangles))


def _bone_bodies(robot: Robot) -> Iterator[Body]:
    """Rods from each joint to those that it carries, and from the last ones through what they carry."""
    model, found = robot.model, []
    for joint in range(1, model.njoints):
        ends = [model.jointPlacements[child].translation for child in model.children[joint]]
        ends = ends or [2.0 * model.inertias[joint].lever]
        found += [(joint, np.array(end)) for end in ends if np.linalg.norm(end) > 0.005]
    usual = float(np.median([np.linalg.norm(end) for _, end in found])) if found else 0.0
    for joint, end in found:
        length = float(np.linalg.norm(end))
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / length)
        # Radius of a rod, as a share of the median length: looked at on a xArm 7 and a G1, of which all rods can be
        # told.
        rod = solid_triangles("capsule", (0.15 * usual, length))
        yield _place_body(robot.segments[joint - 1].link, joint, pin.SE3(turn.matrix(), 0.5 * end), *rod)


def _place_body(link: str, joint: int, pose: pin.SE3, corners: Array, triangles: Triangles) -> Body:
    return Body(link, joint, place_points(corners, pose), triangles)


def shape_triangles(shape: Shape) -> tuple[Array, Triangles]:
    """Corners ``(n, 3)`` [m] and triangles ``(m, 3)`` of a shape in its own frame; round ones within 3 %."""
    if shape.vertices is not None and shape.faces is not None:
        return shape.vertices, shape.faces
    return solid_triangles(shape.kind, shape.size)


def solid_triangles(kind: str, size: tuple[float, ...]) -> tuple[Array, Triangles]:
    """Corners ``(n, 3)`` [m] and triangles ``(m, 3)`` of a solid in its own frame, anticlockwise from outside.

    Args:
        kind: ``box``, ``sphere``, ``cylinder`` or ``capsule``; anything else has none.
        size: as of :class:`~excite.robot.shapes.shape.Shape`.
    """
    if kind not in {"box", "sphere", "cylinder", "capsule"}:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    # Where corners lie on the solid of radius one, or side one, and how the length lifts them; it may have no extent.
    if kind == "box":
        spread, scale, half = np.array(list(product((-0.5, 0.5), repeat=3))), size, 0.0
        lift = np.zeros_like(spread)
    else:
        scale, half = (size[0],), 0.0 if kind == "sphere" else 0.5 * size[1]
        rise = np.linspace(0.0, 0.5 * np.pi, 1 if kind == "cylinder" else 4)[:, None]
        # Corners around a round solid, whose edge stays within 3 % of its radius, and rings from its equator to its
        # pole.
        turn = np.linspace(0.0, 2.0 * np.pi, 14, endpoint=False)
        around = (np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise) + 0.0 * turn)
        upper = np.stack(around, axis=-1).reshape(-1, 3)
        spread = np.vstack([upper, upper * [1.0, 1.0, -1.0]])
        lift = np.outer(np.repeat([1.0, -1.0], len(upper)), [0.0, 0.0, 1.0])
    used, triangles = hull_faces(spread + (kind != "sphere") * lift)
    return (spread * scale + half * lift)[used], triangles


def robot_scene(robot: Robot) -> dict[str, Any]:
    """Everything of a robot that does not change in time, ready for JSON.

    Returns:
        ``joints``: of every model joint from 1 its ``parent`` (0 is the world), ``xyz`` and ``quat`` (x y z w) of its
        placement in the parent's frame, ``free`` for a free base, else ``turn`` and ``slide``, the axes [no unit] about
        which it turns and along which it slides, in its own frame, and ``name``. They stand as in the configuration.
        ``bodies``: see :class:`Body`. ``feet``: ``name``, ``joint``, and corners of the
        ``sole`` in its frame. ``ground``: its height [m], null where there is none.
    """
    # Corners are numbered with 16 bits, the last of which stands for what is not known.
    bodies = [
        body._asdict() | {"corners": pack_table(body.corners), "triangles": packed_indices(body.triangles)}
        for body in visible_bodies(robot)
        if 0 < len(body.triangles) and len(body.corners) < 65535
    ]
    feet = [
        {"name": foot.name, "joint": foot.joint, "sole": [_round_values(corner) for corner in foot.sole]}
        for foot in robot.feet
    ]
    ground = 0.0 if robot.floating else robot.description.collision.table_height
    return {"joints": joint_tree(robot.model), "bodies": bodies, "feet": feet, "ground": ground}


def joint_tree(model: pin.Model) -> list[dict[str, Any]]:
    """The part ``joints`` of :func:`robot_scene`: of joints with one coordinate, and a free base."""
    joints, data, rest = [], model.createData(), pin.neutral(model)
    for index in range(1, model.njoints):
        placement = model.jointPlacements[index]
        joint: dict[str, Any] = {
            "name": str(model.names[index]),
            "parent": int(model.parents[index]),
            "xyz": _round_values(placement.translation),
            "quat": _round_values(pin.Quaternion(placement.rotation).coeffs()),
        }
        if model.joints[index].nq == 1:
            # Along which it slides and about which it turns, in its own frame.
            jacobian = np.asarray(pin.computeJointJacobian(model, data, rest, index)).reshape(6, model.nv)
            slide, turn = np.split(jacobian[:, model.idx_vs[index]], 2)
            joint |= {"turn": _round_values(turn), "slide": _round_values(slide)}
        else:
            joint["free"] = True
        joints.append(joint)
    return joints


def _round_values(values: Array) -> list[float]:
    return [round(float(value), 7) + 0.0 for value in values]


# A trial of a record: the robot as it was measured, and a ghost beside it.


def trial_track(
    robot: Robot,
    name: str,
    time: Array,
    measured: Array,
    joints: tuple[str, ...],
    *,
    base: Array | None = None,
    ghost: tuple[str, Array] | None = None,
) -> dict[str, Any]:
    """What is to be seen of a trial at :data:`~excite.report.replay.tracks.FRAMES_HZ`, ready for the page.

    Args:
        time: ``(n,)`` [s], increasing.
        measured: positions, ``(n, n_joints)`` [rad or m].
        joints: of the columns; those of :data:`~excite.motion.content.BASE_POSE` are a free base's pose.
        base: poses of a free base, ``(n, 7)``: x y z qx qy qz qw; None where they were not recorded, or are columns.
        ghost: what the other robot is, and its positions, ``(n, n_joints)``.
    """
    frames, first = frame_times(time), robot.n_base_q
    nearest = np.searchsorted(time, frames).clip(0, len(time) - 1)
    turning = [k for k, joint in enumerate(joints) if joint not in BASE_POSE]
    columns = [first + robot.joint_index(joints[k]) for k in turning]
    rest = np.tile(robot.rest, (len(frames), 1))
    if base is not None and robot.floating:
        rest[:, :7] = base[nearest]

    def pose_robot(positions: Array) -> Array:
        """Configurations with the joints, and the base where it is among them, at their positions."""
        found = rest.copy()
        found[:, columns] = np.column_stack([np.interp(frames, time, positions[:, k]) for k in turning])
        if len(turning) < len(joints) and robot.floating:
            found[:, :7] = positions[nearest][:, [joints.index(one) for one in BASE_POSE]]
        return found

    q, limits = pose_robot(measured), joint_bounds(robot.limits.position_lower, robot.limits.position_upper)
    signal = {"title": "position", "unit": "rad", "from": first, "label": "measured", "limits": limits}
    content: dict[str, Any] = {
        "name": name,
        "time": pack_table(frames - frames[0]),
        "q": pack_table(q),
        "label": "measured",
        "signals": [signal],
    }
    if ghost is not None:
        label, other = ghost[0], pose_robot(ghost[1])
        content["ghost"] = {"label": label, "q": pack_table(other)}
        if (other[:, first:] != q[:, first:]).any():
            # Where the base alone departs, joints have nothing to compare.
            signal |= {"other": pack_table(other[:, first:]), "otherLabel": label}
    return content


def frame_times(time: Array) -> Array:
    """Instants of a trial that are shown, ``(n_frames,)`` [s]."""
    seconds = float(time[-1] - time[0])
    return np.linspace(time[0], time[-1], max(2, round(seconds * FRAMES_HZ) + 1))
