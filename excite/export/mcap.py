"""A single MCAP file with the motion as a joint trajectory, and as a stream of joint states."""

from __future__ import annotations

import re
from pathlib import Path

from excite.atomic import atomic_path
from excite.errors import InputError
from excite.export.exporter import Exporter
from excite.export.ros2 import write_bag
from excite.export.setting import Setting
from excite.motion.motion import Motion
from excite.reading.number import shorten_value

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
