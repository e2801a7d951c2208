"""A convex solid on a joint: its size or corners, and the same for the collision library."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
"""Corners of a cube of side two about the origin, ``(8, 3)``."""
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
    faces: NDArray[np.int64] | None = None


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
    """Corners of a shape, or of the box around it, in the frame of its joint, ``(n, 3)`` [m]."""
    if shape.vertices is not None:
        points = shape.vertices
    else:
        radius, length = shape.size[0], shape.size[-1]
        half = {
            "box": 0.5 * np.array(shape.size),
            "sphere": np.full(3, radius),
            "cylinder": np.array([radius, radius, 0.5 * length]),
            "capsule": np.array([radius, radius, 0.5 * length + radius]),
        }[shape.kind]
        points = half * CORNERS
    return np.asarray(points @ shape.placement.rotation.T + shape.placement.translation)


# Whether feet span an area on which a robot could stand.

# Half the margin that the balance check asks for on either side [m]: nothing narrower can be safe.
_NARROW = 0.015


def has_area(corners: Array) -> bool:
    """Whether points ``(n, 2)`` span a polygon, wider than :data:`_NARROW`, on which a robot could stand."""
    if len(corners) < 3:
        return False
    # Twice the spread across the narrowest direction is about the polygon's half width.
    return bool(np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)[-1] > _NARROW)
