"""Goals of ROS 2's action FollowJointTrajectory as YAML."""

from __future__ import annotations

import json
from pathlib import Path
from shlex import quote

from excite.atomic import atomic_path
from excite.errors import InputError
from excite.export.exporter import Exporter
from excite.export.setting import Setting
from excite.export.statement import comments
from excite.motion.motion import Motion
from excite.motion.timing import nanoseconds
from excite.reading.number import shown

ACTION = "control_msgs/action/FollowJointTrajectory"
# Linux hands a program at most 32 pages in one argument, MAX_ARG_STRLEN in execve(2), its final zero included.
_LONGEST_ARGUMENT = 131_071


class Ros2YamlExporter(Exporter):
    """A ``control_msgs/action/FollowJointTrajectory`` goal: the field ``trajectory``, nothing else.

    Each point has positions, velocities, accelerations [rad or m, s] in the order of ``joint_names`` and
    ``time_from_start`` in whole seconds and nanoseconds. The command that sends it stands in a comment at the top. A
    free base has no place in it.
    """

    name = "ros2-yaml"
    suffix = ".yaml"
    summary = "goal of ROS 2's FollowJointTrajectory action in YAML"
    settings = (
        Setting("controller", "joint_trajectory_controller", "name of the controller, or its whole action"),
    )
    holds_base = False

    def refuse(self, motion: Motion) -> None:
        """Raise InputError where the controller's name is none."""
        action(self.word("controller"))

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        text = _goal(motion)
        lines = comments(motion)
        file = quote(path.name)
        goal = f'"$(cat {file})"'
        command = f"# ros2 action send_goal {action(self.word('controller'))} {ACTION} "
        if len((command + goal + lines + text).encode()) > _LONGEST_ARGUMENT:
            goal = f"--stdin < {file}   # as an argument it is too long; --stdin is there from Jazzy on"
        with atomic_path(path) as temporary:
            temporary.write_text(f"{command}{goal}\n{lines}{text}", encoding="utf-8")


def action(controller: str) -> str:
    """Name of a controller's action; raises InputError for what is no name in ROS."""
    words = controller.strip("/").split("/")
    if not all(word and word.replace("_", "a").isalnum() and word.isascii() for word in words):
        raise InputError(
            f"is {shown(controller)}",
            source="ros2-yaml",
            field="controller",
            remedy="give letters, digits and _, parts joined by /",
        )
    name = "/" + "/".join(words)
    return name if words[-1] == "follow_joint_trajectory" else f"{name}/follow_joint_trajectory"


def _goal(motion: Motion) -> str:
    names = ", ".join(json.dumps(joint) for joint in motion.joint_names)
    lines = ["trajectory:", f"  joint_names: [{names}]", "  points:"]
    rows = zip(
        motion.joint_positions().tolist(),
        motion.joint_velocities().tolist(),
        motion.joint_accelerations().tolist(),
        nanoseconds(motion.time).tolist(),
        strict=True,
    )
    for q, v, a, time in rows:
        seconds, rest = divmod(time, 1_000_000_000)
        lines.append(
            f"  - {{positions: {_numbers(q)}, velocities: {_numbers(v)}, accelerations: {_numbers(a)},"
            f" time_from_start: {{sec: {seconds}, nanosec: {rest}}}}}"
        )
    return "\n".join([*lines, ""])


def _numbers(values: list[float]) -> str:
    return f"[{', '.join(map(_number, values))}]"


def _number(value: float) -> str:
    """All digits of a number; YAML 1.1, which ROS reads, takes 1e-05 for a word and 1.0e-05 for a number."""
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
