"""Goals of ROS 2's action FollowJointTrajectory as YAML."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from shlex import quote

from excite.atomic import atomic_folder, atomic_path
from excite.errors import InputError
from excite.export.exporter import Exporter
from excite.export.goals import between_rests, goal_velocities
from excite.export.setting import Setting
from excite.export.statement import as_comments, motion_remarks, motion_statement
from excite.motion.motion import Motion
from excite.motion.readers.ros2_yaml import GOAL_FILE
from excite.motion.timing import to_nanoseconds
from excite.reading.number import shorten_value

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
    holds_base = False

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
            with atomic_path(path) as temporary:
                temporary.write_text(self._text(motion, path.name), encoding="utf-8")
            return
        with atomic_folder(path) as folder:
            folder.mkdir()
            for number, part in enumerate(between_rests(motion)):
                file = GOAL_FILE.format(number)
                start = float(part.time[0] - motion.time[0])
                text = self._text(part, f"{path.name}/{file}", {"start_s": start})
                (folder / file).write_text(text, encoding="utf-8")

    def _text(self, motion: Motion, name: str, more: Mapping[str, float] | None = None) -> str:
        """Command, comments and goal."""
        lines = as_comments(
            [*motion_remarks(motion), json.dumps(motion_statement(motion) | dict(more or {}))]
        )
        text, file = _goal_text(motion), quote(name)
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
            f"  - {{positions: {_format_numbers(q)}, velocities: {_format_numbers(v)}, accelerations: {_format_numbers(a)},"
            f" time_from_start: {{sec: {seconds}, nanosec: {rest}}}}}"
        )
    return "\n".join([*lines, ""])


def _format_numbers(values: list[float]) -> str:
    return f"[{', '.join(map(_format_number, values))}]"


def _format_number(value: float) -> str:
    """All digits of a number; YAML 1.1, which ROS reads, takes 1e-05 for a word and 1.0e-05 for a number."""
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
