"""From a ``robot.yaml`` to a :class:`~excite.robot.robot.Robot`."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin
import yaml

from excite.arrays import Array
from excite.display import span
from excite.errors import MotionError, RobotError, raised_as
from excite.formats.documents import MAX_XML_BYTES
from excite.formats.file import read_bytes
from excite.results import Assumed
from excite.robot.catalogue import example_robot_data, find_robot
from excite.robot.description import FREE_BASES, FootBlock, RobotDescription, read_description
from excite.robot.joint_values import check_joints, per_joint, read_limits
from excite.robot.links import link_placement, read_foot, read_segments, read_sensors
from excite.robot.mechanisms.closures import (
    Closure,
    Coupling,
    CouplingBlock,
    Loop,
    LoopBlock,
    Rod,
    add_motors,
    closures_of,
)
from excite.robot.mechanisms.mechanism import Mechanism, build_mechanism
from excite.robot.quantities import MAX_RATIO, Block, PerJoint
from excite.robot.refusal import robot_error, unknown_name
from excite.robot.robot import Foot, Robot
from excite.robot.shapes.collision import ground_is_assumed
from excite.robot.shapes.shape import joints_at
from excite.robot.urdf.inertia import check_weights
from excite.robot.urdf.limits import LARGEST, assumed_limits, read_limits_file, tighter_limits, with_tables
from excite.robot.urdf.numbers import read_number, read_origin
from excite.robot.urdf.reading import Stated, read_mimic, read_urdf, urdf_model

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
    check_weights(robot.model, robot.limits.torque, model_file(robot))
    return robot


def build_robot(description: RobotDescription, path: Path) -> Robot:
    """Build the robot of a validated description; ``path`` is the file that it was read from."""
    model_path = urdf_of(description, path)
    free, standing = description.base in FREE_BASES, description.base in ("fixed", "floating")
    block = description.model
    stated = Stated(free, description.locked_joints, description.limits.position.joints, block.acknowledged)
    urdf = read_urdf(model_path, stated)
    assumed = (
        *description.assumed,
        *([_ASSUMED_GROUND] if ground_is_assumed(description) else []),
        *_assumed_choices(description),
        *_assumed_limits(description, urdf.tightened),
    )
    fingerprint = _robot_fingerprint(description, model_path, urdf.root)
    add_motors(urdf.root, description.transmissions, path)
    model = urdf_model(urdf.root, model_path, floating=free)
    if model.njoints == 1:
        raise robot_error(model_path, None, "has no joint that moves", "describe at least one")
    model.gravity.linear = np.array(description.gravity)
    joint_names = tuple(list(model.names)[2 if free else 1 :])
    rods, gears = closures_of(description.transmissions)
    loops = (*description.loops, *rods)
    couplings = (*description.couplings, *mimic_couplings(urdf.root, model_path), *gears)
    passive = frozenset(name for block in (*loops, *couplings) for name in block.passive)
    check_joints(description, joint_names, path, passive)
    segments = read_segments(model, description, path)
    # The posture of the description, the base oriented and at height zero.
    q = pin.neutral(model)
    offset = 7 if description.base in FREE_BASES else 0
    if offset:
        q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(*description.posture.base_rpy)).coeffs()
    for joint, angle in description.posture.joints.items():
        q[offset + joint_names.index(joint)] = angle
    upright = np.asarray(q)
    carrying = [link_placement(model, foot.link, path, "feet")[0] for foot in description.feet]
    mechanism = read_mechanism(model, loops, couplings, upright, carrying, path)
    if mechanism is not None:
        upright = mechanism.rest
        description = without_motors(description, joint_names, mechanism, model)
    description = with_balls_down(description, urdf.root, model, upright, path)
    feet = tuple(read_foot(model, description, block.name, path, upright) for block in description.feet)
    sensors = read_sensors(model, description, path)
    _check_carriers(description, model, path)
    rest = _rest_configuration(model, description, upright, feet)
    return Robot(
        name=description.name,
        description=description.model_copy(update={"assumed": assumed}),
        source=path,
        urdf=urdf.text,
        hash=fingerprint,
        model=model,
        joint_names=joint_names,
        limits=read_limits(model, description, joint_names, path),
        # A robot that hangs or is held has its feet in the air: nothing reaches the ground, or a sensor there.
        feet=feet if standing else (),
        sensors=sensors if standing else (),
        segments=segments,
        rest=rest,
        mechanism=None if mechanism is None else replace(mechanism, rest=rest),
    )


def _check_carriers(description: RobotDescription, model: pin.Model, path: Path) -> None:
    """An IMU sits on a free base itself, and a payload on a link that moves; raises RobotError."""
    imu, uncertainty = description.sensors.imu, description.uncertainty
    if imu is not None:
        field = "sensors.imu.link"
        if link_placement(model, imu.link, path, field)[0] != 1 and description.base in FREE_BASES:
            what = f"link {imu.link!r} moves against the base"
            raise robot_error(path, field, what, "name the base's link, or one fixed to it")
    if uncertainty is not None and uncertainty.payload is not None:
        link, field = uncertainty.payload.link, "uncertainty.payload.link"
        if link_placement(model, link, path, field)[0] == 0:
            raise robot_error(
                path, field, f"link {link!r} does not move", "name the link that carries the load"
            )


# What is assumed beside what a description says.


_ASSUMED_GROUND = Assumed(
    what="ground",
    value="the plane that the base is mounted on; of a robot that hangs, below its reach",
    consequence="motions stay above it: state collision.table_height, or null where nothing is there",
)


def _assumed_choices(description: RobotDescription) -> Iterator[Assumed]:
    """Limits whose source says that who wrote the description chose them."""
    for name, unit in (("velocity", "/s"), ("acceleration", "/s²"), ("jerk", "/s³"), ("torque", "")):
        stated: PerJoint[float] | None = getattr(description.limits, name)
        if stated is not None and stated.source.startswith(CHOSEN):
            values = [*stated.joints.values(), *([] if stated.default is None else [stated.default])]
            units = f"rad{unit} or m{unit}" if unit else "N·m or N"
            value = f"{span(f'{min(values):g}', f'{max(values):g}')} {units}, {stated.source}"
            consequence = f"motions keep to it: state limits.{name} if the robot bears less, or more"
            yield Assumed(f"{name} limits", value, consequence)


# Limits that a robot.yaml calls otherwise than a URDF.
_FIELDS = {"effort": "torque"}


def _assumed_limits(
    description: RobotDescription, tightened: Mapping[str, Mapping[str, list[str]]]
) -> tuple[Assumed, ...]:
    """Limits of the model that stand elsewhere than in ``<limit>``, of joints of which the description says nothing."""

    def is_stated(name: str, what: str) -> bool:
        own = getattr(description.limits, _FIELDS.get(what, what))
        return name in description.locked_joints or (own is not None and name in own.joints)

    return assumed_limits(
        {
            said: {
                what: rest
                for what, names in changed.items()
                if (rest := [name for name in names if not is_stated(name, what)])
            }
            for said, changed in tightened.items()
        }
    )


@raised_as(RobotError)
def _robot_fingerprint(description: RobotDescription, model_path: Path, root: Element) -> str:
    """SHA-256 of all that a verdict on a motion depends on: description with its limits, model, collision geometry.

    What the description leaves at its default is left out, so that a field that is added later changes no robot; and so
    is its uncertainty, which moves margins over a set and no limit: a motion stays this robot's when it becomes known.
    """
    stated = description.model_copy(update={"uncertainty": None}).model_dump_json(
        by_alias=True, exclude_defaults=True
    )
    # The file as it is, not the text as loaded: that one holds paths of this machine.
    content = read_bytes(model_path, limit=MAX_XML_BYTES)
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
    return _portable_text(robot, read_description(robot.source))


def limited_description(robot: Robot, file: Path) -> str:
    """The same, with the joint limits of a file of MoveIt's kind: where they are tighter, and those by position.

    Raises:
        RobotError: it is no such file, names no joint of the robot, or leaves one no range.
    """
    description, limits = read_description(robot.source), robot.limits
    found = read_limits_file(file, robot.driven_names)
    changed: dict[str, dict[str, Any]] = {}
    for name, stated in found.limits.items():
        index, margin = robot.joint_index(name), description.limits.position.margin
        own = {key: float(getattr(limits, _FIELDS.get(key, key))[index]) for key in LARGEST}
        for what, value in tighter_limits(stated, own).items():
            changed.setdefault(_FIELDS.get(what, what), {})[name] = value
        low, high = float(limits.position_lower[index] - margin), float(limits.position_upper[index] + margin)
        lower, upper = stated.get("position", (low, high))
        kept = max(low, lower), min(high, upper)
        if kept[0] + 2.0 * margin >= kept[1]:
            what = f"{lower:g} … {upper:g} leaves nothing of {low:.4g} … {high:.4g}"
            raise robot_error(file, f"joint_limits.{name}", what, "correct one of them")
        if kept != (low, high):
            changed.setdefault("position", {})[name] = kept
    content = description.model_dump(mode="json", by_alias=True, exclude_unset=True)
    for what, joints in changed.items():
        block = content["limits"].get(what) or {"source": file.name}
        content["limits"][what] = {**block, "joints": {**block.get("joints", {}), **joints}}
    tables = [one.model_dump(exclude_defaults=True) for one in found.tables]
    if tables:
        content["limits"]["by_position"] = [*content["limits"].get("by_position", []), *tables]
    names = {what: [*joints] for what, joints in changed.items()}
    said = assumed_limits({file.name: with_tables(names, found)})
    content["assumed"] = [*content.get("assumed", []), *(one.to_json() for one in said)]
    return _portable_text(robot, RobotDescription.model_validate(content))


def _portable_text(robot: Robot, description: RobotDescription) -> str:
    path = str(model_file(robot).resolve())
    changed: dict[str, Any] = {"model": description.model.model_copy(update={"path": path, "package": None})}
    stated = description.uncertainty
    if stated is not None and stated.identified is not None:
        found = str((robot.source.parent / stated.identified).resolve())
        changed["uncertainty"] = stated.model_copy(update={"identified": found})
    # What is said to be absent, such as a table, is not what was left out.
    content = description.model_copy(update=changed)
    said = content.model_dump(mode="json", by_alias=True, exclude_unset=True)
    return str(yaml.safe_dump(said, sort_keys=False, allow_unicode=True))


def urdf_of(description: RobotDescription, path: Path) -> Path:
    """The URDF file that a description names; ``path`` is the description's."""
    if description.model.package is None:
        return path.parent / description.model.path
    return example_robot_data() / description.model.path


