"""The robot that a log speaks of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import LogError, RobotError, raised_as
from excite.finding import Finding, list_names
from excite.formats.documents import read_xml
from excite.logs.header import header_path, read_header
from excite.logs.header_blocks import FootHeader, SensorHeader
from excite.logs.log import Log, LogHeader
from excite.robot.catalogue import bundled_robots
from excite.robot.description import RobotDescription
from excite.robot.init_robot.model_metadata import states_mass
from excite.robot.links import link_placement
from excite.robot.load import load_robot
from excite.robot.loading import build_robot
from excite.robot.mechanisms.mechanism import Mechanism
from excite.robot.robot import Robot, WrenchSensor
from excite.robot.urdf.inertia import inertial_faults, resting_faults
from excite.robot.urdf.reading import parse_urdf, urdf_model
from excite.robot.urdf.tree import MOVING, check_tree


def nominal_robot(log: Log) -> Robot:
    """Robot of a log that was read from a folder, from the model file that its header names.

    A bare URDF says nothing of postures, gains and accelerations; those get placeholders that identification
    does not use. Movable joints of the URDF that are not in the log are locked at zero. Inertias that no body
    has are accepted, being a starting value only; :func:`~excite.logs.robot.nominal_faults` names them.

    Raises:
        LogError: the log was made in memory, or the URDF does not fit the header.
        RobotError: the model is malformed.
    """
    if log.folder is None:
        raise LogError("was made in memory", field="robot", remedy="hand the robot over")
    file = log.folder / log.header.robot
    if not file.is_file() and log.header.robot in bundled_robots():
        loaded = _robot_as_held(load_robot(log.header.robot), log.header)
        return robot_in_log(loaded, log.header, log.folder / "log.yaml")
    if file.suffix in {".yaml", ".yml"}:
        return robot_in_log(load_robot(file), log.header, log.folder / "log.yaml")
    return robot_in_log(
        build_robot(bare_description(file, log.header), file), log.header, log.folder / "log.yaml"
    )


@raised_as(RobotError)
def robot_for_log(name_or_path: str | Path, log: str | Path) -> Robot:
    """The robot that logs are to be read with: a bundled one, a ``robot.yaml``, or a bare model.

    Args:
        name_or_path: bundled name or path; of a URDF only the joints that the log has stay movable.
        log: a log folder or its ``log.yaml``; asked only where a URDF is given.

    Returns:
        The robot, checked.

    Raises:
        RobotError: the model is malformed; LogError: the log's header is, or does not fit the URDF.
        UnknownNameError: no such robot.
    """
    file = Path(name_or_path)
    if file.suffix != ".urdf" or not states_mass(read_xml(file)):
        robot = load_robot(name_or_path)
        return _robot_as_held(robot, read_header(header_path(log))) if robot.floating else robot
    path = header_path(log)
    header = read_header(path)
    return robot_in_log(build_robot(bare_description(file, header), file), header, path)


def _robot_as_held(robot: Robot, header: LogHeader) -> Robot:
    """The robot as a log has it: one that stands on feet may have been held, by a stand or by hands."""
    if not robot.floating or header.base != "held":
        return robot
    sensors = robot.description.sensors.model_copy(update={"wrench": ()})
    held = robot.description.model_copy(update={"base": "held", "feet": (), "sensors": sensors})
    return build_robot(held, robot.source)


def robot_in_log(robot: Robot, header: LogHeader, source: Path | None = None) -> Robot:
    """The robot with the gravity and the wrench sensors that a log states.

    Args:
        robot: the robot.
        header: contents of ``log.yaml``.
        source: file to name in errors.

    Returns:
        A robot that differs in ``model.gravity`` and ``sensors`` only, and in which of a mechanism's joints follow from
        which; one that hangs stands on no feet.

    Raises:
        LogError: base, joints, base link or sensors do not fit the robot.
    """
    if robot.floating != header.free_base:
        raise LogError(f"is {header.base}, unlike that of robot {robot.name!r}", source=source, field="base")
    for joint in header.joints:
        if joint not in robot.joint_names:
            raise LogError(
                f"robot {robot.name!r} has no joint {joint!r}",
                source=source,
                field="joints",
                remedy="it has " + ", ".join(robot.joint_names),
            )
    if robot.mechanism is not None:
        robot = replace(robot, mechanism=_logged_mechanism(robot.mechanism, robot, header, source))
    model = robot.model.copy()
    model.gravity.linear = np.array(header.gravity)
    sensors = tuple(_wrench_sensor(robot, sensor, source) for sensor in header.sensors)
    if header.base == "suspended":
        return replace(robot, model=model, sensors=(), feet=())
    return replace(robot, model=model, sensors=sensors)


def _logged_mechanism(
    mechanism: Mechanism, robot: Robot, header: LogHeader, source: Path | None
) -> Mechanism:
    """The mechanism by what a log has of it: its motors, or the joints that these move, from which the rest follows."""
    columns = np.array([robot.n_base_v + robot.joint_index(name) for name in header.joints], dtype=np.int64)
    found = mechanism.following_from(columns)
    both = np.intersect1d(found.passive, columns)
    if len(both):
        name = robot.joint_names[int(both[0]) - robot.n_base_v]
        raise LogError(
            f"says where joint {name!r} is, and it follows from others that it has, too",
            source=source,
            field="joints",
            remedy="leave it out, or the motors that move it",
        )
    return found


def base_offset(robot: Robot, header: LogHeader) -> pin.SE3:
    """Pose of the logged base link in the frame of the free-flyer; raises LogError if it moves there."""
    if header.base_link is None:
        return pin.SE3.Identity()
    return _placement_on_base(robot, header.base_link, "base_link", "pose")


def imu_placement(robot: Robot, header: LogHeader) -> pin.SE3:
    """Pose of the IMU's link in the frame of the free-flyer; raises LogError where it is not on the base."""
    link = "" if header.imu is None else header.imu.link
    return _placement_on_base(robot, link, "imu.link", "IMU")


