"""A convex solid on a joint: its size or corners, and the same for the collision library."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import coal
import numpy as np
import pinocchio as pin

from excite.arrays import Array, Indices

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
"""Corners of a cube of side two about the origin, ``(8, 3)``."""
_ENDS = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
_RING = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(48)])
Kind = Literal["convex", "box", "capsule", "sphere", "cylinder"]


@dataclass(frozen=True, eq=False)
class Shape:
    """A convex solid that moves with a joint.

    Attributes:
        name: unique name, ``LINK_NUMBER``.
        link: link that it belongs to (``table`` for the surface that a fixed base stands on).
        joint: index of the model joint that carries it, 0 for the world.
        placement: its pose in the frame of that joint.
        kind: ``convex``, ``box``, ``capsule``, ``sphere`` or ``cylinder``.
        size: [m] box: full lengths along x, y, z; sphere: radius; capsule and cylinder: radius and
            length along z (of a capsule: without its caps); empty for ``convex``.
        vertices: corners of a ``convex`` in its own frame, ``(n, 3)`` [m], else None.
        faces: triangles of a ``convex`` as vertex indices, ``(m, 3)``, anticlockwise from outside, else None.
    """

    name: str
    link: str
    joint: int
    placement: pin.SE3
    kind: Kind
    size: tuple[float, ...] = ()
    vertices: Array | None = None
    faces: Indices | None = None

    @property
    def radius(self) -> float:
        """Of a sphere, capsule or cylinder [m]; zero of others."""
        return 0.0 if self.kind in {"convex", "box"} else self.size[0]

    @property
    def core(self) -> Array:
        """Points ``(n, 3)`` [m] whose hull, widened by a ball (or a cylinder's disc) of :attr:`radius`, it is."""
        if self.vertices is not None:
            return self.vertices
        if self.kind == "box":
            return np.asarray(0.5 * CORNERS * np.array(self.size))
        return 0.5 * self.size[-1] * _ENDS if len(self.size) == 2 else np.zeros((1, 3))


def coal_geometry(shape: Shape) -> coal.CollisionGeometry:
    """The coal geometry of a shape, in the shape's own frame."""
    if shape.kind == "convex":
        points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for vertex in shape.vertices if shape.vertices is not None else ():
            points.append(vertex)
        for face in shape.faces if shape.faces is not None else ():
            triangles.append(coal.Triangle(*(int(i) for i in face)))
        geometry = coal.Convex(points, triangles)
    else:
        makers = {"box": coal.Box, "capsule": coal.Capsule, "sphere": coal.Sphere, "cylinder": coal.Cylinder}
        geometry = makers[shape.kind](*shape.size)
    geometry.computeLocalAABB()
    return geometry


def shape_points(shape: Shape) -> Array:
    """Corners of a shape, or of the box around a round one, in the frame of its joint, ``(n, 3)`` [m]."""
    points = shape.core
    if shape.radius:
        wide = np.array([1.0, 1.0, shape.kind != "cylinder"])
        points = (np.abs(points).max(axis=0) + shape.radius * wide) * CORNERS
    return place_points(points, shape.placement)


def shape_bounds(shape: Shape) -> tuple[Array, Array]:
    """Lower and upper corner of a shape's bounding box in the frame of its joint, each ``(3,)`` [m]."""
    points, axis = place_points(shape.core, shape.placement), shape.placement.rotation[:, 2]
    wide = np.sqrt(np.maximum(0.0, 1.0 - axis**2)) if shape.kind == "cylinder" else np.ones(3)
    return points.min(axis=0) - shape.radius * wide, points.max(axis=0) + shape.radius * wide


def bottom_points(shape: Shape, joint: pin.SE3) -> Array:
    """Points of a shape's surface, its lowest among them, ``(n, 3)`` [m], the shape's joint being at ``joint``."""
    pose, down = joint * shape.placement, np.array([0.0, 0.0, -1.0])
    points = place_points(shape.core, pose)
    if shape.kind != "cylinder":
        return np.asarray(points + shape.radius * down)
    slope = down - (down @ pose.rotation[:, 2]) * pose.rotation[:, 2]
    if np.linalg.norm(slope) > 0.05:
        return np.asarray(points + shape.radius * slope / np.linalg.norm(slope))
    return _widen_points(points, shape.radius * _RING[::4] @ pose.rotation.T)


def outline_points(shape: Shape) -> Array:
    """Points whose hull contains a solid and is at most a thirtieth wider, in the solid's frame ``(n, 3)`` [m]."""
    if not shape.radius:
        return shape.core
    # A polygon around the circle; a ball has such rings at nine heights.
    tilts = [0.0] if shape.kind == "cylinder" else np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)
    rings = [np.cos(tilt) * _RING[::3] + [0.0, 0.0, np.sin(tilt)] for tilt in tilts]
    return _widen_points(shape.core, shape.radius / np.cos(np.pi / 16) * np.vstack(rings))


def joints_at(model: pin.Model, q: Array) -> pin.Data:
    """Data of a model whose joints, ``oMi``, are placed as at a configuration ``(nq,)``."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    return data


def place_points(points: Array, pose: pin.SE3) -> Array:
    """Points ``(n, 3)`` of a frame in that which it has a pose in."""
    return np.asarray(points @ pose.rotation.T + pose.translation)


def _widen_points(points: Array, steps: Array) -> Array:
    return np.asarray(points[:, None] + steps).reshape(-1, 3)


def has_area(corners: Array) -> bool:
    """Whether points ``(n, 2)`` span a polygon, wider than :data:`_NARROW`, on which a robot could stand."""
    if len(corners) < 3:
        return False
    # Twice the spread across the narrowest direction is about the polygon's half width.
    # Half the margin that the balance check asks for on either side [m]: nothing narrower can be safe.
    return bool(np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)[-1] > 0.015)
