"""Boxes in which the centre of mass of each segment must lie."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE, collision_shapes
from excite.robot.shapes.shape import shape_bounds

BARE = 0.05
"""Half side of the box about the nominal CoM of a segment that has no geometry [m]."""


def com_boxes(robot: Robot) -> Array:
    """Box of each segment that contains its CoM for certain, for constraints on first moments.

    It is the bounding box, along the axes of the segment's joint frame, of the collision geometry that the
    joint carries, grown a little and extended to contain the nominal CoM. ``segments.com_box`` in
    ``robot.yaml`` overrides it; a segment without geometry gets a box of 0.1 m around its nominal CoM.

    Returns:
        Lower and upper corners in the joint frames, ``(n_segments, 2, 3)`` [m].

    Raises:
        RobotError: the collision geometry cannot be built.
    """
    boxes = np.empty((len(robot.segments), 2, 3))
    shapes = [shape for shape in collision_shapes(robot) if shape.link != TABLE]
    for index, segment in enumerate(robot.segments):
        stated = robot.description.segments.com_box.get(segment.link)
        if stated is not None:
            boxes[index] = stated
            continue
        mass, *moment = robot.nominal_parameters[10 * index : 10 * index + 4]
        centre = np.array(moment) / mass if mass > 0.0 else np.zeros(3)
        bounds = [shape_bounds(shape) for shape in shapes if shape.joint == segment.joint]
        if bounds:
            lower = np.min([low for low, _ in bounds], axis=0)
            upper = np.max([high for _, high in bounds], axis=0)
            # Growth of the geometry's bounding box on every side, as a share of its length.
            # Least growth on every side [m].
            growth = np.maximum(0.05 * (upper - lower), 0.005)
            boxes[index] = np.minimum(lower - growth, centre), np.maximum(upper + growth, centre)
        else:
            boxes[index] = centre - BARE, centre + BARE
    return boxes