def _placement_on_base(robot: Robot, link: str, field: str, what: str) -> pin.SE3:
    try:
        joint, placement = link_placement(robot.model, link, None, field)
    except RobotError as error:
        raise LogError(error.what, field=field, remedy=error.remedy) from error
    if joint != 1:
        raise LogError(
            f"link {link!r} moves against the root {robot.base_link!r}",
            field=field,
            remedy=f"log the {what} of the root link, or of one fixed to it",
        )
    return placement


def _wrench_sensor(robot: Robot, header: SensorHeader, source: Path | None) -> WrenchSensor:
    field = f"sensors.{header.name}"
    offset = pin.SE3(pin.rpy.rpyToMatrix(*header.rpy), np.array(header.xyz))
    try:
        joint, parent = (0, pin.SE3.Identity())
        if header.parent != "world":
            joint, parent = link_placement(robot.model, header.parent, source, f"{field}.parent")
        link_placement(robot.model, header.foot, source, f"{field}.foot")
        excludes = tuple(
            sorted(
                link_placement(robot.model, link, source, f"{field}.excludes")[0] - 1
                for link in header.excludes
            )
        )
    except RobotError as error:
        raise LogError(error.what, source=source, field=error.field, remedy=error.remedy) from error
    if (header.kind == "force_plate") != (header.parent == "world"):
        raise LogError(
            f"a {header.kind} has parent {header.parent!r}",
            source=source,
            field=f"{field}.parent",
            remedy="a force_plate has world for parent, a foot_ft a link",
        )
    return WrenchSensor(
        name=header.name,
        kind=header.kind,
        link=header.parent,
        joint=joint,
        placement=parent * offset,
        foot=header.foot,
        excludes=excludes,
        noise_force=header.noise_force or 0.0,
        noise_moment=header.noise_moment or 0.0,
    )


def foot_headers(robot: Robot) -> tuple[FootHeader, ...]:
    """The robot's feet as ``log.yaml`` has them."""
    blocks = {block.name: block for block in robot.description.feet}
    made = []
    for foot in robot.feet:
        centre = None
        if foot.radius > 0.0:
            # A log has no posture at rest, in which a ball's corner would be the lowest point.
            link = link_placement(robot.model, foot.link, robot.source, "feet")[1]
            x, y, z = np.round(link.actInv(foot.centre), 9).tolist()
            centre = (x, y, z)
        sole = blocks[foot.name].sole
        made.append(FootHeader(name=foot.name, link=foot.link, sole=sole, radius=foot.radius, centre=centre))
    return tuple(made)


def sensor_headers(robot: Robot) -> tuple[SensorHeader, ...]:
    """The robot's contact wrench sensors as ``log.yaml`` has them."""
    return tuple(
        SensorHeader(
            name=block.name,
            kind=block.kind,
            parent="world" if block.kind == "force_plate" else block.link,
            xyz=block.xyz,
            rpy=block.rpy,
            foot=robot.foot(block.foot).link,
            excludes=block.excludes,
            noise_force=block.noise_force,
            noise_moment=block.noise_moment,
        )
        for block in robot.description.sensors.wrench
    )


# The robot of a log that brings a bare URDF: what that does not say, and which inertias it gets wrong.

_UNSTATED = "not stated in the log"
_LOG_FOLDER = "the log's folder"
_MASSLESS = "an axis of a compound joint"
_AT_REST = "at rest: its inertia acts on nothing"


def nominal_faults(robot: Robot) -> tuple[Finding, ...]:
    """A finding that names the links of a bare URDF whose inertias no body has; empty where there are none.

    A ``robot.yaml`` acknowledges such links itself, with its reason.
    """
    if not is_bare(robot):
        return ()
    faults = {
        link: reason
        for link, reason in robot.description.model.acknowledged.items()
        if reason not in {_MASSLESS, _AT_REST}
    }
    if not faults:
        return ()
    said = [f"{link} ({reason})" for link, reason in faults.items()]
    text = (
        f"the nominal model has inertias that no body has: {list_names(said)}; they serve as a starting value only, "
        "so a method that keeps to the nominal model repeats them where the data say little"
    )
    return (Finding("nominal_inertia", text, {"links": float(len(faults))}, tuple(faults)),)


