"""ROS 1 bags (``.bag``), and ROS 2 bags (folders, ``.db3``), through rosbags."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

from excite.conversion.recording import Recording
from excite.conversion.sources.messages import MOST_BYTES, is_trajectory, is_wanted
from excite.conversion.sources.source import Source
from excite.conversion.sources.topics import Topics, is_of_torques
from excite.formats.file import first_bytes, is_damage


def _add_messages(topics: Topics, bag: Any, connections: Sequence[Any]) -> None:
    """Messages of some topics whose definition is known; of types that nothing is known of, small ones."""
    unreadable = set()
    for connection, logged, raw in bag.messages(connections=connections) if connections else ():
        kind = connection.msgtype
        known = is_wanted(kind) or is_trajectory(kind)
        if kind in unreadable or not (known or len(raw) <= MOST_BYTES):
            continue
        if kind not in bag.typestore.fielddefs and not (kind == KIND and register_state(bag.typestore, raw)):
            unreadable.add(kind)
            continue
        topics.add(connection.topic, kind, bag.deserialize(raw, kind), 1e-9 * logged)


class BagSource(Source):
    """Topics of joints, wrenches and base poses."""

    name: ClassVar[str] = "bag"
    what: ClassVar[str] = "a bag"
    summary: ClassVar[str] = "ROS 1 bags (.bag) and ROS 2 bags (folders, .db3)"
    own_process: ClassVar[bool] = True

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return path.suffix.lower() in {".bag", ".db3"} or first_bytes(path, 12).startswith(b"#ROSBAG V2.0")

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_HUMBLE)
        register_unitree(store)
        register_interfaces(store)
        topics = Topics()
        notes: tuple[str, ...] = ()
        try:
            bags = AnyReader([path], default_typestore=store)
            if not bags.is2:
                from excite.conversion.sources.ros1_chunks import ChunkReader  # lazy: rosbags

                bags.readers = [ChunkReader(path)]
            with bags as bag:
                there = {c.topic: c.msgtype for c in bag.connections}
                wanted = [c for c in bag.connections if is_wanted(c.msgtype) or is_trajectory(c.msgtype)]
                _add_messages(topics, bag, wanted)
                others = [c for c in bag.connections if c not in wanted]
                if not topics.has_positions:
                    # Nobody's known message says where the joints were: those of any type are looked through.
                    _add_messages(topics, bag, others)
                elif topics.lacks_torques:
                    _add_messages(topics, bag, [c for c in others if is_of_torques(c.topic)])
        except Exception as error:
            if not is_damage(error) or not topics.has_positions:
                raise
            notes = ("its end is damaged: it is read as far as it goes",)
        found = topics.recording(path, there)
        return (replace(found, notes=found.notes + notes),)


# Definitions of control_msgs for bags that do not bring them: the controller's state has had three layouts.

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


# Definitions of Unitree's messages, for bags that do not bring them (``.db3`` without embedded schemas).

_HG = {
    "unitree_hg/msg/IMUState": """
float32[4] quaternion
float32[3] gyroscope
float32[3] accelerometer
float32[3] rpy
int16 temperature
""",
    "unitree_hg/msg/MotorState": """
uint8 mode
float32 q
float32 dq
float32 ddq
float32 tau_est
int16[2] temperature
float32 vol
uint32[2] sensor
uint32 motorstate
uint32[4] reserve
""",
    "unitree_hg/msg/MotorCmd": """
uint8 mode
float32 q
float32 dq
float32 tau
float32 kp
float32 kd
uint32 reserve
""",
    "unitree_hg/msg/LowState": """
uint32[2] version
uint8 mode_pr
uint8 mode_machine
uint32 tick
unitree_hg/IMUState imu_state
unitree_hg/MotorState[35] motor_state
uint8[40] wireless_remote
uint32[4] reserve
uint32 crc
""",
    "unitree_hg/msg/LowCmd": """
uint8 mode_pr
uint8 mode_machine
unitree_hg/MotorCmd[35] motor_cmd
uint32[4] reserve
uint32 crc
""",
}
_GO = {
    "unitree_go/msg/IMUState": """
float32[4] quaternion
float32[3] gyroscope
float32[3] accelerometer
float32[3] rpy
int8 temperature
""",
    "unitree_go/msg/MotorState": """
uint8 mode
float32 q
float32 dq
float32 ddq
float32 tau_est
float32 q_raw
float32 dq_raw
float32 ddq_raw
int8 temperature
uint32 lost
uint32[2] reserve
""",
    "unitree_go/msg/MotorCmd": """
uint8 mode
float32 q
float32 dq
float32 tau
float32 kp
float32 kd
uint32[3] reserve
""",
    "unitree_go/msg/BmsState": """
uint8 version_high
uint8 version_low
uint8 status
uint8 soc
int32 current
uint16 cycle
int8[2] bq_ntc
int8[2] mcu_ntc
uint16[15] cell_vol
""",
    "unitree_go/msg/BmsCmd": """
uint8 off
uint8[3] reserve
""",
    "unitree_go/msg/LowState": """
uint8[2] head
uint8 level_flag
uint8 frame_reserve
uint32[2] sn
uint32[2] version
uint16 bandwidth
unitree_go/IMUState imu_state
unitree_go/MotorState[20] motor_state
unitree_go/BmsState bms_state
int16[4] foot_force
int16[4] foot_force_est
uint32 tick
uint8[40] wireless_remote
uint8 bit_flag
float32 adc_reel
int8 temperature_ntc1
int8 temperature_ntc2
float32 power_v
float32 power_a
uint16[4] fan_frequency
uint32 reserve
uint32 crc
""",
    "unitree_go/msg/LowCmd": """
uint8[2] head
uint8 level_flag
uint8 frame_reserve
uint32[2] sn
uint32[2] version
uint16 bandwidth
unitree_go/MotorCmd[20] motor_cmd
unitree_go/BmsCmd bms_cmd
uint8[40] wireless_remote
uint8[12] led
uint8[2] fan
uint8 gpio
uint32 reserve
uint32 crc
""",
}
DEFINITIONS = {**_HG, **_GO}


def register_unitree(store: Any) -> None:
    """Add Unitree's types to a typestore of rosbags."""
    from rosbags.typesys import get_types_from_msg

    types: dict[str, Any] = {}
    for name, text in DEFINITIONS.items():
        types |= get_types_from_msg(text, name)
    store.register(types)