def _rest_configuration(
    model: pin.Model, description: RobotDescription, upright: Array, feet: tuple[Foot, ...]
) -> Array:
    """Rest configuration; the lowest sole corner of a standing robot touches the ground."""
    q, height = upright.copy(), description.posture.base_height
    if description.base in FREE_BASES and height is not None:
        q[2] = height
    elif description.base in FREE_BASES and feet:
        data = joints_at(model, q)
        q[2] -= min(data.oMi[foot.joint].act(corner)[2] for foot in feet for corner in foot.sole)
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
    passive = np.isin(np.arange(len(names)), mechanism.passive - first)
    followers = [name for name, follows in zip(names, passive, strict=True) if follows]

    def with_joints(block: Block, **values: Mapping[str, float]) -> Block:
        """A block with more joints in its fields, of those that are there."""
        own = {field: one for field in values if (one := getattr(block, field)) is not None}
        update = {f: one.model_copy(update={"joints": {**one.joints, **values[f]}}) for f, one in own.items()}
        return block.model_copy(update=update)

    zeros, limits = dict.fromkeys(followers, 0.0), description.limits
    stated = {"velocity": model.velocityLimit, "torque": model.effortLimit}
    largest = {}
    for field in ("velocity", "acceleration", "jerk", "torque"):
        block: PerJoint[float] | None = getattr(limits, field)
        values = per_joint(block, names, stated.get(field, np.zeros(model.nv))[first:])
        most = float(values[~passive].max(initial=0.0))
        joints = {} if block is None else block.joints
        known = dict(zip(names, values > 0.0, strict=True))
        lacking = [name for name in followers if not known[name] and name not in joints]
        if lacking and most > 0.0:
            largest[field] = dict.fromkeys(lacking, most)
            if block is None:
                limits = limits.model_copy(update={field: PerJoint[float](source="the driven joints'")})
    return description.model_copy(
        update={
            "controller": with_joints(description.controller, kp=zeros, kd=zeros),
            "drives": with_joints(description.drives, viscous=zeros, coulomb=zeros, armature=zeros),
            "limits": with_joints(limits, **largest),
        }
    )