def is_bare(robot: Robot) -> bool:
    """Whether a robot is a bare URDF with placeholders, as :func:`bare_description` makes it for a log."""
    return robot.description.model.source == _LOG_FOLDER


def bare_description(file: Path, header: LogHeader) -> RobotDescription:
    """Description of the robot of a bare URDF, with placeholders for what neither it nor the log's header states.

    Args:
        file: the URDF.
        header: header of the log.

    Raises:
        LogError: a joint of the header is not in the URDF.
        RobotError: the URDF is malformed.
    """
    root = parse_urdf(file)
    check_tree(root, file)
    model = urdf_model(root, file)
    movable = tuple(model.names)[1:]
    for joint in header.joints:
        if joint not in movable:
            raise LogError(
                f"no joint {joint!r} in {header.robot}", field="joints", remedy="it has " + ", ".join(movable)
            )
    locked = [joint for joint in movable if joint not in header.joints]
    return RobotDescription.model_validate(
        {
            "schema": "excite.robot/1",
            "name": model.name or file.stem,
            "title": model.name or file.stem,
            "model": {
                "path": file.name,
                "source": _LOG_FOLDER,
                "acknowledged": _accepted_faults(root, file, header),
            },
            "base": header.base,
            "locked_joints": dict.fromkeys(locked, 0.0),
            "posture": {"base_height": 0.0, "source": _UNSTATED},
            "limits": _header_limits(model, header),
            "feet": _header_feet(header),
            "sensors": _header_sensors(header),
            "controller": {
                "kp": {"default": 1.0, "source": _UNSTATED},
                "kd": {"default": 1.0, "source": _UNSTATED},
            },
            "collision": {"geometry": "collision", "margin": 0.0, "source": _UNSTATED},
            "gravity": header.gravity,
        }
    )


def _header_feet(header: LogHeader) -> list[dict[str, Any]]:
    """Feet that the log states, else those below its sensors, of whose soles nothing is known or needed."""
    said = {"friction": 1.0, "source": _UNSTATED}
    if header.feet:
        return [{**foot.model_dump(), **said} for foot in header.feet]
    sole = [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)]
    links = dict.fromkeys(sensor.foot for sensor in header.sensors)
    return [{"name": link, "link": link, "sole": sole, **said} for link in links]


def _header_limits(model: pin.Model, header: LogHeader) -> dict[str, Any]:
    """The URDF's limits of the joints in the log; wide ones where it has none, or none that a joint can keep."""
    index = [model.joints[model.getJointId(joint)].idx_v for joint in header.joints]

    def positive_limits(values: Array) -> dict[str, float]:
        usable = np.where(np.isfinite(values[index]) & (values[index] > 0.0), values[index], 1e3)
        return {joint: float(value) for joint, value in zip(header.joints, usable, strict=True)}

    position = {}
    for joint in header.joints:
        moved = model.joints[model.getJointId(joint)]
        low, high = model.lowerPositionLimit[moved.idx_q], model.upperPositionLimit[moved.idx_q]
        # What turns on and on has the two numbers of a direction for a position, and no range; a range without width is
        # one that nobody has filled in, as exporters leave it.
        if moved.nq == 1 and np.isfinite([low, high]).all() and low < high:
            position[joint] = (float(low), float(high))
    unbounded = {joint: (-2.0 * np.pi, 2.0 * np.pi) for joint in header.joints if joint not in position}
    return {
        "position": {"joints": position | unbounded, "source": "URDF"},
        "velocity": {"joints": positive_limits(model.velocityLimit), "source": "URDF"},
        "torque": {"joints": positive_limits(model.effortLimit), "source": "URDF"},
        "acceleration": {"default": 1e3, "source": _UNSTATED},
        "jerk": {"default": 1e5, "source": _UNSTATED},
    }


def _header_sensors(header: LogHeader) -> dict[str, Any]:
    """The sensors that the log has, without noise: it is estimated."""
    return {
        "rate_hz": header.rate_hz,
        "noise_position": 0.0,
        "joint_torque": "motor_side" if header.torque in {"motor_side", "current"} else "link_side",
        "wrench": [
            {"name": s.name, "kind": s.kind, "link": s.foot, "foot": s.foot, "noise_force": 0.0}
            | {"noise_moment": 0.0}
            for s in header.sensors
        ],
        "source": "log.yaml",
    }


def _accepted_faults(root: ElementTree.Element, file: Path, header: LogHeader) -> dict[str, str]:
    """Links without mass or with inertias that no body has, with what is wrong; the joints not in the log fixed.

    Raises RobotError for what is no starting value either: a number that is none, a negative mass.
    """
    joints = check_tree(root, file)
    for name, joint in joints.items():
        if joint.get("type") in MOVING and name not in header.joints:
            joint.set("type", "fixed")
    floating = header.free_base
    faults = inertial_faults(root, joints, floating, file)
    accepted = {link: _MASSLESS if "no mass" in error.what else error.what for link, error in faults.items()}
    return accepted | ({} if floating else dict.fromkeys(resting_faults(root, joints, file), _AT_REST))
