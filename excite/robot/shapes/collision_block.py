"""What ``robot.yaml`` says about collision geometry."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from excite.robot.per_joint import Block, Source
from excite.robot.quantities import Coordinate, Length, Margin, Rotation3, Vector3

# A hull's planes and corners are compared pairwise: 2000 take seconds and 100 MB.
MAX_HULL_CORNERS = 2000


class CollisionShape(Block):
    """An authored collision primitive on a link; ``size`` is metres: radius | radius, length | x, y, z."""

    link: str
    kind: Literal["sphere", "capsule", "box"]
    size: tuple[Length, ...]
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Rotation3 = (0.0, 0.0, 0.0)


class NearPair(Block):
    """Two links that rest nearer to each other than the margin, and the distance that they keep in its place [m].

    It is negative where their shapes overlap: hulls are larger than what turns in them.
    """

    links: tuple[str, str]
    distance: Coordinate


class CollisionBlock(Block):
    """Collision geometry: convex hulls of the URDF's meshes, or authored primitives.

    ``geometry`` names the elements of the URDF: ``either`` takes ``collision``, and ``visual`` of links without any.
    ``hull_corners`` is how many corners a hull may have; more of them hug the mesh closer, which parts need that
    pass each other within millimetres. ``ignored_pairs`` are pairs of links that may touch or that cannot reach
    each other; ``near_pairs`` keep distances of their own in place of ``margin``. ``stand_ins`` are links whose
    geometry is missing in whole or in part: what cannot be read of it is passed over, and their ``shapes`` stand in for
    it. ``table_height`` is that of the ground or a table [m, in the base's frame]; null: there is none. Where a
    fixed base does not say, it is the plane that it is mounted on.
    """

    geometry: Literal["collision", "visual", "either", "authored"]
    hull_corners: Annotated[int, Field(ge=32, le=MAX_HULL_CORNERS)] = 96
    shapes: tuple[CollisionShape, ...] = ()
    stand_ins: tuple[str, ...] = ()
    ignored_pairs: tuple[tuple[str, str], ...] = ()
    near_pairs: tuple[NearPair, ...] = ()
    margin: Margin
    table_height: Coordinate | None = None
    source: Source
