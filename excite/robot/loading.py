"""From a ``robot.yaml`` to a :class:`~excite.robot.robot.Robot`."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import yaml

from excite.arrays import Array
from excite.errors import RobotError
from excite.reading.file import read_bytes
from excite.reading.xml_document import MAX_XML_BYTES, read_xml
from excite.robot.catalogue import example_robot_data, find_robot
from excite.robot.description import FREE_BASES, Assumed, RobotDescription, read_description
from excite.robot.joint_values import check_joints, read_limits
from excite.robot.links import link_placement, read_foot, read_segments, read_sensors
from excite.robot.mechanisms.blocks import TieBlock
from excite.robot.mechanisms.drives import without_motors
from excite.robot.mechanisms.reading import mimic_couplings, read_mechanism
from excite.robot.mechanisms.transmissions import add_motors, closures_of
from excite.robot.per_joint import PerJoint
from excite.robot.robot import Foot, Robot
from excite.robot.shapes.balls import with_balls_down
from excite.robot.shapes.ground import ground_is_assumed
from excite.robot.urdf.limits import (
    CONTROL,
    SOFT,
    assumed_limits,
    keep_stated_limits,
    read_joint_limits,
)
from excite.robot.urdf.model import urdf_model
from excite.robot.urdf.reading import MAX_NESTING, Stated, read_urdf
from excite.robot.weights import check_weights


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
    check_weights(robot.model, robot.limits.torque, model_file(robot))
    return robot


def build_robot(description: RobotDescription, path: Path) -> Robot:
    """Build the robot of a validated description; ``path`` is the file that it was read from."""
    model_path = urdf_of(description, path)
    urdf = read_urdf(model_path, _stated_changes(description))
    root = ElementTree.fromstring(urdf)
    fingerprint = _robot_fingerprint(description, model_path, root)
    if description.transmissions:
        add_motors(root, description.transmissions, path)
        urdf = ElementTree.tostring(root, encoding="unicode")
    model = _build_model(root, description, model_path)
    joint_names = tuple(list(model.names)[2 if description.base in FREE_BASES else 1 :])
    rods, gears = closures_of(description.transmissions)
    loops = (*description.loops, *rods)
    couplings = (*description.couplings, *mimic_couplings(root, model_path), *gears)
    ties: tuple[TieBlock, ...] = (*loops, *couplings)
    passive = {name for block in ties for name in block.passive}
    check_joints(description, joint_names, path, frozenset(passive))
    segments = read_segments(model, description, path)
    upright = _upright_posture(model, description, joint_names)
    carrying = [link_placement(model, foot.link, path, "feet")[0] for foot in description.feet]
    mechanism = read_mechanism(model, loops, couplings, upright, carrying, path)
    if mechanism is not None:
        upright = mechanism.rest
        description = without_motors(description, joint_names, mechanism, model)
    description = with_balls_down(description, root, model, upright, path)
    feet = tuple(read_foot(model, description, block.name, path, upright) for block in description.feet)
    sensors = read_sensors(model, description, segments, path)
    if description.sensors.imu is not None:
        joint, _ = link_placement(model, description.sensors.imu.link, path, "sensors.imu.link")
        if description.base in FREE_BASES and joint != 1:
            raise RobotError(
                f"link {description.sensors.imu.link!r} moves against the base",
                source=path,
                field="sensors.imu.link",
                remedy="name the base's link, or one fixed to it",
            )
    if description.uncertainty is not None and description.uncertainty.payload is not None:
        link = description.uncertainty.payload.link
        if link_placement(model, link, path, "uncertainty.payload.link")[0] == 0:
            raise RobotError(
                f"link {link!r} does not move",
                source=path,
                field="uncertainty.payload.link",
                remedy="name the link that carries the load",
            )
    # A robot that hangs or is held has its feet in the air: nothing reaches the ground, or a sensor there.
    standing = description.base in ("fixed", "floating")
    rest = _rest_configuration(model, description, upright, feet)
    return Robot(
        name=description.name,
        description=_with_limits_said(_with_ground_said(description), model_path, urdf),
        source=path,
        urdf=urdf,
        hash=fingerprint,
        model=model,
        joint_names=joint_names,
        limits=read_limits(model, description, joint_names, path),
        feet=feet if standing else (),
        sensors=sensors if standing else (),
        segments=segments,
        rest=rest,
        mechanism=None if mechanism is None else replace(mechanism, rest=rest),
    )


def _with_ground_said(description: RobotDescription) -> RobotDescription:
    """The description with the ground among what is assumed, where a fixed base does not say where it is."""
    if not ground_is_assumed(description):
        return description
    ground = Assumed(
        what="ground",
        value="the plane that the base is mounted on; of a robot that hangs, below its reach",
        consequence="motions stay above it: state collision.table_height, or null where nothing is there",
    )
    return description.model_copy(update={"assumed": (*description.assumed, ground)})


def _with_limits_said(description: RobotDescription, model_path: Path, urdf: str) -> RobotDescription:
    """The description with limits of the model that stand elsewhere than in ``<limit>`` among what is assumed."""
    if not any(element.strip(">") in urdf for element in (SOFT, CONTROL)):
        return description
    tightened = keep_stated_limits(read_xml(model_path, error=RobotError, max_depth=MAX_NESTING), model_path)
    block = description.limits
    stated = {
        "position": set(block.position.joints),
        "velocity": _joints_of(block.velocity),
        "effort": _joints_of(block.torque),
    }
    locked = set(description.locked_joints)
    left = {
        said: {
            what: kept
            for what, joints in changed.items()
            if (kept := [name for name in joints if name not in stated.get(what, set()) | locked])
        }
        for said, changed in tightened.items()
    }
    said = assumed_limits(left)
    return description.model_copy(update={"assumed": (*description.assumed, *said)}) if said else description


def _joints_of(block: PerJoint | None) -> set[str]:
    return set() if block is None else set(block.joints)


def _robot_fingerprint(description: RobotDescription, model_path: Path, root: ElementTree.Element) -> str:
    """SHA-256 of all that a verdict on a motion depends on: description with its limits, model, collision geometry.

    What the description leaves at its default is left out, so that a field that is added later changes no robot; and so
    is its uncertainty, which moves margins over a set and no limit: a motion stays this robot's when it becomes known.
    """
    stated = description.model_copy(update={"uncertainty": None}).model_dump_json(
        by_alias=True, exclude_defaults=True
    )
    # The file as it is, not the text as loaded: that one holds paths of this machine.
    content = read_bytes(model_path, limit=MAX_XML_BYTES, error=RobotError)
    digest = hashlib.sha256(stated.encode() + b"\0" + content)
    if ground_is_assumed(description):
        digest.update(b"\0ground assumed")
    geometry = description.collision.geometry
    shown = ("collision", "visual") if geometry == "either" else (geometry,)
    for link in root.findall("link"):
        for mesh in (found for kind in shown for found in link.iterfind(f"{kind}/geometry/mesh")):
            file = Path(mesh.get("filename", ""))
            # A mesh that is not there, or is no mesh, is refused where the geometry is built.
            if file.is_file() and file.stat().st_size <= MAX_XML_BYTES:
                digest.update(b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def model_file(robot: Robot) -> Path:
    """The URDF file that a robot was built from, as its author left it."""
    return urdf_of(robot.description, robot.source)


def portable_description(robot: Robot) -> str:
    """Text of a robot's ``robot.yaml`` that can be written anywhere: it names the URDF by its whole path."""
    return _portable(robot, read_description(robot.source))


