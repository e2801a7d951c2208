"""Boxes in place of geometry that a model lacks: those whose mass, spread evenly, has the links' inertia.

No link is taken to be longer than its joints say: inertia that was made up, 1 kg·m² for any link, would fill the room.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from excite.robot.links import link_placement
from excite.robot.robot import Robot

# Thinner boxes than links of robots are come of inertia that was made up [m].
_THINNEST = 0.01


def box_shapes(robot: Robot) -> list[dict[str, Any]]:
    """Authored shapes as ``collision.shapes`` in ``robot.yaml``, one a segment with mass."""
    shapes = []
    for segment in robot.segments:
        inertia = robot.model.inertias[segment.joint]
        if inertia.mass <= 0.0:
            continue
        moments, axes = np.linalg.eigh(inertia.inertia)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] = -axes[:, 0]
        squares = 6.0 * (moments.sum() - 2.0 * moments) / inertia.mass
        sides = np.sqrt(np.maximum(squares, 0.0))
        sides *= min(1.0, _longest(robot.model, segment.joint) / max(float(sides.max()), 1e-9))
        size = np.maximum(sides, _THINNEST)
        _, placement = link_placement(robot.model, segment.link, robot.source, "collision.shapes")
        pose = placement.actInv(pin.SE3(axes, inertia.lever))
        shapes.append(
            {
                "link": segment.link,
                "kind": "box",
                "size": [round(float(x), 4) for x in size],
                "xyz": [round(float(x), 5) for x in pose.translation],
                "rpy": [round(float(x), 5) for x in pin.rpy.matrixToRpy(pose.rotation)],
            }
        )
    return shapes


def _longest(model: pin.Model, joint: int) -> float:
    """Length that a link has at most: twice the way from its centre to the farthest of its joints, or to its parent's
    joint where it has no other [m]."""
    centre = model.inertias[joint].lever
    ends = [model.jointPlacements[other].translation for other in model.children[joint]]
    ways = [float(np.linalg.norm(centre - end)) for end in (np.zeros(3), *ends)]
    if model.parents[joint]:
        ways.append(0.5 * float(np.linalg.norm(model.jointPlacements[joint].translation)))
    return 2.0 * max(ways)
