"""From a ``robot.yaml`` to a :class:`~excite.robot.robot.Robot`."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import yaml

from excite.arrays import Array
from excite.display import span
from excite.errors import MotionError, RobotError
from excite.formats.documents import MAX_XML_BYTES, read_xml
from excite.formats.file import read_bytes
from excite.results import Assumed
from excite.robot.catalogue import example_robot_data, find_robot
from excite.robot.description import FREE_BASES, FootBlock, PositionTable, RobotDescription, read_description
from excite.robot.joint_values import check_joints, read_limits
from excite.robot.links import link_placement, read_foot, read_segments, read_sensors
from excite.robot.mechanisms.closures import (
    Closure,
    Coupling,
    CouplingBlock,
    Loop,
    LoopBlock,
    Rod,
    TieBlock,
    add_motors,
    closures_of,
)
from excite.robot.mechanisms.mechanism import Mechanism, build_mechanism
from excite.robot.quantities import MAX_RATIO, PerJoint
from excite.robot.refusal import robot_error, unknown_name
from excite.robot.robot import Foot, Robot
from excite.robot.shapes.collision import ground_is_assumed
from excite.robot.urdf.inertia import check_weights
from excite.robot.urdf.limits import (
    CONTROL,
    SOFT,
    assumed_limits,
    keep_stated_limits,
    read_joint_limits,
    read_position_tables,
    with_tables,
)
from excite.robot.urdf.model import urdf_model
from excite.robot.urdf.numbers import read_numbers
from excite.robot.urdf.reading import MAX_NESTING, Stated, read_urdf

CHOSEN = "chosen here"
"""How the source of a value begins that who wrote a description chose."""


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
        raise robot_error(
            path,
            None,
            "is a model, and a robot also needs limits, sensors and a posture",
            f"run `excite init-robot {path}` and fill in what it asks for",
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
            raise robot_error(
                path,
                "sensors.imu.link",
                f"link {description.sensors.imu.link!r} moves against the base",
                "name the base's link, or one fixed to it",
            )
    if description.uncertainty is not None and description.uncertainty.payload is not None:
        link = description.uncertainty.payload.link
        if link_placement(model, link, path, "uncertainty.payload.link")[0] == 0:
            raise robot_error(
                path,
                "uncertainty.payload.link",
                f"link {link!r} does not move",
                "name the link that carries the load",
            )
    # A robot that hangs or is held has its feet in the air: nothing reaches the ground, or a sensor there.
    standing = description.base in ("fixed", "floating")
    rest = _rest_configuration(model, description, upright, feet)
    return Robot(
        name=description.name,
        description=_with_limits_said(_with_choices_said(_with_ground_said(description)), model_path, urdf),
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


def _with_choices_said(description: RobotDescription) -> RobotDescription:
    """The description with limits among what is assumed whose source says that who wrote it chose them."""
    found, block = [*description.assumed], description.limits
    units = {"velocity": "rad/s or m/s", "acceleration": "rad/s² or m/s²", "jerk": "rad/s³ or m/s³"}
    for name, unit in {**units, "torque": "N·m or N"}.items():
        stated: PerJoint | None = getattr(block, name)
        if stated is not None and stated.source.startswith(CHOSEN):
            values = [*stated.joints.values(), *([] if stated.default is None else [stated.default])]
            value = f"{span(f'{min(values):g}', f'{max(values):g}')} {unit}, {stated.source}"
            consequence = f"motions keep to it: state limits.{name} if the robot bears less, or more"
            found.append(Assumed(f"{name} limits", value, consequence))
    return description.model_copy(update={"assumed": tuple(found)})


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
    """The same, with the joint limits of a file of MoveIt's kind: where they are tighter, and those by position.

    Raises:
        RobotError: it is no such file, names no joint of the robot, or leaves one no range.
    """
    description, limits = read_description(robot.source), robot.limits
    found = read_joint_limits(file, robot.driven_names)
    tables = read_position_tables(file, robot.driven_names)
    if not found and not tables:
        remedy = "the robot has " + ", ".join(robot.driven_names)
        raise robot_error(file, "joint_limits", "names no joint of the robot", remedy)
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
            raise robot_error(file, f"joint_limits.{name}", what, "correct one of them")
        if kept != (low, high):
            changed.setdefault("position", {})[name] = kept
    return _portable(robot, _with_limits(description, changed, tables, file))


def _with_limits(
    description: RobotDescription,
    changed: Mapping[str, Mapping[str, Any]],
    tables: Sequence[PositionTable],
    file: Path,
) -> RobotDescription:
    """The description with limits of some joints changed, and where they stand among what is assumed."""
    content = description.model_dump(mode="json", by_alias=True, exclude_unset=True)
    for what, joints in changed.items():
        block = content["limits"].get(what) or {"source": file.name}
        content["limits"][what] = {**block, "joints": {**block.get("joints", {}), **joints}}
    if tables:
        stated = content["limits"].get("by_position", [])
        content["limits"]["by_position"] = [
            *stated,
            *(one.model_dump(exclude_defaults=True) for one in tables),
        ]
    said = assumed_limits(
        {file.name: with_tables({what: [*joints] for what, joints in changed.items()}, tables)}
    )
    content["assumed"] = [*content.get("assumed", []), *(one.to_json() for one in said)]
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
        raise robot_error(
            robot.source,
            f"posture.joints.{name}",
            f"is {q[index]:.4g}, outside {low:.4g} … {high:.4g}",
            "choose an angle inside the limits less their margin",
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
        raise robot_error(model_path, None, "has no joint that moves", "describe at least one")
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


# What a description says of drives, for the joints of a mechanism that have none.


def without_motors(
    description: RobotDescription, names: tuple[str, ...], mechanism: Mechanism, model: pin.Model
) -> RobotDescription:
    """The description with joints that no motor drives made so: no gains, no friction or rotor of a drive.

    Limits of speed, acceleration and torque that nobody states for them are the largest of the driven joints', a
    scale for tolerances: what moves and loads them is limited where the motors are.
    """
    first = model.nv - len(names)
    passive = [names[column - first] for column in mechanism.passive]
    driven = [name for name in names if name not in passive]
    controller, drives, limits = description.controller, description.drives, description.limits
    stated = {"velocity": model.velocityLimit[first:], "torque": model.effortLimit[first:]}
    found: dict[str, Any] = {}
    for field in ("velocity", "acceleration", "jerk", "torque"):
        own = dict(zip(names, stated.get(field, np.zeros(len(names))), strict=True))
        found[field] = _scale_driven(getattr(limits, field), driven, passive, own)
    return description.model_copy(
        update={
            "controller": controller.model_copy(
                update={name: _zero_passive(getattr(controller, name), passive) for name in ("kp", "kd")}
            ),
            "drives": drives.model_copy(
                update={
                    name: _zero_passive(block, passive)
                    for name in ("viscous", "coulomb", "armature")
                    if (block := getattr(drives, name)) is not None
                }
            ),
            "limits": limits.model_copy(update=found),
        }
    )


def _zero_passive(block: PerJoint, passive: list[str]) -> PerJoint:
    return block.model_copy(update={"joints": {**block.joints, **dict.fromkeys(passive, 0.0)}})


def _scale_driven(
    block: PerJoint | None, driven: list[str], passive: list[str], own: dict[str, Array]
) -> PerJoint | None:
    """A block with numbers for passive joints that neither it nor the URDF has any for."""
    values = {} if block is None else block.joints
    default = None if block is None else block.default

    def of(name: str) -> float:
        return float(values.get(name, own[name] if default is None else default))

    largest = max((of(name) for name in driven), default=0.0)
    added = {name: largest for name in passive if name not in values and not (default or own[name] > 0.0)}
    if not added or not largest > 0.0:
        return block
    if block is None:
        return PerJoint(joints=added, source="the driven joints'")
    return block.model_copy(update={"joints": {**values, **added}})


# Balls among a link's solids: where such a foot touches the ground depends on how it is turned.

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


# The mechanism that a robot's description and its URDF make of a tree of joints.


def mimic_couplings(root: ElementTree.Element, path: Path) -> tuple[CouplingBlock, ...]:
    """Couplings of the mimic joints of a URDF as :func:`~excite.robot.urdf.reading.read_urdf` leaves it.

    Raises:
        RobotError: a joint follows itself or one that is not there, or by a number that is none.
    """
    names = {joint.get("name", "") for joint in root.findall("joint")}
    found = []
    for joint in root.findall("joint"):
        name, mimic = joint.get("name", ""), joint.find("mimic")
        if mimic is None or joint.get("type") == "fixed":
            continue
        where, master = f"joint {name!r}/mimic", mimic.get("joint", "")
        if master not in names or master == name:
            raise robot_error(
                path,
                where,
                f"follows joint {master!r}, " + ("itself" if master == name else "which is not there"),
                "name the joint that it follows, or hold it still under locked_joints in robot.yaml",
            )
        (factor,) = read_numbers(mimic, "multiplier", 1, path, where, default="1")
        (offset,) = read_numbers(mimic, "offset", 1, path, where, default="0")
        if not 1.0 / MAX_RATIO**2 < abs(factor) < MAX_RATIO**2:
            raise robot_error(
                path, where, f"follows by a factor of {factor:g}", f"make {name!r} a fixed joint"
            )
        found.append(
            CouplingBlock(
                name=name, joints={name: 1.0, master: -factor}, offset=offset, passive=(name,), source="URDF"
            )
        )
    return tuple(found)


def read_mechanism(
    model: pin.Model,
    loops: tuple[LoopBlock, ...],
    couplings: tuple[CouplingBlock, ...],
    rest: Array,
    carrying: Sequence[int],
    path: Path,
) -> Mechanism | None:
    """The mechanism of a model, None where nothing closes it.

    Args:
        model: the tree.
        loops: of the description.
        couplings: of the description and of the URDF.
        rest: configuration near which it is closed ``(nq,)``; passive joints are a guess, but for those of legs.
        carrying: model joints that carry feet, which stay where ``rest`` has them if others can close the loops.
        path: file to name in errors.

    Raises:
        RobotError: a joint or link is not there, several blocks have one name, or the passive joints do not follow
            from the others.
    """
    blocks: tuple[TieBlock, ...] = (*loops, *couplings)
    if not blocks:
        return None
    closures: list[Closure] = [_read_loop(model, block, path) for block in loops]
    closures += [_read_coupling(model, block, path) for block in couplings]
    passive = tuple(dict.fromkeys(name for block in blocks for name in block.passive))
    for block in blocks:
        for name in block.passive:
            _joint_column(model, name, f"{_block_field(block)}.passive", path)
    if not passive:
        raise robot_error(
            path,
            "loops" if loops else "couplings",
            "leave every joint a motor of its own",
            "name under passive the joints that follow from the others",
        )
    try:
        return build_mechanism(model, closures, passive, rest, carrying)
    except MotionError as error:
        raise robot_error(
            path,
            error.field,
            f"{error.what.replace(' at sample 0', '')}",
            "check ends, posture and passive joints: as many of these as the loops determine",
        ) from error


def _block_field(block: TieBlock) -> str:
    return f"{'loops' if isinstance(block, LoopBlock) else 'couplings'}.{block.name}"


def _read_loop(model: pin.Model, block: LoopBlock, path: Path) -> Closure:
    ends = []
    for number, end in enumerate(block.ends):
        joint, link = link_placement(model, end.link, path, f"{_block_field(block)}.ends.{number}.link")
        ends.append((joint, link * pin.SE3(pin.rpy.rpyToMatrix(*end.rpy), np.array(end.xyz))))
    joints, placements = (ends[0][0], ends[1][0]), (ends[0][1], ends[1][1])
    if joints[0] == joints[1]:
        raise robot_error(
            path,
            _block_field(block),
            f"{block.ends[0].link!r} and {block.ends[1].link!r} do not move against each other",
            "remove it",
        )
    if block.kind != "rod":
        return Loop(block.name, joints, placements, rigid=block.kind == "weld")
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    points = [data.oMi[joint].act(place.translation) for joint, place in ends]
    length = float(np.linalg.norm(points[1] - points[0])) if block.length is None else block.length
    if length < 1e-6:
        raise robot_error(path, _block_field(block), "has no length", "make it a loop of kind point")
    return Rod(block.name, joints, placements, length)


def _read_coupling(model: pin.Model, block: CouplingBlock, path: Path) -> Coupling:
    columns = tuple(
        _joint_column(model, name, f"{_block_field(block)}.joints", path) for name in block.joints
    )
    factors = tuple(block.factors(name) for name in block.joints)
    return Coupling(block.name, columns, factors, block.offset)


def _joint_column(model: pin.Model, name: str, field: str, path: Path) -> tuple[int, int]:
    """A joint's index into q and v."""
    if not model.existJointName(name) or model.joints[model.getJointId(name)].nq != 1:
        raise unknown_name(path, field, "moving joint", name, list(model.names)[1:])
    joint = model.getJointId(name)
    return int(model.idx_qs[joint]), int(model.idx_vs[joint])
