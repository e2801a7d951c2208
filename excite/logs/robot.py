"""The robot that a log speaks of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.errors import LogError, RobotError
from excite.logs.finding import Finding, listed
from excite.logs.header import read_header
from excite.logs.log import Log, LogHeader, SensorHeader
from excite.robot.description import RobotDescription
from excite.robot.links import link_placement
from excite.robot.loading import build_robot, load_robot
from excite.robot.robot import Array, Robot, WrenchSensor
from excite.robot.urdf import parse_urdf
from excite.robot.urdf_inertia import inertial_faults, resting_faults
from excite.robot.urdf_tree import MOVING, check_tree

_UNSTATED = "not stated in the log"
_LOG_FOLDER = "the log's folder"
_MASSLESS = "an axis of a compound joint"
_AT_REST = "at rest: its inertia acts on nothing"


def nominal_robot(log: Log) -> Robot:
    """Robot of a log that was read from a folder, from the model file that its header names.

    A bare URDF says nothing of postures, gains and accelerations; those get placeholders that identification
    does not use. Movable joints of the URDF that are not in the log are locked at zero. Inertias that no body
    has are accepted, being a starting value only; :func:`nominal_faults` names them.

    Raises:
        LogError: the log was made in memory, or the URDF does not fit the header.
        RobotError: the model is malformed.
    """
    if log.folder is None:
        raise LogError("was made in memory", field="robot", remedy="hand the robot over")
    file = log.folder / log.header.robot
    if file.suffix in {".yaml", ".yml"}:
        return robot_in_log(load_robot(file), log.header, log.folder / "log.yaml")
    return robot_in_log(
        build_robot(_bare_description(file, log.header), file), log.header, log.folder / "log.yaml"
    )


def robot_for_log(name_or_path: str | Path, log: str | Path) -> Robot:
    """The robot that logs are to be read with: a bundled one, a ``robot.yaml``, or a bare URDF.

    Args:
        name_or_path: bundled name or path; of a URDF only the joints that the log has stay movable.
        log: a log folder or its ``log.yaml``; asked only where a URDF is given.

    Raises:
        RobotError: the model is malformed; LogError: the log's header is, or does not fit the URDF.
        UnknownNameError: no such robot.
    """
    file = Path(name_or_path)
    if file.suffix != ".urdf":
        return load_robot(name_or_path)
    path = Path(log) / "log.yaml" if Path(log).is_dir() else Path(log)
    header = read_header(path)
    return robot_in_log(build_robot(_bare_description(file, header), file), header, path)


def robot_in_log(robot: Robot, header: LogHeader, source: Path | None = None) -> Robot:
    """The robot with the gravity and the wrench sensors that a log states.

    Args:
        robot: the robot.
        header: contents of ``log.yaml``.
        source: file to name in errors.

    Returns:
        A robot that differs in ``model.gravity`` and ``sensors`` only.

    Raises:
        LogError: base, joints, base link or sensors do not fit the robot.
    """
    if robot.floating != (header.base != "fixed"):
        raise LogError(f"is {header.base}, unlike that of robot {robot.name!r}", source=source, field="base")
    for joint in header.joints:
        if joint not in robot.joint_names:
            raise LogError(
                f"robot {robot.name!r} has no joint {joint!r}",
                source=source,
                field="joints",
                remedy="it has " + ", ".join(robot.joint_names),
            )
    model = robot.model.copy()
    model.gravity.linear = np.array(header.gravity)
    sensors = tuple(_sensor(robot, sensor, source) for sensor in header.sensors)
    return replace(robot, model=model, sensors=sensors)


def base_offset(robot: Robot, header: LogHeader, source: Path | None = None) -> pin.SE3:
    """Pose of the logged base link in the frame of the free-flyer; raises LogError if it moves there."""
    if header.base_link is None:
        return pin.SE3.Identity()
    try:
        joint, placement = link_placement(robot.model, header.base_link, source, "base_link")
    except RobotError as error:
        raise LogError(error.what, source=source, field="base_link", remedy=error.remedy) from error
    if joint != 1:
        raise LogError(
            f"link {header.base_link!r} moves against the root {robot.base_link!r}",
            source=source,
            field="base_link",
            remedy="log the pose of the root link, or of one fixed to it",
        )
    return placement


def _sensor(robot: Robot, header: SensorHeader, source: Path | None) -> WrenchSensor:
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
        excludes_links=header.excludes,
        noise_force=header.noise_force or 0.0,
        noise_moment=header.noise_moment or 0.0,
    )


def nominal_faults(robot: Robot) -> tuple[Finding, ...]:
    """A finding that names the links of a bare URDF whose inertias no body has; empty where there are none.

    A ``robot.yaml`` acknowledges such links itself, with its reason.
    """
    if robot.description.model.source != _LOG_FOLDER:
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
        f"the nominal model has inertias that no body has: {listed(said)}; they serve as a starting value only, "
        "so a method that keeps to the nominal model repeats them where the data say little"
    )
    return (Finding("nominal_inertia", text, {"links": float(len(faults))}, tuple(faults)),)


def _bare_description(file: Path, header: LogHeader) -> RobotDescription:
    # What pinocchio would swallow is checked when the robot is built from this description.
    root = parse_urdf(file)
    model = pin.buildModelFromXML(ElementTree.tostring(root, encoding="unicode"))
    movable = tuple(model.names)[1:]
    for joint in header.joints:
        if joint not in movable:
            raise LogError(
                f"no joint {joint!r} in {header.robot}", field="joints", remedy="it has " + ", ".join(movable)
            )
    locked = [joint for joint in movable if joint not in header.joints]
    index = [model.joints[model.getJointId(joint)].idx_v for joint in header.joints]

    def positive(values: Array) -> dict[str, float]:
        usable = np.where(np.isfinite(values[index]) & (values[index] > 0.0), values[index], 1e3)
        return {joint: float(value) for joint, value in zip(header.joints, usable, strict=True)}

    ranges = zip(header.joints, model.lowerPositionLimit[index], model.upperPositionLimit[index], strict=True)
    position = {
        joint: (float(low), float(high)) for joint, low, high in ranges if np.isfinite([low, high]).all()
    }
    unbounded = {joint: (-np.pi, np.pi) for joint in header.joints if joint not in position}
    narrow = {joint: (low - 1e-3, high + 1e-3) for joint, (low, high) in position.items() if not low < high}
    return RobotDescription.model_validate(
        {
            "schema": "excite.robot/1",
            "name": model.name or file.stem,
            "title": f"{model.name or file.stem}, nominal model of a log",
            "model": {
                "path": file.name,
                "source": _LOG_FOLDER,
                "acknowledged": _accepted(root, file, header),
            },
            "base": "fixed" if header.base == "fixed" else "floating",
            "locked_joints": dict.fromkeys(locked, 0.0),
            "posture": {"base_height": 0.0, "source": _UNSTATED},
            "limits": {
                "position": {"joints": position | unbounded | narrow, "source": "URDF"},
                "velocity": {"joints": positive(model.velocityLimit), "source": "URDF"},
                "torque": {"joints": positive(model.effortLimit), "source": "URDF"},
                "acceleration": {"default": 1e3, "source": _UNSTATED},
                "jerk": {"default": 1e5, "source": _UNSTATED},
            },
            "feet": [
                {
                    "name": link,
                    "link": link,
                    "sole": [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)],
                    "source": _UNSTATED,
                }
                | {"friction": 1.0}
                for link in dict.fromkeys(sensor.foot for sensor in header.sensors)
            ],
            "sensors": {
                "rate_hz": header.rate_hz,
                "noise_position": 0.0,
                "joint_torque": "motor_side" if header.torque in {"motor_side", "current"} else "link_side",
                "wrench": [
                    {"name": s.name, "kind": s.kind, "link": s.foot, "foot": s.foot, "noise_force": 0.0}
                    | {"noise_moment": 0.0}
                    for s in header.sensors
                ],
                "source": "log.yaml",
            },
            "controller": {
                "kp": {"default": 1.0, "source": _UNSTATED},
                "kd": {"default": 1.0, "source": _UNSTATED},
            },
            "collision": {"geometry": "collision", "margin": 0.0, "source": _UNSTATED},
            "gravity": header.gravity,
        }
    )


def _accepted(root: ElementTree.Element, file: Path, header: LogHeader) -> dict[str, str]:
    """Links without mass or with inertias that no body has, with what is wrong; the joints not in the log fixed.

    Raises RobotError for what is no starting value either: a number that is none, a negative mass.
    """
    joints = check_tree(root, file)
    for name, joint in joints.items():
        if joint.get("type") in MOVING and name not in header.joints:
            joint.set("type", "fixed")
    floating = header.base != "fixed"
    faults = inertial_faults(root, joints, floating, file)
    accepted = {link: _MASSLESS if "no mass" in error.what else error.what for link, error in faults.items()}
    return accepted | ({} if floating else dict.fromkeys(resting_faults(root, joints, file), _AT_REST))
