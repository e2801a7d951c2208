"""Messages of ROS and of Unitree as rows of numbers with what they mean: one function a type.

The fields are those of the types' definitions (sensor_msgs, control_msgs, geometry_msgs, nav_msgs, trajectory_msgs,
unitree_hg, unitree_go); a decoder of any library that gives them as attributes serves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any

import numpy as np

from excite.conversion.sources.ros.gathered import Field, Row
from excite.conversion.sources.ros.unitree import LOW_COMMAND, LOW_STATE


def is_wanted(kind: str) -> bool:
    """Whether a message type is read; names with or without ``/msg/``."""
    return _short(kind) in _DECODERS


def decode(kind: str, message: Any, topic: str) -> Row:
    """Fields and numbers of one message."""
    return _DECODERS[_short(kind)](message, topic)


def stamp_s(message: Any) -> float | None:
    """The time that a message's header states [s]; None for none, or for one that was left at zero."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    seconds = getattr(stamp, "sec", getattr(stamp, "secs", 0))
    rest = getattr(stamp, "nanosec", getattr(stamp, "nsecs", 0))
    found = float(seconds) + 1e-9 * float(rest)
    return found or None


def _short(kind: str) -> str:
    return kind.replace("/msg/", "/")


def _joints(names: Iterable[str], parts: Iterable[tuple[str, str, Any]]) -> Row:
    """Arrays over joints; those that are empty, as efforts may be, are left out."""
    names = tuple(names)
    words: list[tuple[str, str]] = []
    numbers: list[float] = []
    for word, channel, values in parts:
        if values is not None and len(values) == len(names):
            words.append((word, channel))
            numbers += np.asarray(values, dtype=float).tolist()
    return _layout(names, tuple(words)), numbers


# Layouts of some topics; orders of joints may differ from message to message.
@lru_cache(maxsize=1024)
def _layout(names: tuple[str, ...], words: tuple[tuple[str, str], ...]) -> tuple[Field, ...]:
    """Fields of arrays over joints: the same object for the same ones, as making them takes longer than decoding."""
    return tuple(Field(f"{word}.{name}", channel, name) for word, channel in words for name in names)


def _joint_state(message: Any, topic: str) -> Row:
    parts = (
        ("position", "q", message.position),
        ("velocity", "v", message.velocity),
        ("effort", "tau", message.effort),
    )
    return _joints(message.name, parts)


def _controller_state(message: Any, topic: str) -> Row:
    """Reference, feedback and output; ``desired`` and ``actual`` in older versions."""
    wanted = _first(message, ("reference", "desired"))
    actual = _first(message, ("feedback", "actual"))
    output = getattr(message, "output", None)
    parts = [
        ("feedback.position", "q", getattr(actual, "positions", None)),
        ("feedback.velocity", "v", getattr(actual, "velocities", None)),
        ("feedback.effort", "tau", getattr(actual, "effort", None)),
        ("reference.position", "q_cmd", getattr(wanted, "positions", None)),
        ("output.effort", "tau_cmd", getattr(output, "effort", None)),
    ]
    return _joints(message.joint_names, parts)


def _first(message: Any, names: tuple[str, ...]) -> Any:
    found = [getattr(message, name) for name in names if getattr(message, name, None) is not None]
    with_positions = [item for item in found if len(item.positions)]
    return (with_positions or found or [None])[0]


def _wrench(message: Any, topic: str) -> Row:
    force, torque = message.wrench.force, message.wrench.torque
    sensor = _sensor(topic, getattr(message.header, "frame_id", ""))
    values = (force.x, force.y, force.z, torque.x, torque.y, torque.z)
    axes = ("fx", "fy", "fz", "tx", "ty", "tz")
    return [Field(f"{sensor}.{axis}", "wrench", f"{sensor}.{axis}") for axis in axes], [
        float(v) for v in values
    ]


def _sensor(topic: str, frame: str) -> str:
    words = [word for word in topic.split("/") if word and word not in {"wrench", "data", "raw", "filtered"}]
    return (words[-1] if words else frame) or "wrench"


def _odometry(message: Any, topic: str) -> Row:
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    values = {
        "px": place.x,
        "py": place.y,
        "pz": place.z,
        "qx": turn.x,
        "qy": turn.y,
        "qz": turn.z,
        "qw": turn.w,
    }
    return [Field(f"pose.{axis}", "base", axis) for axis in values], [float(v) for v in values.values()]


def _imu(message: Any, topic: str) -> Row:
    parts = (("orientation", message.orientation, "xyzw"), ("gyro", message.angular_velocity, "xyz"),
             ("acc", message.linear_acceleration, "xyz"))  # fmt: skip
    called = {"gyro": "g", "acc": "a"}
    fields = [
        Field(f"{word}.{axis}", "imu", called[word] + axis)
        if word in called
        else Field(f"{word}.{axis}", "skip", axis)
        for word, _, axes in parts
        for axis in axes
    ]
    return fields, [float(getattr(value, axis)) for _, value, axes in parts for axis in axes]


def _dynamic_joint_state(message: Any, topic: str) -> Row:
    """Values of each joint by the names of its interfaces, as ros2_control's broadcaster has them."""
    channels = {"position": "q", "velocity": "v", "effort": "tau"}
    fields: list[Field] = []
    numbers: list[float] = []
    for joint, values in zip(message.joint_names, message.interface_values, strict=False):
        for name, value in zip(values.interface_names, values.values, strict=False):
            fields.append(Field(f"{name}.{joint}", channels.get(name, ""), joint if name in channels else ""))
            numbers.append(float(value))
    return fields, numbers


_DECODERS: dict[str, Callable[[Any, str], Row]] = {
    "sensor_msgs/JointState": _joint_state,
    "control_msgs/JointTrajectoryControllerState": _controller_state,
    "control_msgs/DynamicJointState": _dynamic_joint_state,
    "geometry_msgs/WrenchStamped": _wrench,
    "nav_msgs/Odometry": _odometry,
    "sensor_msgs/Imu": _imu,
    "unitree_hg/LowState": LOW_STATE,
    "unitree_hg/LowCmd": LOW_COMMAND,
    "unitree_go/LowState": LOW_STATE,
    "unitree_go/LowCmd": LOW_COMMAND,
}


def trajectory_rows(message: Any) -> Iterable[tuple[float, Row]]:
    """Times and rows of a JointTrajectory: a whole motion in one message."""
    for point in message.points:
        lasts = point.time_from_start
        seconds = getattr(lasts, "sec", getattr(lasts, "secs", 0))
        rest = getattr(lasts, "nanosec", getattr(lasts, "nsecs", 0))
        parts = (
            ("position", "q_cmd", point.positions),
            ("velocity", "skip", point.velocities),
            ("effort", "tau_cmd", point.effort),
        )
        yield float(seconds) + 1e-9 * float(rest), _joints(message.joint_names, parts)


TRAJECTORY = "trajectory_msgs/JointTrajectory"


def is_trajectory(kind: str) -> bool:
    """Whether a message type holds a whole motion."""
    return _short(kind) == TRAJECTORY