# Balls among a link's solids: where such a foot touches the ground depends on how it is turned.

# A corner lies on a ball to the digits of a description, half a tenth of a millimetre; one written by hand to ten times
# that [m].
_ON = 5e-4


def with_balls_down(
    description: RobotDescription, root: Element, model: pin.Model, upright: Array, path: Path
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
    data, feet = joints_at(model, upright), []
    for foot in description.feet:
        centre = _ball_centre(root, description, foot, path) if foot.radius > 0.0 else None
        if centre is not None and description.posture.joints:
            joint, placement = link_placement(model, foot.link, path, f"feet.{foot.name}.link")
            down = (data.oMi[joint].rotation @ placement.rotation).T @ np.array([0.0, 0.0, -foot.radius])
            foot = foot.model_copy(update={"sole": (tuple((centre + down).tolist()),)})
        elif foot.radius > 0.0 and foot.centre is None and not description.posture.joints:
            # Feet that are meshes nearly all have their frame in the middle of the ball.
            about = abs(float(np.linalg.norm(foot.sole[0])) - foot.radius) < _ON
            centre = np.zeros(3) if centre is None and about else centre
            if centre is not None:
                foot = foot.model_copy(update={"centre": tuple(centre.tolist())})
        feet.append(foot)
    return description.model_copy(update={"feet": tuple(feet)})


def _ball_centre(root: Element, description: RobotDescription, foot: FootBlock, path: Path) -> Array | None:
    """Centre ``(3,)`` of the ball that a foot is, in its link's frame [m]; None where no solid is that ball."""
    block, link = description.collision, root.find(f"link[@name='{foot.link}']")
    balls = [
        (np.array(shape.xyz), shape.size[0])
        for shape in block.shapes
        if shape.link == foot.link and shape.kind == "sphere"
    ]
    for solid in [] if link is None else link.findall(block.geometry):
        sphere, where = solid.find("geometry/sphere"), f"link {foot.link!r}/{solid.tag}"
        if sphere is not None:
            centre = read_origin(solid, path, where).translation
            balls.append((centre, read_number(sphere, "radius", path, where)))
    for centre, radius in balls:
        from_centre = float(np.linalg.norm(np.array(foot.sole[0]) - centre))
        if max(abs(from_centre - radius), abs(foot.radius - radius)) < _ON:
            return np.asarray(centre)
    return None


# The mechanism that a robot's description and its URDF make of a tree of joints.


def mimic_couplings(root: Element, path: Path) -> tuple[CouplingBlock, ...]:
    """Couplings of the mimic joints of a URDF as :func:`~excite.robot.urdf.reading.read_urdf` leaves it.

    Raises:
        RobotError: a joint follows itself or one that is not there, or by a number that is none.
    """
    names = {joint.get("name", "") for joint in root.findall("joint")}
    found = []
    for joint in (one for one in root.findall("joint") if one.get("type") != "fixed"):
        name, mimic = joint.get("name", ""), joint.find("mimic")
        if mimic is None:
            continue
        where, master = f"joint {name!r}/mimic", mimic.get("joint", "")
        if master not in names or master == name:
            what = f"follows joint {master!r}, {'itself' if master == name else 'which is not there'}"
            remedy = "name the joint that it follows, or hold it still under locked_joints in robot.yaml"
            raise robot_error(path, where, what, remedy)
        factor, offset = read_mimic(mimic, path, where)
        if not 1.0 / MAX_RATIO**2 < abs(factor) < MAX_RATIO**2:
            what = f"follows by a factor of {factor:g}"
            raise robot_error(path, where, what, f"make {name!r} a fixed joint")
        joints: dict[str, float | tuple[float, ...]] = {name: 1.0, master: -factor}
        found.append(CouplingBlock(name=name, joints=joints, offset=offset, passive=(name,), source="URDF"))
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
        couplings: of the description and of the URDF.
        rest: configuration near which it is closed ``(nq,)``; passive joints are a guess, but for those of legs.
        carrying: model joints that carry feet, which stay where ``rest`` has them if others can close the loops.
        path: file to name in errors.

    Raises:
        RobotError: a joint or link is not there, several blocks have one name, or the passive joints do not follow
            from the others.
    """
    blocks: tuple[LoopBlock | CouplingBlock, ...] = (*loops, *couplings)
    if not blocks:
        return None
    closures = [_read_closure(model, block, path) for block in blocks]
    passive = tuple(dict.fromkeys(name for block in blocks for name in block.passive))
    if not passive:
        what = "leave every joint a motor of its own"
        remedy = "name under passive the joints that follow from the others"
        raise robot_error(path, "loops" if loops else "couplings", what, remedy)
    try:
        return build_mechanism(model, closures, passive, rest, carrying)
    except MotionError as error:
        what = error.what.replace(" at sample 0", "")
        remedy = "check ends, posture and passive joints: as many of these as the loops determine"
        raise robot_error(path, error.field, what, remedy) from error


def _read_closure(model: pin.Model, block: LoopBlock | CouplingBlock, path: Path) -> Closure:
    field = f"{'loops' if isinstance(block, LoopBlock) else 'couplings'}.{block.name}"
    for name in block.passive:
        _joint_column(model, name, f"{field}.passive", path)
    if isinstance(block, CouplingBlock):
        columns = tuple(_joint_column(model, name, f"{field}.joints", path) for name in block.joints)
        return Coupling(block.name, columns, tuple(map(block.factors, block.joints)), block.offset)
    ends = []
    for number, end in enumerate(block.ends):
        joint, link = link_placement(model, end.link, path, f"{field}.ends.{number}.link")
        ends.append((joint, link * pin.SE3(pin.rpy.rpyToMatrix(*end.rpy), np.array(end.xyz))))
    (one, here), (other, there) = ends
    if one == other:
        what = f"{block.ends[0].link!r} and {block.ends[1].link!r} do not move against each other"
        raise robot_error(path, field, what, "remove it")
    if block.kind != "rod":
        return Loop(block.name, (one, other), (here, there), rigid=block.kind == "weld")
    data = joints_at(model, pin.neutral(model))
    apart = data.oMi[other].act(there.translation) - data.oMi[one].act(here.translation)
    length = float(np.linalg.norm(apart)) if block.length is None else block.length
    if length < 1e-6:
        raise robot_error(path, field, "has no length", "make it a loop of kind point")
    return Rod(block.name, (one, other), (here, there), length=length)


def _joint_column(model: pin.Model, name: str, field: str, path: Path) -> tuple[int, int]:
    """A joint's index into q and v."""
    if not model.existJointName(name) or model.joints[model.getJointId(name)].nq != 1:
        raise unknown_name(path, field, "moving joint", name, list(model.names)[1:])
    joint = model.getJointId(name)
    return int(model.idx_qs[joint]), int(model.idx_vs[joint])
