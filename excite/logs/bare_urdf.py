"""The robot of a log that brings a bare URDF: what that does not say, and which inertias it gets wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import LogError
from excite.finding import Finding, list_names
from excite.logs.log import LogHeader
from excite.robot.description import RobotDescription
from excite.robot.robot import Robot
from excite.robot.urdf.inertia import inertial_faults, resting_faults
from excite.robot.urdf.model import urdf_model
from excite.robot.urdf.reading import parse_urdf
from excite.robot.urdf.tree import MOVING, check_tree

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

    def positive(values: Array) -> dict[str, float]:
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
        "velocity": {"joints": positive(model.velocityLimit), "source": "URDF"},
        "torque": {"joints": positive(model.effortLimit), "source": "URDF"},
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
