"""Boxes in place of geometry that a model lacks: those whose mass, spread evenly, has the links' inertia."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from excite.robot.links import link_placement
from excite.robot.robot import Robot

# Thinner or longer boxes than links of robots are come of inertia that was made up [m].
_THINNEST, _LONGEST = 0.01, 1.0


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
        size = np.clip(np.sqrt(np.maximum(squares, 0.0)), _THINNEST, _LONGEST)
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