def limited_description(robot: Robot, file: Path) -> str:
    """The same, with the joint limits of a file of MoveIt's kind where they are tighter than the robot's.

    Raises:
        RobotError: it is no such file, names no joint of the robot, or leaves one no range.
    """
    description, limits = read_description(robot.source), robot.limits
    found = read_joint_limits(file, robot.driven_names)
    if not found:
        remedy = "the robot has " + ", ".join(robot.driven_names)
        raise RobotError("names no joint of the robot", source=file, field="joint_limits", remedy=remedy)
    changed: dict[str, dict[str, Any]] = {}
    for name, one in found.items():
        index, margin = robot.joint_index(name), description.limits.position.margin
        for what, value in (
            ("velocity", one.velocity),
            ("torque", one.effort),
            ("acceleration", one.acceleration),
            ("jerk", one.jerk),
        ):
            if value is not None and 0.0 < value < getattr(limits, what)[index]:
                changed.setdefault(what, {})[name] = value
        if one.range is None:
            continue
        low, high = limits.position_lower[index] - margin, limits.position_upper[index] + margin
        kept = max(float(low), one.range[0]), min(float(high), one.range[1])
        if kept[0] + 2.0 * margin >= kept[1]:
            what = f"{one.range[0]:g} … {one.range[1]:g} leaves nothing of {low:.4g} … {high:.4g}"
            raise RobotError(what, source=file, field=f"joint_limits.{name}", remedy="correct one of them")
        if kept != (low, high):
            changed.setdefault("position", {})[name] = kept
    return _portable(robot, _with_limits(description, changed, file))


