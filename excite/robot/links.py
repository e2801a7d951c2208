"""What a ``robot.yaml`` says about links: segments, feet and wrench sensors."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.description import RobotDescription
from excite.robot.refusal import robot_error, unknown_name
from excite.robot.robot import Foot, Segment, WrenchSensor
from excite.robot.shapes.shape import joints_at


def read_segments(model: pin.Model, description: RobotDescription, path: Path) -> tuple[Segment, ...]:
    """The moving bodies, one a joint, with their names and pairs; raises RobotError."""
    links, block = [carried_link(model, joint) for joint in range(1, model.njoints)], description.segments
    pairs = dict(block.pairs) | {right: left for left, right in block.pairs}
    fields: dict[str, Iterable[str]] = {"pairs": pairs, "names": block.names, "com_box": block.com_box}
    for field, named in fields.items():
        for link in named:
            if link not in links:
                raise unknown_name(path, f"segments.{field}", "moving link", link, links)
    return tuple(
        Segment(block.names.get(link, link), link, joint, links.index(pairs[link]) if link in pairs else None)
        for joint, link in enumerate(links, start=1)
    )


def carried_link(model: pin.Model, joint: int) -> str:
    """The first link that a joint carries: the child link of the URDF's joint."""
    for frame in model.frames:
        if (
            frame.type == pin.FrameType.BODY
            and frame.parentJoint == joint
            and frame.placement.isIdentity(1e-12)
        ):
            return str(frame.name)
    return str(model.names[joint])


def link_placement(model: pin.Model, link: str, source: object, field: str) -> tuple[int, pin.SE3]:
    """Joint that carries a link, and the link's pose in that joint's frame; raises RobotError."""
    if not model.existFrame(link, pin.FrameType.BODY):
        links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
        raise unknown_name(source, field, "link", link, links)
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    return frame.parentJoint, frame.placement


def read_foot(model: pin.Model, description: RobotDescription, name: str, path: Path, upright: Array) -> Foot:
    """A foot with the frame of its sole, the robot resting at ``upright`` ``(nq,)``; raises RobotError."""
    block = next(foot for foot in description.feet if foot.name == name)
    joint, placement = link_placement(model, block.link, path, f"feet.{name}.link")
    corners = np.array([placement.act(np.array(corner)) for corner in block.sole])
    rotation = _sole_axes(corners, placement.rotation)
    if len(corners) == 1:
        data = joints_at(model, upright)
        rotation = data.oMi[joint].rotation.T
        if block.centre is not None and block.radius > 0.0:
            up = placement.act(np.array(block.centre)) - corners[0]
            rotation = pin.Quaternion.FromTwoVectors(rotation[:, 2], up).matrix() @ rotation
    if rotation is None:
        what = "the sole's corners lie on a line" if len(corners) > 2 else "the sole's two corners coincide"
        raise robot_error(path, f"feet.{name}.sole", what, "leave out corners between others")
    placement = pin.SE3(rotation, corners.mean(axis=0))
    return Foot(name, block.link, joint, corners, placement, block.friction, block.radius)


def _sole_axes(corners: Array, link: Array) -> Array | None:
    """Axes of a sole, z along its normal, or of an edge, x along it; None of corners on a line, or that coincide.

    The sole's x is as near to the link's x as that allows, the edge's z to the link's z; where those are along what is
    given, the link's y takes their place.
    """
    edge, spokes = len(corners) == 2, corners - corners.mean(axis=0)
    # Products of neighbouring spokes add up to the normal, twice as long as the polygon's area.
    given = spokes[1] - spokes[0] if edge else np.cross(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0)
    length = float(np.linalg.norm(given))
    if length <= 1e-9:
        return None
    given = given / length if edge or given @ link[:, 2] >= -0.5 * length else -given / length
    near = link[:, 2 if edge else 0]
    near = link[:, 1] if abs(near @ given) >= 0.9 else near
    near = near - (near @ given) * given
    near /= np.linalg.norm(near)
    across = np.cross(near, given)
    return np.column_stack([given, across, near] if edge else [near, -across, given])


def read_sensors(model: pin.Model, description: RobotDescription, path: Path) -> tuple[WrenchSensor, ...]:
    """Wrench sensors and where they sit; raises RobotError."""
    sensors = []
    for block in description.sensors.wrench:
        where, joint, link_pose = f"sensors.wrench.{block.name}", 0, pin.SE3.Identity()
        if block.kind != "force_plate":
            joint, link_pose = link_placement(model, block.link, path, f"{where}.link")
        beyond = (link_placement(model, link, path, f"{where}.excludes")[0] - 1 for link in block.excludes)
        sensors.append(
            WrenchSensor(
                name=block.name,
                kind=block.kind,
                link=block.link,
                joint=joint,
                placement=link_pose * pin.SE3(pin.rpy.rpyToMatrix(*block.rpy), np.array(block.xyz)),
                foot=block.foot,
                excludes=tuple(beyond),
                noise_force=block.noise_force,
                noise_moment=block.noise_moment,
            )
        )
    return tuple(sensors)
