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
    centre = corners.mean(axis=0)
    rotation: Array | None
    if len(corners) == 1:
        data = model.createData()
        pin.forwardKinematics(model, data, upright)
        rotation = data.oMi[joint].rotation.T
        if block.centre is not None and block.radius > 0.0:
            up = placement.act(np.array(block.centre)) - corners[0]
            rotation = pin.Quaternion.FromTwoVectors(rotation[:, 2], up).matrix() @ rotation
    else:
        rotation = (
            _edge_axes(corners, placement.rotation)
            if len(corners) == 2
            else _sole_axes(corners, placement.rotation)
        )
    if rotation is None:
        what = "the sole's corners lie on a line" if len(corners) > 2 else "the sole's two corners coincide"
        raise robot_error(path, f"feet.{name}.sole", what, "leave out corners between others")
    return Foot(name, block.link, joint, corners, pin.SE3(rotation, centre), block.friction, block.radius)


def _edge_axes(corners: Array, link: Array) -> Array | None:
    """Axes of an edge, x along it and z as near to the link's z (or y) as that allows; None without length."""
    along = _unit_vector(corners[1] - corners[0])
    if along is None:
        return None
    up = _unit_vector(_part_across(link[:, 2] if abs(link[:, 2] @ along) < 0.9 else link[:, 1], along))
    return None if up is None else np.column_stack([along, np.cross(up, along), up])


def _sole_axes(corners: Array, link: Array) -> Array | None:
    """Axes of a sole, z along its normal and x along the link's; None where its corners lie on a line."""
    normal = _unit_vector(np.cross(corners[1] - corners[0], corners[2] - corners[1]))
    if normal is None:
        # The first three lie on a line: twice the polygon's area.
        spokes = corners - corners.mean(axis=0)
        normal = _unit_vector(np.cross(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0))
    if normal is None:
        return None
    if normal @ link[:, 2] < -0.5:
        normal = -normal
    level = _part_across(link[:, 0], normal)
    along = _unit_vector(level if np.linalg.norm(level) >= 1e-6 else _part_across(link[:, 1], normal))
    return None if along is None else np.column_stack([along, np.cross(normal, along), normal])


def _part_across(vector: Array, axis: Array) -> Array:
    """The part of a vector at right angles to an axis of length one."""
    return np.asarray(vector - (vector @ axis) * axis)


def _unit_vector(vector: Array) -> Array | None:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-9 else None


def read_sensors(model: pin.Model, description: RobotDescription, path: Path) -> tuple[WrenchSensor, ...]:
    """Wrench sensors and where they sit; raises RobotError."""
    sensors = []
    for block in description.sensors.wrench:
        offset, where = (
            pin.SE3(pin.rpy.rpyToMatrix(*block.rpy), np.array(block.xyz)),
            f"sensors.wrench.{block.name}",
        )
        joint, link_pose = 0, pin.SE3.Identity()
        if block.kind != "force_plate":
            joint, link_pose = link_placement(model, block.link, path, f"{where}.link")
        beyond = (link_placement(model, link, path, f"{where}.excludes")[0] - 1 for link in block.excludes)
        sensors.append(
            WrenchSensor(
                name=block.name,
                kind=block.kind,
                link=block.link,
                joint=joint,
                placement=link_pose * offset,
                foot=block.foot,
                excludes=tuple(beyond),
                excludes_links=block.excludes,
                noise_force=block.noise_force,
                noise_moment=block.noise_moment,
            )
        )
    return tuple(sensors)
