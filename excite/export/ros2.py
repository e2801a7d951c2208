"""ROS 2 bags (MCAP) with one ``trajectory_msgs/msg/JointTrajectory``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

import numpy as np

from excite.atomic import atomic_folder
from excite.export.exporter import Exporter
from excite.export.goals import goal_velocities
from excite.motion.motion import Motion
from excite.motion.readers.ros2 import BASE_TRAJECTORY, CONTACTS, JOINT_TRAJECTORY, ROBOT, ROBOT_HASH
from excite.motion.timing import to_nanoseconds

TOPIC = "/joint_trajectory_controller/joint_trajectory"
BASE_TOPIC = "/excite/base"
JOINT_STATE = "sensor_msgs/msg/JointState"
_BAG_VERSION: Literal[9] = 9  # readable from Humble on


class Ros2Exporter(Exporter):
    """A bag folder that ``ros2 bag play`` sends to a joint trajectory controller.

    One message holds the whole motion: ``joint_names`` in the motion's order, and for each sample
    positions, velocities, accelerations [rad or m, s] and ``time_from_start`` in whole nanoseconds.
    The header's stamp is zero, which tells the controller to start at once. A free base and its feet, which no
    controller of joints asks for, stand in messages on topics of their own, so that the bag can be checked. The bag's
    custom data say whose motion it is and what the independent check said of it.
    """

    name = "ros2"
    suffix = ""
    summary = "ROS 2 bag (MCAP) with one trajectory_msgs/msg/JointTrajectory"

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; ``path`` is the bag's folder."""
        with atomic_folder(path) as temporary:
            write_bag(motion, temporary)


def write_bag(motion: Motion, folder: Path, command: str = "") -> None:
    """Write a motion as a bag folder that is not yet there.

    Args:
        motion: the motion.
        folder: of the bag; the MCAP file in it has its name.
        command: topic of a ``sensor_msgs/msg/JointState`` for every sample at its time; none where empty.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = [(TOPIC, JOINT_TRAJECTORY, [_joint_trajectory(store, motion)])]
    if motion.floating:
        messages.append((BASE_TOPIC, BASE_TRAJECTORY, [_base_trajectory(store, motion)]))
    if motion.contacts:
        messages.append((CONTACTS, JOINT_TRAJECTORY, [_contact_flags(store, motion)]))
    if command:
        messages.append((command, JOINT_STATE, _joint_states(store, motion)))
    bag = Writer(folder, version=_BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
    bag.set_custom_data(ROBOT, motion.robot)
    bag.set_custom_data(ROBOT_HASH, motion.metadata.robot_hash)
    if motion.metadata.verdict is not None:
        bag.set_custom_data("excite.verdict", json.dumps(motion.metadata.verdict))
    times = to_nanoseconds(motion.time).tolist()
    with bag:
        for topic, kind, contents in messages:
            connection = bag.add_connection(topic, kind, typestore=store)
            for time, content in zip(times, contents, strict=False):
                bag.write(connection, time, store.serialize_cdr(content, kind))


def _message_times(store: Any, motion: Motion) -> list[Any]:
    duration = store.types["builtin_interfaces/msg/Duration"]
    return [duration(*divmod(t, 1_000_000_000)) for t in to_nanoseconds(motion.time).tolist()]


def _message_header(store: Any, frame: str = "") -> Any:
    return store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](0, 0), frame)


def _joint_trajectory(store: Any, motion: Motion) -> Any:
    point, nothing = store.types["trajectory_msgs/msg/JointTrajectoryPoint"], np.empty(0)
    rows = zip(
        np.ascontiguousarray(motion.joint_positions()),
        np.ascontiguousarray(goal_velocities(motion)),
        np.ascontiguousarray(motion.joint_accelerations()),
        _message_times(store, motion),
        strict=True,
    )
    points = [point(q, v, a, nothing, t) for q, v, a, t in rows]
    return store.types[JOINT_TRAJECTORY](_message_header(store), list(motion.joint_names), points)


def _joint_states(store: Any, motion: Motion) -> list[Any]:
    state, stamp = store.types[JOINT_STATE], store.types["builtin_interfaces/msg/Time"]
    header, names = store.types["std_msgs/msg/Header"], list(motion.joint_names)
    return [
        state(header(stamp(*divmod(t, 1_000_000_000)), ""), names, q, v, np.empty(0))
        for t, q, v in zip(
            to_nanoseconds(motion.time).tolist(),
            np.ascontiguousarray(motion.joint_positions()),
            np.ascontiguousarray(motion.joint_velocities()),
            strict=True,
        )
    ]


def _base_trajectory(store: Any, motion: Motion) -> Any:
    """Pose in the world; twist and acceleration in the base frame, as everywhere in a motion."""
    vector, quaternion = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Quaternion"]
    pose, twist = store.types["geometry_msgs/msg/Transform"], store.types["geometry_msgs/msg/Twist"]
    point = store.types["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"]
    points = [
        point(
            [pose(vector(*q[:3]), quaternion(*q[3:]))],
            [twist(vector(*v[:3]), vector(*v[3:]))],
            [twist(vector(*a[:3]), vector(*a[3:]))],
            t,
        )
        for q, v, a, t in zip(
            motion.q[:, :7].tolist(),
            motion.v[:, :6].tolist(),
            motion.a[:, :6].tolist(),
            _message_times(store, motion),
            strict=True,
        )
    ]
    return store.types[BASE_TRAJECTORY](_message_header(store, "world"), ["base"], points)


def _contact_flags(store: Any, motion: Motion) -> Any:
    point, nothing = store.types["trajectory_msgs/msg/JointTrajectoryPoint"], np.empty(0)
    flags = np.column_stack(list(motion.contacts.values())).astype(float)
    points = [
        point(np.ascontiguousarray(row), nothing, nothing, nothing, t)
        for row, t in zip(flags, _message_times(store, motion), strict=True)
    ]
    return store.types[JOINT_TRAJECTORY](_message_header(store), list(motion.contacts), points)
