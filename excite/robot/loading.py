"""From a ``robot.yaml`` to a :class:`~excite.robot.robot.Robot`."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.errors import RobotError
from excite.robot.catalogue import example_robot_data, find_robot
from excite.robot.description import PerJoint, RobotDescription, read_description
from excite.robot.robot import Array, Foot, Limits, Robot, Segment, WrenchSensor
from excite.robot.urdf import Stated, read_urdf


def load_robot(name_or_path: str | Path) -> Robot:
    """Load a robot by bundled name or from a ``robot.yaml``.

    Args:
        name_or_path: bundled name (``excite robots`` lists them), folder, or path of a ``robot.yaml``.

    Returns:
        The robot, everything in it checked.

    Raises:
        RobotError: a file is missing or malformed, or a number in it is absurd.
        UnknownNameError: neither a file nor a bundled robot.
    """
    path = find_robot(name_or_path)
    if path.suffix not in {".yaml", ".yml"}:
        raise RobotError(
            "is a model, and a robot also needs limits, sensors and a posture",
            source=path,
            remedy=f"run `excite init-robot {path}` and fill in what it asks for",
        )
    robot = build_robot(read_description(path), path)
    _rest_within_limits(robot)
    return robot


def build_robot(description: RobotDescription, path: Path) -> Robot:
    """Build the robot of a validated description; ``path`` is the file that it was read from."""
    model_path = _model_path(description, path)
    urdf = read_urdf(model_path, _stated(description))
    model = _build_model(urdf, description, model_path)
    joint_names = tuple(list(model.names)[2 if description.base == "floating" else 1 :])
    _known_joints(description, joint_names, path)
    segments = _segments(model, description, path)
    feet = tuple(_foot(model, description, block.name, path) for block in description.feet)
    # The file as it is, not the text as loaded: that one holds paths of this machine.
    digest = hashlib.sha256(
        description.model_dump_json(by_alias=True).encode() + b"\0" + model_path.read_bytes()
    )
    return Robot(
        name=description.name,
        description=description,
        source=path,
        urdf=urdf,
        hash=digest.hexdigest(),
        model=model,
        joint_names=joint_names,
        limits=_limits(model, description, joint_names, path),
        feet=feet,
        sensors=_sensors(model, description, segments, path),
        segments=segments,
        rest=_rest(model, description, joint_names, feet),
    )


def model_file(robot: Robot) -> Path:
    """The URDF file that a robot was built from, as its author left it."""
    return _model_path(robot.description, robot.source)


def _rest_within_limits(robot: Robot) -> None:
    q, limits = robot.rest[robot.n_base_q :], robot.limits
    outside = (q < limits.position_lower) | (q > limits.position_upper)
    if outside.any():
        index = int(np.argmax(outside))
        name, low, high = robot.joint_names[index], limits.position_lower[index], limits.position_upper[index]
        raise RobotError(
            f"is {q[index]:.4g}, outside {low:.4g} … {high:.4g}",
            source=robot.source,
            field=f"posture.joints.{name}",
            remedy="choose an angle inside the limits less their margin",
        )


def _model_path(description: RobotDescription, path: Path) -> Path:
    if description.model.package is None:
        return path.parent / description.model.path
    return example_robot_data() / description.model.path


def _stated(description: RobotDescription) -> Stated:
    """What the description says that changes how the URDF is read."""
    return Stated(
        floating=description.base == "floating",
        locked=description.locked_joints,
        limits=description.limits.position.joints,
        acknowledged=description.model.acknowledged,
    )


def _build_model(urdf: str, description: RobotDescription, model_path: Path) -> pin.Model:
    try:
        if description.base == "floating":
            model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
        else:
            model = pin.buildModelFromXML(urdf)
    except (RuntimeError, ValueError) as error:
        what = f"pinocchio refuses it ({' '.join(str(error).split())})"
        raise RobotError(what, source=model_path, remedy="check the file with check_urdf") from error
    if model.njoints == 1:
        raise RobotError("has no joint that moves", source=model_path, remedy="describe at least one")
    model.gravity.linear = np.array(description.gravity)
    return model


def _known_joints(description: RobotDescription, names: tuple[str, ...], path: Path) -> None:
    """Every joint that the description names must exist."""
    limits, drives = description.limits, description.drives
    named: dict[str, dict[str, object]] = {
        "posture.joints": dict(description.posture.joints),
        "limits.position.joints": dict(limits.position.joints),
        "controller.kp.joints": dict(description.controller.kp.joints),
        "controller.kd.joints": dict(description.controller.kd.joints),
    }
    for field, block in {
        "limits.velocity": limits.velocity,
        "limits.acceleration": limits.acceleration,
        "limits.jerk": limits.jerk,
        "limits.torque": limits.torque,
        "sensors.noise_torque": description.sensors.noise_torque,
        "drives.viscous": drives.viscous,
        "drives.coulomb": drives.coulomb,
        "drives.armature": drives.armature,
    }.items():
        if block is not None:
            named[f"{field}.joints"] = dict(block.joints)
    for field, full in {"kp": description.controller.kp, "kd": description.controller.kd}.items():
        _covers(full, names, f"controller.{field}", path)
    if description.sensors.noise_torque is not None:
        _covers(description.sensors.noise_torque, names, "sensors.noise_torque", path)
    for field, joints in named.items():
        for joint in joints:
            if joint not in names:
                raise RobotError(
                    f"no joint {joint!r} in the model",
                    source=path,
                    field=field,
                    remedy="the model has " + ", ".join(names),
                )


def _covers(block: PerJoint, names: tuple[str, ...], field: str, path: Path) -> None:
    """A block without default must name every joint."""
    missing = [name for name in names if block.default is None and name not in block.joints]
    if missing:
        remedy = f"give a default or {field}.joints.{missing[0]}"
        raise RobotError(
            f"says nothing about joint {missing[0]!r}", source=path, field=f"{field}.default", remedy=remedy
        )


def per_joint(block: PerJoint | None, names: tuple[str, ...], fallback: Array) -> Array:
    """Values of a per-joint block in the order of ``names``; joints it does not cover get ``fallback``."""
    if block is None:
        return fallback.copy()
    default = fallback if block.default is None else np.full(len(names), block.default)
    return np.array([block.joints.get(name, default[i]) for i, name in enumerate(names)])


def _limits(model: pin.Model, description: RobotDescription, names: tuple[str, ...], path: Path) -> Limits:
    nq, nv = (7, 6) if description.base == "floating" else (0, 0)
    block = description.limits
    lower, upper = model.lowerPositionLimit[nq:].copy(), model.upperPositionLimit[nq:].copy()
    for joint, (low, high) in block.position.joints.items():
        lower[names.index(joint)], upper[names.index(joint)] = low, high
    lower, upper = lower + block.position.margin, upper - block.position.margin
    nothing = np.full(len(names), np.nan)
    limits = Limits(
        position_lower=lower,
        position_upper=upper,
        velocity=per_joint(block.velocity, names, model.velocityLimit[nv:]),
        acceleration=per_joint(block.acceleration, names, nothing),
        jerk=per_joint(block.jerk, names, nothing),
        torque=per_joint(block.torque, names, model.effortLimit[nv:]),
    )
    for field in ("position_lower", "position_upper", "velocity", "acceleration", "jerk", "torque"):
        values = getattr(limits, field)
        bad = ~np.isfinite(values) | (values <= 0.0 if not field.startswith("position") else False)
        if bad.any():
            joint = names[int(np.argmax(bad))]
            raise RobotError(
                f"{field} of joint {joint!r} is {values[names.index(joint)]}",
                source=path,
                field=f"limits.{field.split('_')[0]}",
                remedy="state a positive, finite limit for it",
            )
    if (upper <= lower).any():
        joint = names[int(np.argmax(upper <= lower))]
        raise RobotError(f"empty position range of joint {joint!r}", source=path, field="limits.position")
    return limits


def _segments(model: pin.Model, description: RobotDescription, path: Path) -> tuple[Segment, ...]:
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
                raise RobotError(
                    f"no moving link {link!r}",
                    source=path,
                    field=field,
                    remedy="the model has " + ", ".join(links),
                )
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
            return frame.name
    return model.names[joint]


def link_placement(model: pin.Model, link: str, source: object, field: str) -> tuple[int, pin.SE3]:
    """Joint that carries a link, and the link's pose in that joint's frame; raises RobotError."""
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name == link:
            return frame.parentJoint, frame.placement
    links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    raise RobotError(
        f"no link {link!r}", source=source, field=field, remedy="the model has " + ", ".join(links)
    )


def _foot(model: pin.Model, description: RobotDescription, name: str, path: Path) -> Foot:
    block = next(foot for foot in description.feet if foot.name == name)
    joint, placement = link_placement(model, block.link, path, f"feet.{name}.link")
    corners = np.array([placement.act(np.array(corner)) for corner in block.sole])
    centre = corners.mean(axis=0)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
    if np.linalg.norm(normal) < 1e-9:
        raise RobotError("the sole's corners lie on a line", source=path, field=f"feet.{name}.sole")
    normal /= np.linalg.norm(normal)
    x_link = placement.rotation[:, 0]
    if normal @ placement.rotation[:, 2] < 0.0 and abs(normal @ placement.rotation[:, 2]) > 0.5:
        normal = -normal
    x_axis = x_link - (x_link @ normal) * normal
    if np.linalg.norm(x_axis) < 1e-6:
        x_axis = placement.rotation[:, 1] - (placement.rotation[:, 1] @ normal) * normal
    x_axis /= np.linalg.norm(x_axis)
    rotation = np.column_stack([x_axis, np.cross(normal, x_axis), normal])
    return Foot(name, block.link, joint, corners, pin.SE3(rotation, centre), block.friction)


def _sensors(
    model: pin.Model, description: RobotDescription, segments: tuple[Segment, ...], path: Path
) -> tuple[WrenchSensor, ...]:
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


def _rest(
    model: pin.Model, description: RobotDescription, names: tuple[str, ...], feet: tuple[Foot, ...]
) -> Array:
    """Rest configuration; the lowest sole corner of a standing robot touches the ground."""
    q = pin.neutral(model)
    offset = 7 if description.base == "floating" else 0
    if offset:
        q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(*description.posture.base_rpy)).coeffs()
    for joint, angle in description.posture.joints.items():
        q[offset + names.index(joint)] = angle
    if description.base == "floating":
        if description.posture.base_height is not None:
            q[2] = description.posture.base_height
        elif feet:
            data = model.createData()
            pin.forwardKinematics(model, data, q)
            heights = [data.oMi[foot.joint].act(corner)[2] for foot in feet for corner in foot.sole]
            q[2] -= min(heights)
    return q
