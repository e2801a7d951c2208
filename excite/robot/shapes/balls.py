"""Balls among a link's solids: where such a foot touches the ground depends on how it is turned."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.description import FootBlock, RobotDescription
from excite.robot.links import link_placement
from excite.robot.urdf.numbers import read_numbers

# A corner lies on a ball to the digits of a description, half a tenth of a millimetre; one written by hand to ten times
# that [m].
_ON = 5e-4


def with_balls_down(
    description: RobotDescription, root: ElementTree.Element, model: pin.Model, upright: Array, path: Path
) -> RobotDescription:
    """The description with the corner of each foot that is a ball where that is lowest at rest.

    The stated corner, which may be of another posture, says which ball of the collision geometry it is. Feet that are
    none of those stay as they are stated. Where no posture is stated, as with a log's bare model, corners stay as well,
    and the ball's centre stands beside them.

    Args:
        description: as it was read.
        root: the ``robot`` element of its model.
        model: the model.
        upright: posture at rest ``(nq,)``.
        path: file of the description, for errors.

    Raises:
        RobotError: a foot's link is not in the model, or an origin or a radius is no number.
    """
    if not description.posture.joints:
        return _with_centres(description, root, path)
    data = model.createData()
    pin.forwardKinematics(model, data, upright)
    feet = []
    for foot in description.feet:
        centre = _ball_centre(root, description, foot, path)
        if centre is not None:
            joint, placement = link_placement(model, foot.link, path, f"feet.{foot.name}.link")
            down = (data.oMi[joint].rotation @ placement.rotation).T @ np.array([0.0, 0.0, -foot.radius])
            foot = foot.model_copy(update={"sole": (tuple((centre + down).tolist()),)})
        feet.append(foot)
    return description.model_copy(update={"feet": tuple(feet)})


def _with_centres(description: RobotDescription, root: ElementTree.Element, path: Path) -> RobotDescription:
    """The description with the centres of balls that it does not say, where they can be told."""
    feet = []
    for foot in description.feet:
        if foot.centre is None:
            centre = _ball_centre(root, description, foot, path)
            if centre is None and _about_origin(foot):
                # Feet that are meshes nearly all have their frame in the middle of the ball.
                centre = np.zeros(3)
            if centre is not None:
                foot = foot.model_copy(update={"centre": tuple(centre.tolist())})
        feet.append(foot)
    return description.model_copy(update={"feet": tuple(feet)})


def _about_origin(foot: FootBlock) -> bool:
    """Whether a foot's corner lies on a ball about its link's origin."""
    return foot.radius > 0.0 and abs(float(np.linalg.norm(foot.sole[0])) - foot.radius) < _ON


def _ball_centre(
    root: ElementTree.Element, description: RobotDescription, foot: FootBlock, path: Path
) -> Array | None:
    """Centre ``(3,)`` of the ball that a foot is, in its link's frame [m]; None where no solid is that ball."""
    if foot.radius <= 0.0:
        return None
    balls = [
        (np.array(shape.xyz), shape.size[0])
        for shape in description.collision.shapes
        if shape.link == foot.link and shape.kind == "sphere"
    ]
    for link in (link for link in root.findall("link") if link.get("name") == foot.link):
        for solid in link.findall(description.collision.geometry):
            sphere, where = solid.find("geometry/sphere"), f"link {foot.link!r}/{solid.tag}"
            if sphere is not None:
                origin = solid.find("origin")
                at = (
                    (0.0, 0.0, 0.0)
                    if origin is None
                    else read_numbers(origin, "xyz", 3, path, where, default="0 0 0")
                )
                balls.append((np.array(at), read_numbers(sphere, "radius", 1, path, where)[0]))
    for centre, radius in balls:
        from_centre = float(np.linalg.norm(np.array(foot.sole[0]) - centre))
        if max(abs(from_centre - radius), abs(foot.radius - radius)) < _ON:
            return centre
    return None
