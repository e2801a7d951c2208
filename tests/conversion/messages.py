"""Bags of one message type each, written by rosbags from the types' published definitions."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tests.conversion.written import stamp

_IMU = "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\n"
_HG_MOTOR = (
    "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nint16[2] temperature\nfloat32 vol\n"
    "uint32[2] sensor\nuint32 motorstate\nuint32[4] reserve"
)
_GO_MOTOR = (
    "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nfloat32 q_raw\nfloat32 dq_raw\n"
    "float32 ddq_raw\nint8 temperature\nuint32 lost\nuint32[2] reserve"
)
_COMMAND = "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\n"
_GO_HEAD = "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\nuint16 bandwidth\n"
POINT = "trajectory_msgs/msg/JointTrajectoryPoint"
DEFINITIONS = {
    "unitree_hg/msg/IMUState": _IMU + "int16 temperature",
    "unitree_hg/msg/MotorState": _HG_MOTOR,
    "unitree_hg/msg/MotorCmd": _COMMAND + "uint32 reserve",
    "unitree_hg/msg/LowState": "uint32[2] version\nuint8 mode_pr\nuint8 mode_machine\nuint32 tick\n"
    "unitree_hg/IMUState imu_state\nunitree_hg/MotorState[35] motor_state\nuint8[40] wireless_remote\n"
    "uint32[4] reserve\nuint32 crc",
    "unitree_hg/msg/LowCmd": "uint8 mode_pr\nuint8 mode_machine\nunitree_hg/MotorCmd[35] motor_cmd\n"
    "uint32[4] reserve\nuint32 crc",
    "unitree_go/msg/IMUState": _IMU + "int8 temperature",
    "unitree_go/msg/MotorState": _GO_MOTOR,
    "unitree_go/msg/MotorCmd": _COMMAND + "uint32[3] reserve",
    "unitree_go/msg/BmsState": "uint8 version_high\nuint8 version_low\nuint8 status\nuint8 soc\nint32 current\n"
    "uint16 cycle\nint8[2] bq_ntc\nint8[2] mcu_ntc\nuint16[15] cell_vol",
    "unitree_go/msg/BmsCmd": "uint8 off\nuint8[3] reserve",
    "unitree_go/msg/LowState": _GO_HEAD
    + "unitree_go/IMUState imu_state\nunitree_go/MotorState[20] motor_state\nunitree_go/BmsState bms_state\n"
    "int16[4] foot_force\nint16[4] foot_force_est\nuint32 tick\nuint8[40] wireless_remote\nuint8 bit_flag\n"
    "float32 adc_reel\nint8 temperature_ntc1\nint8 temperature_ntc2\nfloat32 power_v\nfloat32 power_a\n"
    "uint16[4] fan_frequency\nuint32 reserve\nuint32 crc",
    "unitree_go/msg/LowCmd": _GO_HEAD
    + "unitree_go/MotorCmd[20] motor_cmd\nunitree_go/BmsCmd bms_cmd\nuint8[40] wireless_remote\nuint8[12] led\n"
    "uint8[2] fan\nuint8 gpio\nuint32 reserve\nuint32 crc",
    "control_msgs/msg/JointTrajectoryControllerState": "std_msgs/Header header\nstring[] joint_names\n"
    f"{POINT} reference\n{POINT} feedback\n{POINT} error\n{POINT} output\n"
    "string[] multi_dof_joint_names\ntrajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_reference\n"
    "trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_feedback\n"
    "trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_error\n"
    "trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_output",
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values",
    "control_msgs/msg/DynamicJointState": "std_msgs/Header header\nstring[] joint_names\n"
    "control_msgs/InterfaceValue[] interface_values",
    "franka_msgs/msg/FrankaState": "std_msgs/Header header\nfloat64[7] q\nfloat64[7] dq\nfloat64[7] tau_J\n"
    "float64[7] dtau_J\nfloat64[7] q_d\nfloat64[7] tau_ext_hat_filtered\nfloat64[16] O_T_EE\nfloat64 m_load\n"
    "float64[3] F_x_Cload\nbool[7] joint_contact",
}
# The older state of the controller, with desired and actual points.
OLD_CONTROLLER_STATE = (
    "std_msgs/Header header\nstring[] joint_names\n"
    f"{POINT} desired\n{POINT} actual\n{POINT} error"
)  # fmt: skip


def store(**definitions: str) -> Any:
    """A typestore of ROS 2 Humble with these types; others' definitions by ``package__Type``."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    found = get_typestore(Stores.ROS2_HUMBLE)
    types: dict[str, Any] = {}
    for name, text in (DEFINITIONS | {k.replace("__", "/msg/"): v for k, v in definitions.items()}).items():
        types |= get_types_from_msg(text, name)
    found.register(types)
    return found


