"""Definitions of control_msgs for bags that do not bring them: the controller's state has had three layouts."""

from __future__ import annotations

import struct
from typing import Any

KIND = "control_msgs/msg/JointTrajectoryControllerState"
_POINT, _MANY = "trajectory_msgs/JointTrajectoryPoint", "trajectory_msgs/MultiDOFJointTrajectoryPoint"
_NAMES = "std_msgs/Header header\nstring[] joint_names\n"


def _points(kind: str, *names: str) -> str:
    return "".join(f"{kind} {name}\n" for name in names)


_HUMBLE = _NAMES + _points(_POINT, "desired", "actual", "error")
_IRON = (
    _NAMES
    + _points(_POINT, "reference", "feedback", "error", "output")
    + "string[] multi_dof_joint_names\n"
    + _points(_MANY, "multi_dof_reference", "multi_dof_feedback", "multi_dof_error", "multi_dof_output")
)
_LAYOUTS = (_IRON + "float64 speed_scaling_factor\n", _IRON, _HUMBLE)
_INTERFACES = {
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values",
    "control_msgs/msg/DynamicJointState": _NAMES + "control_msgs/InterfaceValue[] interface_values",
}


def register_interfaces(store: Any) -> None:
    """Add what has had one layout only to a typestore of rosbags."""
    from rosbags.typesys import get_types_from_msg

    types: dict[str, Any] = {}
    for name, text in _INTERFACES.items():
        types |= get_types_from_msg(text, name)
    store.register(types)


def register_state(store: Any, raw: bytes) -> bool:
    """Add the layout of the controller's state that a message follows to its last byte; False where none does."""
    from rosbags.serde import SerdeError
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    for layout in _LAYOUTS:
        types = get_types_from_msg(layout, KIND)
        trial = get_typestore(Stores.ROS2_HUMBLE)
        trial.register(types)
        try:
            message: Any = trial.deserialize_cdr(raw, KIND)
        except (SerdeError, AssertionError, IndexError, ValueError, struct.error):
            continue
        points = (
            [message.desired, message.actual] if layout is _HUMBLE else [message.reference, message.feedback]
        )
        if any(len(point.positions) == len(message.joint_names) > 0 for point in points):
            store.register(types)
            return True
    return False
