"""ROS 2 bags (MCAP) with one ``trajectory_msgs/msg/JointTrajectory``."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import Any, Literal

import numpy as np

from excite.arrays import Array
from excite.atomic import atomic_folder, atomic_path, write_text
from excite.errors import InputError
from excite.export.exporter import Exporter, Setting, between_rests, comment_lines, goal_velocities
from excite.formats.number import shorten_value
from excite.motion.motion import Motion
from excite.motion.readers.ros2 import (
    BASE_TRAJECTORY,
    CONTACTS,
    GOAL_FILE,
    JOINT_TRAJECTORY,
    ROBOT,
    ROBOT_HASH,
)

TOPIC = "/joint_trajectory_controller/joint_trajectory"
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
        folder: of the bag; the MCAP file in it has its name.
        command: topic of a ``sensor_msgs/msg/JointState`` for every sample at its time; none where empty.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    joints = motion.joint_positions(), goal_velocities(motion), motion.joint_accelerations()
    messages = [(TOPIC, JOINT_TRAJECTORY, [_trajectory_arrays(store, motion, motion.joint_names, *joints)])]
    if motion.floating:
        # Pose in the world; twist and acceleration in the base frame, as everywhere in a motion.
        vector, quaternion, pose, twist = (
            store.types[f"geometry_msgs/msg/{name}"]
            for name in ("Vector3", "Quaternion", "Transform", "Twist")
        )
        point = store.types["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"]
        rows = zip(motion.q[:, :7].tolist(), motion.v[:, :6].tolist(), motion.a[:, :6].tolist(), strict=True)
        points = [
            point(
                [pose(vector(*q[:3]), quaternion(*q[3:]))],
                *([twist(vector(*rates[:3]), vector(*rates[3:]))] for rates in (v, a)),
                time,
            )
            for (q, v, a), time in zip(rows, _message_times(store, motion), strict=True)
        ]
        messages.append(
            (
                "/excite/base",
                BASE_TRAJECTORY,
                [store.types[BASE_TRAJECTORY](_message_header(store, "world"), ["base"], points)],
            )
        )
    if motion.contacts:
        flags = np.column_stack(list(motion.contacts.values())).astype(float)
        messages.append(
            (CONTACTS, JOINT_TRAJECTORY, [_trajectory_arrays(store, motion, list(motion.contacts), flags)])
        )
    if command:
        state, names = store.types[JOINT_STATE], list(motion.joint_names)
        stamps = _message_times(store, motion, "builtin_interfaces/msg/Time")
        values = map(np.ascontiguousarray, (motion.joint_positions(), motion.joint_velocities()))
        messages.append(
            (
                command,
                JOINT_STATE,
                [
                    state(_message_header(store, stamp=stamp), names, q, v, np.empty(0))
                    for stamp, q, v in zip(stamps, *values, strict=True)
                ],
            )
        )
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


def to_nanoseconds(time: np.ndarray) -> np.ndarray:
    """Times since the first sample as whole nanoseconds, ``(n,)`` integers, from ``(n,)`` seconds."""
    return np.asarray(np.round((np.asarray(time) - time[0]) * 1e9).astype(np.int64))


def _message_times(store: Any, motion: Motion, kind: str = "builtin_interfaces/msg/Duration") -> list[Any]:
    return [store.types[kind](*divmod(t, 1_000_000_000)) for t in to_nanoseconds(motion.time).tolist()]


def _message_header(store: Any, frame: str = "", stamp: Any = None) -> Any:
    at_once = store.types["builtin_interfaces/msg/Time"](0, 0)
    return store.types["std_msgs/msg/Header"](stamp or at_once, frame)


def _trajectory_arrays(store: Any, motion: Motion, names: Sequence[str], *values: Array) -> Any:
    """Positions, velocities and accelerations ``(n, n_names)``, as many of them as there are."""
    point, nothing = store.types["trajectory_msgs/msg/JointTrajectoryPoint"], np.empty(0)
    rows = zip(*map(np.ascontiguousarray, values), _message_times(store, motion), strict=True)
    missing = [nothing] * (4 - len(values))
    points = [point(*row, *missing, time) for *row, time in rows]
    return store.types[JOINT_TRAJECTORY](_message_header(store), list(names), points)


# A single MCAP file with the motion as a joint trajectory, and as a stream of joint states.

_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")


class McapExporter(Exporter):
    """What the format ``ros2`` holds, without the bag's folder, and ``sensor_msgs/msg/JointState`` a sample.

    The states are stamped with the motion's times from zero; positions and velocities, no efforts. Played, they drive
    whatever takes joint states for commands, and show in viewers. The file's metadata say whose motion it is and what
    the independent check said of it.
    """

    name = "mcap"
    suffix = ".mcap"
    summary = "MCAP file with a JointTrajectory and a JointState a sample (ROS 2)"
    settings = (Setting("topic", "/joint_command", "topic of the joint states"),)

    def refuse(self, motion: Motion) -> None:
        """Raise InputError where the topic is none."""
        topic = self.word("topic")
        if not _TOPIC.fullmatch(topic):
            raise InputError(
                f"is {shorten_value(topic)}",
                source=self.name,
                field="topic",
                remedy="give letters, digits and _ behind a /",
            )

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`."""
        with atomic_path(path) as temporary:
            bag = temporary.with_name("bag")
            write_bag(motion, bag, self.word("topic"))
            (bag / "bag.mcap").rename(temporary)