def filled(types: Any, kind: str, **values: Any) -> Any:
    """A message of a type, everything else in it zero or empty."""
    from rosbags.interfaces import Nodetype

    zeros: dict[str, Any] = {}
    for name, (node, inner) in types.fielddefs[kind][1]:
        zeros[name] = _nothing(types, node, inner, Nodetype)
    return types.types[kind](**(zeros | values))


def _nothing(types: Any, node: Any, inner: Any, nodes: Any) -> Any:
    if node == nodes.BASE:
        return "" if inner[0] == "string" else False if inner[0] == "bool" else 0
    if node == nodes.NAME:
        return filled(types, inner)
    count = inner[1] if node == nodes.ARRAY else 0
    kind, name = inner[0]
    if kind == nodes.NAME:
        return [filled(types, name) for _ in range(count)]
    if name[0] == "string":
        return [""] * count
    return np.zeros(count, dtype={"byte": "uint8", "char": "int8"}.get(name[0], name[0]))


def bag(
    path: Path,
    types: Any,
    topics: dict[str, tuple[str, Iterable[tuple[float, Any]]]],
    *,
    version: Literal[8, 9] = 9,
    mcap: bool = True,
) -> Path:
    """A bag of topics: by name the message type, and times [s] with messages."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(path, version=version, storage_plugin=plugin) as writer:
        for topic, (kind, messages) in topics.items():
            connection = writer.add_connection(topic, kind, typestore=types)
            for time, message in messages:
                writer.write(connection, round(time * 1e9), types.serialize_cdr(message, kind))
    return path


def low_states(
    types: Any, family: str, data: dict[str, np.ndarray], motors: list[int], **fields: Any
) -> Iterable[tuple[float, Any]]:
    """LowState messages whose motors ``motors[k]`` are the k-th columns of ``q``, ``v`` and ``tau``."""
    kind = f"unitree_{family}/msg"
    count = {"hg": 35, "go": 20}[family]
    for i, time in enumerate(data["time"]):
        state = [filled(types, f"{kind}/MotorState") for _ in range(count)]
        for k, motor in enumerate(motors):
            state[motor].q, state[motor].dq, state[motor].tau_est = (
                float(data[c][i, k]) for c in ("q", "v", "tau")
            )
        inertial = filled(
            types,
            f"{kind}/IMUState",
            quaternion=np.array([1, 0, 0, 0], dtype=np.float32),
            gyroscope=np.array([0.1, 0.2, 0.3], dtype=np.float32),
            accelerometer=np.array([0.0, 0.5, 9.8], dtype=np.float32),
        )
        yield (
            100.0 + time,
            filled(
                types,
                f"{kind}/LowState",
                tick=5000 + round(1000 * time),
                imu_state=inertial,
                motor_state=state,
                **fields,
            ),
        )


def low_commands(
    types: Any, family: str, data: dict[str, np.ndarray], motors: list[int]
) -> Iterable[tuple[float, Any]]:
    """LowCmd messages: commanded positions ``q_cmd``, gains 60 and 1.5."""
    kind = f"unitree_{family}/msg"
    count = {"hg": 35, "go": 20}[family]
    for i, time in enumerate(data["time"]):
        command = [filled(types, f"{kind}/MotorCmd") for _ in range(count)]
        for k, motor in enumerate(motors):
            command[motor].q, command[motor].kp, command[motor].kd = float(data["q_cmd"][i, k]), 60.0, 1.5
        yield 100.0 + time, filled(types, f"{kind}/LowCmd", motor_cmd=command)


def header(types: Any, seconds: float) -> Any:
    """A header at a time [s]."""
    return stamp(types, seconds)
