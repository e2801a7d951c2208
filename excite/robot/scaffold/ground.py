"""The ground below a fixed base: never absent, so that no motion reaches through it unseen."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.robot.scaffold.limbs import Figure, bottom

# Hulls of meshes stand out below a mounting plane by a hundredth of their size [m].
_FLANGE = 0.02


def ground_height(figure: Figure, rest: Array) -> float:
    """Height of the ground in the base's frame [m].

    It is the plane that the base is mounted on: that of its frame, or its lowest point where it stands on a pedestal.
    Of a robot that hangs, most of whose mass rests lower, it lies below all that the robot may reach.

    Args:
        figure: the robot, base fixed.
        rest: its posture of rest ``(n_joints,)``.
    """
    low = figure.lowest(rest)
    base = low.get(0, 0.0)
    plane = base if base < -_FLANGE else 0.0
    centre = figure.centre(rest)
    if centre[2] >= plane - _FLANGE:
        return plane
    reach = sum(float(np.linalg.norm(place.translation)) for place in list(figure.model.jointPlacements)[1:])
    return min(plane, min(low.values())) - reach - 0.1


def links_below(figure: Figure, rest: Array, ground: float) -> list[str]:
    """Links at or below the ground at rest, which are excepted from keeping away from it."""
    figure.lowest(rest)
    margin = figure.robot.description.collision.margin
    found: dict[str, None] = {}
    for shape in figure.shapes:
        # What hangs on the base's own joint is never compared with the ground.
        if shape.joint == 0 or figure.model.parents[shape.joint] == 0:
            continue
        if bottom(shape, figure.data.oMi[shape.joint])[:, 2].min() < ground + margin:
            found[shape.link] = None
    return list(found)