# Goals of ROS 2's action FollowJointTrajectory as YAML.

ACTION = "control_msgs/action/FollowJointTrajectory"
# Linux hands a program at most 32 pages in one argument, MAX_ARG_STRLEN in execve(2), its final zero included.
_LONGEST_ARGUMENT = 131_071


class Ros2YamlExporter(Exporter):
    """A ``control_msgs/action/FollowJointTrajectory`` goal: the field ``trajectory``, nothing else.

    Each point has positions, velocities, accelerations [rad or m, s] in the order of ``joint_names`` and
    ``time_from_start`` in whole seconds and nanoseconds. The command that sends it stands in a comment at the top. A
    free base has no place in it. As ``segments`` between rests it is a folder of such goals, numbered in their order:
    each starts and ends where the joints stand still, for a controller stops at the end of a goal.
    """

    name = "ros2-yaml"
    suffix = ".yaml"
    summary = "goal of ROS 2's FollowJointTrajectory action in YAML"
    settings = (
        Setting("controller", "joint_trajectory_controller", "name of the controller, or its whole action"),
        Setting("segments", "one", "one goal, or one for each way between rests", choices=("one", "rests")),
    )

    def refuse(self, motion: Motion) -> None:
        """Raise InputError where the controller's name is none."""
        action_name(self.word("controller"))

    def destination(self, path: Path) -> Path:
        """A file, or the folder of several goals."""
        if self._several:
            return path.with_name(path.name.removesuffix(self.suffix))
        return super().destination(path)

    @property
    def _several(self) -> bool:
        return self.word("segments") == "rests"

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        if not self._several:
            write_text(path, self._text(motion, path.name))
            return
        with atomic_folder(path) as folder:
            folder.mkdir()
            for number, part in enumerate(between_rests(motion)):
                file = GOAL_FILE.format(number)
                start = float(part.time[0] - motion.time[0])
                text = self._text(part, f"{path.name}/{file}", start_s=start)
                (folder / file).write_text(text, encoding="utf-8")

    def _text(self, motion: Motion, name: str, **more: float) -> str:
        """Command, comments and goal."""
        lines, text, file = comment_lines(motion, **more), _goal_text(motion), quote(name)
        command = f"# ros2 action send_goal {action_name(self.word('controller'))} {ACTION} "
        goal = f'"$(cat {file})"'
        if len((command + goal + lines + text).encode()) > _LONGEST_ARGUMENT:
            goal = f"--stdin < {file}   # as an argument it is too long; --stdin is there from Jazzy on"
        return f"{command}{goal}\n{lines}{text}"


def action_name(controller: str) -> str:
    """Name of a controller's action; raises InputError for what is no name in ROS."""
    words = controller.strip("/").split("/")
    if not all(word and word.replace("_", "a").isalnum() and word.isascii() for word in words):
        raise InputError(
            f"is {shorten_value(controller)}",
            source="ros2-yaml",
            field="controller",
            remedy="give letters, digits and _, parts joined by /",
        )
    name = "/" + "/".join(words)
    return name if words[-1] == "follow_joint_trajectory" else f"{name}/follow_joint_trajectory"


def _goal_text(motion: Motion) -> str:
    names = ", ".join(json.dumps(joint) for joint in motion.joint_names)
    lines = ["trajectory:", f"  joint_names: [{names}]", "  points:"]
    rows = zip(
        motion.joint_positions().tolist(),
        goal_velocities(motion).tolist(),
        motion.joint_accelerations().tolist(),
        to_nanoseconds(motion.time).tolist(),
        strict=True,
    )
    for q, v, a, time in rows:
        seconds, rest = divmod(time, 1_000_000_000)
        lines.append(
            "  - "
            f"{{positions: {_format_numbers(q)}, velocities: {_format_numbers(v)}, accelerations: {_format_numbers(a)},"
            f" time_from_start: {{sec: {seconds}, nanosec: {rest}}}}}"
        )
    return "\n".join([*lines, ""])


def _format_numbers(values: list[float]) -> str:
    """All digits; YAML 1.1, which ROS reads, takes 1e-05 for a word and 1.0e-05 for a number."""
    words = (
        word.replace("e", ".0e") if "e" in word and "." not in word else word for word in map(repr, values)
    )
    return f"[{', '.join(words)}]"