def _with_limits(
    description: RobotDescription, changed: Mapping[str, Mapping[str, Any]], file: Path
) -> RobotDescription:
    """The description with limits of some joints changed, and where they stand among what is assumed."""
    content = description.model_dump(mode="json", by_alias=True, exclude_unset=True)
    for what, joints in changed.items():
        block = content["limits"].get(what) or {"source": file.name}
        content["limits"][what] = {**block, "joints": {**block.get("joints", {}), **joints}}
    said = assumed_limits({file.name: {what: list(joints) for what, joints in changed.items()}})
    content["assumed"] = [*content.get("assumed", []), *(one.model_dump() for one in said)]
    return RobotDescription.model_validate(content)


def _portable(robot: Robot, description: RobotDescription) -> str:
    whole = description.model.model_copy(update={"path": str(model_file(robot).resolve()), "package": None})
    stated = description.uncertainty
    if stated is not None and stated.identified is not None:
        found = str((robot.source.parent / stated.identified).resolve())
        stated = stated.model_copy(update={"identified": found})
    content = description.model_copy(
        update={"model": whole} if stated is None else {"model": whole, "uncertainty": stated}
    )
    # What is said to be absent, such as a table, is not what was left out.
    said = content.model_dump(mode="json", by_alias=True, exclude_unset=True)
    return str(yaml.safe_dump(said, sort_keys=False, allow_unicode=True))


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


def urdf_of(description: RobotDescription, path: Path) -> Path:
    """The URDF file that a description names; ``path`` is the description's."""
    if description.model.package is None:
        return path.parent / description.model.path
    return example_robot_data() / description.model.path


def _stated_changes(description: RobotDescription) -> Stated:
    """What the description says that changes how the URDF is read."""
    return Stated(
        floating=description.base in FREE_BASES,
        locked=description.locked_joints,
        limits=description.limits.position.joints,
        acknowledged=description.model.acknowledged,
    )


def _build_model(root: ElementTree.Element, description: RobotDescription, model_path: Path) -> pin.Model:
    model = urdf_model(root, model_path, floating=description.base in FREE_BASES)
    if model.njoints == 1:
        raise RobotError("has no joint that moves", source=model_path, remedy="describe at least one")
    model.gravity.linear = np.array(description.gravity)
    return model


def _upright_posture(model: pin.Model, description: RobotDescription, names: tuple[str, ...]) -> Array:
    """The posture of the description, the base oriented and at height zero."""
    q = pin.neutral(model)
    offset = 7 if description.base in FREE_BASES else 0
    if offset:
        q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(*description.posture.base_rpy)).coeffs()
    for joint, angle in description.posture.joints.items():
        q[offset + names.index(joint)] = angle
    return np.asarray(q)


def _rest_configuration(
    model: pin.Model, description: RobotDescription, upright: Array, feet: tuple[Foot, ...]
) -> Array:
    """Rest configuration; the lowest sole corner of a standing robot touches the ground."""
    q = upright.copy()
    if description.base in FREE_BASES:
        if description.posture.base_height is not None:
            q[2] = description.posture.base_height
        elif feet:
            data = model.createData()
            pin.forwardKinematics(model, data, q)
            heights = [data.oMi[foot.joint].act(corner)[2] for foot in feet for corner in foot.sole]
            q[2] -= min(heights)
    return q
