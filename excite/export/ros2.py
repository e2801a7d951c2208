"""ROS 2 bags (MCAP) with one ``trajectory_msgs/msg/JointTrajectory``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from excite.atomic import atomic_folder
from excite.export.exporter import Exporter
from excite.motion.motion import Motion

TOPIC = "/joint_trajectory_controller/joint_trajectory"
_MESSAGE = "trajectory_msgs/msg/JointTrajectory"
_BAG_VERSION: Literal[9] = 9  # readable from Humble on


def nanoseconds(time: np.ndarray) -> np.ndarray:
    """Times since the first sample as whole nanoseconds, ``(n,)`` integers, from ``(n,)`` seconds."""
    return np.round((np.asarray(time) - time[0]) * 1e9).astype(np.int64)


class Ros2Exporter(Exporter):
    """A bag folder that ``ros2 bag play`` sends to a joint trajectory controller.

    One message holds the whole motion: ``joint_names`` in the motion's order, and for each sample
    positions, velocities, accelerations [rad or m, s] and ``time_from_start`` in whole nanoseconds.
    The header's stamp is zero, which tells the controller to start at once. A free base is not
    commanded by joints and is left out.
    """

    name = "ros2"
    suffix = ""
    summary = "ROS 2 bag (MCAP) with one trajectory_msgs/msg/JointTrajectory"

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; ``path`` is the bag's folder."""
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_HUMBLE)
        message = store.types[_MESSAGE]
        point = store.types["trajectory_msgs/msg/JointTrajectoryPoint"]
        duration = store.types["builtin_interfaces/msg/Duration"]
        header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](0, 0), "")
        effort = np.empty(0)
        samples = zip(
            nanoseconds(motion.time).tolist(),
            np.ascontiguousarray(motion.joint_positions()),
            np.ascontiguousarray(motion.joint_velocities()),
            np.ascontiguousarray(motion.joint_accelerations()),
            strict=True,
        )
        points = [point(q, v, a, effort, duration(*divmod(t, 1_000_000_000))) for t, q, v, a in samples]
        content = message(header, list(motion.joint_names), points)
        with atomic_folder(path) as temporary:
            bag = Writer(temporary, version=_BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
            with bag:
                connection = bag.add_connection(TOPIC, _MESSAGE, typestore=store)
                bag.write(connection, 0, store.serialize_cdr(content, _MESSAGE))
