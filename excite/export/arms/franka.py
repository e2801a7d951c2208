"""Rows of positions, velocities and accelerations at 1 kHz for arms of Franka."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from excite.atomic import atomic_path
from excite.errors import InputError
from excite.export.arms.franka_limits import LIMITS, franka_violations
from excite.export.exporter import Exporter
from excite.export.setting import Setting
from excite.export.statement import as_comments, motion_remarks, motion_statement
from excite.motion.motion import Motion
from excite.robot.chain import is_serial
from excite.safety.verdict import Violation

RATE_HZ = 1000.0


class FrankaExporter(Exporter):
    """Numbers between spaces: q of the seven joints, then their dq, then their ddq [rad, s], a row a millisecond.

    Lines that start with ``#`` say whose motion it is and name the columns. What libfranka's callback for joint
    positions or velocities returns is a row's first or second seven. Beyond the robot's own limits those of Franka's
    interface are checked on what is written: velocity (of a Franka Research 3 also near the ends of the ranges),
    acceleration and jerk between milliseconds, from and to standing still.
    """

    name = "franka"
    suffix = ".txt"
    summary = "rows of q, dq, ddq at 1 kHz for libfranka, within its own limits"
    rates_hz = (RATE_HZ,)
    settings = (
        Setting("model", "", "whose limits hold; by the joints' names where left out", choices=("", *LIMITS)),
    )

    def refuse(self, motion: Motion) -> None:
        """Raise InputError for robots other than chains of seven, and where nobody says which model it is."""
        robot = self.robot
        if robot.floating or robot.n_joints != 7 or not is_serial(robot):
            raise InputError(
                f"robot {robot.name!r} is no chain of seven joints that turn on a fixed base",
                source=motion.name,
                field=self.name,
                remedy="choose another format",
            )
        if not self._model():
            raise InputError(
                f"joint {robot.joint_names[0]!r} does not say which arm of Franka it is",
                source=motion.name,
                field="model",
                remedy=f"give --set model={' or '.join(LIMITS)}",
            )

    def violations(self, motion: Motion) -> tuple[Violation, ...]:
        """See :class:`Exporter`."""
        return franka_violations(LIMITS[self._model()], motion.joint_positions(), motion.joint_names)

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`; numbers are written with all their digits."""
        names = [f"{prefix}.{joint}" for prefix in "qva" for joint in motion.joint_names]
        rows = np.hstack([motion.joint_positions(), motion.joint_velocities(), motion.joint_accelerations()])
        said = motion_statement(motion) | {"rate_hz": RATE_HZ, "columns": names}
        with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as stream:
            stream.write(as_comments([*motion_remarks(motion), json.dumps(said)]))
            stream.writelines(f"{' '.join(map(repr, row))}\n" for row in rows.tolist())

    def _model(self) -> str:
        """Name of the model in ``LIMITS``, by the setting or the joints' names; empty where neither says."""
        first = self.robot.joint_names[0]
        named = "fr3" if first.startswith("fr3") else "panda" if first.startswith(("panda", "fer_")) else ""
        return self.word("model") or named
