"""Programs in URScript for arms of Universal Robots."""

from __future__ import annotations

import math
import re
from pathlib import Path

from excite.atomic import atomic_path
from excite.errors import InputError
from excite.export.exporter import Exporter
from excite.export.setting import Setting
from excite.export.statement import comment_lines, motion_remarks
from excite.motion.motion import Motion
from excite.robot.chain import is_serial

# What fits a window of the teach pendant.
_LONGEST_POPUP = 200


class UrScriptExporter(Exporter):
    """A program that asks the operator, moves to the start, servos through every sample, and stops.

    ``movej`` takes the arm from wherever it stands to the first sample, slowly; that way is the controller's own and no
    check has seen it, hence the question before it. Then one ``servoj`` a sample, each for one period: the controller
    smooths the setpoints over ``lookahead`` and pulls the arm along with ``gain``, so the arm follows the motion a
    little late. The last posture is held for ``settle``, then ``stopj`` ends it. At a speed slider below 100 % each
    ``servoj`` takes longer than its period: another, slower motion.

    Ranges of lookahead and gain are those of Universal Robots' script manual (servoj). An e-Series or UR-Series
    controller runs at 500 Hz, a CB3 one at 125 Hz.
    """

    name = "ur-script"
    suffix = ".script"
    summary = "URScript program for an arm of Universal Robots: movej to the start, servoj, stopj"
    rates_hz = (500.0, 125.0)
    exact = False
    settings = (
        Setting("lookahead", 0.1, "smoothing of the setpoints", 0.03, 0.2, "s"),
        Setting("gain", 300.0, "proportional gain of the servo", 100.0, 2000.0),
        # A quarter of what movej does where nothing is said, 1.05 rad/s and 1.4 rad/s²: a hand reaches the stop.
        Setting("approach_speed", 0.25, "speed of the way to the start", 0.01, 1.05, "rad/s"),
        Setting("approach_acceleration", 0.35, "acceleration of the way to the start", 0.01, 1.4, "rad/s²"),
        Setting("settle", 0.5, "how long the last posture is held", 0.0, 10.0, "s"),
        Setting("stop", 2.0, "deceleration of the last stop", 0.1, 10.0, "rad/s²"),
        Setting(
            "confirm", "yes", "whether the operator is asked before the arm moves", choices=("yes", "no")
        ),
    )

    def refuse(self, motion: Motion) -> None:
        """Raise InputError for robots other than chains of six revolute joints on a fixed base."""
        robot = self.robot
        if robot.floating or robot.n_joints != 6 or not is_serial(robot):
            kind = "a free base and " if robot.floating else ""
            raise InputError(
                f"robot {robot.name!r} has {kind}{robot.n_joints} joints, and URScript moves a chain of six that turn",
                source=motion.name,
                field=self.name,
                remedy="choose another format",
            )

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        with atomic_path(path) as temporary:
            temporary.write_text(comment_lines(motion) + self._program(motion), encoding="utf-8")

    def _program(self, motion: Motion) -> str:
        rate = (motion.n_samples - 1) / motion.duration
        servo = f"0, 0, {1.0 / rate:.6g}, {self.number('lookahead'):g}, {self.number('gain'):g})"
        # URScript has no exponents; 1e-12 rad at 500 Hz are 1e-6 rad/s² of acceleration.
        rows = [f"[{', '.join(f'{x + 0.0:.12f}' for x in row)}]" for row in motion.joint_positions().tolist()]
        speed, acceleration = self.number("approach_speed"), self.number("approach_acceleration")
        lines = [f"def {function_name(motion.name)}():"]
        if self.word("confirm") == "yes":
            lines.append(f'  popup("{_first_remark(motion)}", "excite", False, False, True)')
        lines.append(f"  movej({rows[0]}, a={acceleration:g}, v={speed:g})")
        lines += [f"  servoj({row}, {servo}" for row in rows]
        lines += [
            "  held = 0",
            f"  while held < {math.ceil(self.number('settle') * rate)}:",
            f"    servoj({rows[-1]}, {servo}",
            "    held = held + 1",
            "  end",
            f"  stopj({self.number('stop'):g})",
            "end",
        ]
        return "\n".join([*lines, ""])


def function_name(name: str) -> str:
    """A motion's name as URScript allows it: letters of ASCII, digits and underscores."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return word if word[:1].isalpha() else f"motion_{word}"


def _first_remark(motion: Motion) -> str:
    """The first remark, which is the warning of a motion that is not safe, and the question."""
    first = motion_remarks(motion)[0].replace('"', "'").replace("\\", "/")
    return f"{first[:_LONGEST_POPUP]}. Is the way to its start free?"
