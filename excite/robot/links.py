"""What a ``robot.yaml`` says about links: segments, feet and wrench sensors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.description import RobotDescription
from excite.robot.refusal import robot_error, unknown_name
from excite.robot.robot import Foot, Segment, WrenchSensor


def read_segments(model: pin.Model, description: RobotDescription, path: Path) -> tuple[Segment, ...]:
    """The moving bodies, one a joint, with their names and pairs; raises RobotError."""
    links = [carried_link(model, joint) for joint in range(1, model.njoints)]
    pairs: dict[str, str] = {}
    for left, right in description.segments.pairs:
        pairs[left], pairs[right] = right, left
    for field, named in {
        "segments.pairs": list(pairs),
        "segments.names": list(description.segments.names),
        "segments.com_box": list(description.segments.com_box),
    }.items():
        for link in named:
            if link not in links:
                raise unknown_name(path, field, "moving link", link, links)
    return tuple(
        Segment(
            name=description.segments.names.get(link, link),
            link=link,
            joint=joint,
            pair=links.index(pairs[link]) if link in pairs else None,
        )
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
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name == link:
            return frame.parentJoint, frame.placement
    links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    raise unknown_name(source, field, "link", link, links)


def read_foot(model: pin.Model, description: RobotDescription, name: str, path: Path, upright: Array) -> Foot:
    """A foot with the frame of its sole, the robot resting at ``upright`` ``(nq,)``; raises RobotError."""
    block = next(foot for foot in description.feet if foot.name == name)
    joint, placement = link_placement(model, block.link, path, f"feet.{name}.link")
    corners = np.array([placement.act(np.array(corner)) for corner in block.sole])
    centre = corners.mean(axis=0)
    if len(corners) == 1:
        data = model.createData()
        pin.forwardKinematics(model, data, upright)
        rotation = data.oMi[joint].rotation.T
        if block.centre is not None and block.radius > 0.0:
            up = placement.act(np.array(block.centre)) - corners[0]
            rotation = pin.Quaternion.FromTwoVectors(rotation[:, 2], up).matrix() @ rotation
    elif len(corners) == 2:
        rotation = _edge_axes(corners, placement.rotation)
    else:
        rotation = _sole_axes(corners, placement.rotation)
    if rotation is None:
        what = "the sole's corners lie on a line" if len(corners) > 2 else "the sole's two corners coincide"
        raise robot_error(path, f"feet.{name}.sole", what, "leave out corners between others")
    return Foot(name, block.link, joint, corners, pin.SE3(rotation, centre), block.friction, block.radius)


def _edge_axes(corners: Array, link: Array) -> Array | None:
    """Axes of an edge, x along it and z as near to the link's z (or y) as that allows; None without length."""
    along = corners[1] - corners[0]
    length = float(np.linalg.norm(along))
    if length < 1e-9:
        return None
    along /= length
    up = link[:, 2] if abs(link[:, 2] @ along) < 0.9 else link[:, 1]
    up = up - (up @ along) * along
    up /= np.linalg.norm(up)
    return np.column_stack([along, np.cross(up, along), up])


def _sole_axes(corners: Array, link: Array) -> Array | None:
    """Axes of a sole, z along its normal and x along the link's; None where its corners lie on a line."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
    if np.linalg.norm(normal) < 1e-9:
        # The first three lie on a line: twice the polygon's area.
        spokes = corners - corners.mean(axis=0)
        normal = np.cross(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0)
    if np.linalg.norm(normal) < 1e-9:
        return None
    normal /= np.linalg.norm(normal)
    if normal @ link[:, 2] < 0.0 and abs(normal @ link[:, 2]) > 0.5:
        normal = -normal
    x_axis = link[:, 0] - (link[:, 0] @ normal) * normal
    if np.linalg.norm(x_axis) < 1e-6:
        x_axis = link[:, 1] - (link[:, 1] @ normal) * normal
    x_axis /= np.linalg.norm(x_axis)
    return np.column_stack([x_axis, np.cross(normal, x_axis), normal])


def read_sensors(
    model: pin.Model, description: RobotDescription, segments: tuple[Segment, ...], path: Path
) -> tuple[WrenchSensor, ...]:
    """Wrench sensors and where they sit; raises RobotError."""
    sensors = []
    for block in description.sensors.wrench:
        offset = pin.SE3(pin.rpy.rpyToMatrix(*block.rpy), np.array(block.xyz))
        if block.kind == "force_plate":
            joint, link_pose = 0, pin.SE3.Identity()
        else:
            joint, link_pose = link_placement(model, block.link, path, f"sensors.wrench.{block.name}.link")
        excludes = []
        for link in block.excludes:
            carrier, _ = link_placement(model, link, path, f"sensors.wrench.{block.name}.excludes")
            excludes.append(carrier - 1)
        sensors.append(
            WrenchSensor(
                name=block.name,
                kind=block.kind,
                link=block.link,
                joint=joint,
                placement=link_pose * offset,
                foot=block.foot,
                excludes=tuple(excludes),
                excludes_links=tuple(block.excludes),
                noise_force=block.noise_force,
                noise_moment=block.noise_moment,
            )
        )
    return tuple(sensors)
