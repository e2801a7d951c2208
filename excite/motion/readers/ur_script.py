"""Programs in URScript that servo through samples."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.errors import MotionError
from excite.motion.readers.reader import MAX_FILE_BYTES, MotionReader, RawMotion
from excite.motion.readers.remarks import named_joints, of_robot, stated_in_comments
from excite.reading.file import read_text

# servoj of a posture, and its time; those that stand in a loop are not samples of a motion.
_SERVO = re.compile(r"^  servoj\(\[([^\]]*)\],[^,]*,[^,]*, *([0-9.eE+-]+),", re.MULTILINE)


class UrScriptReader(MotionReader):
    """Postures of ``servoj`` in the function's first level, each for its time; the joints in the arm's order."""

    name: ClassVar[str] = "ur-script"
    summary: ClassVar[str] = "URScript program with a servoj a sample"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return path.suffix == ".script"

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        said = stated_in_comments(path)
        found = _SERVO.findall(read_text(path, limit=MAX_FILE_BYTES, error=MotionError))
        try:
            q = np.array([[float(value) for value in row.split(",")] for row, _ in found])
            steps = np.array([float(step) for _, step in found])
        except ValueError as error:
            raise MotionError(
                "holds a servoj that is not of numbers", source=path, remedy="export it again"
            ) from error
        names = named_joints(said, joints)
        if not found or q.ndim != 2 or (names and q.shape[1] != len(names)):
            raise MotionError(
                f"holds no servoj of {len(names)} joints a line", source=path, remedy="export it again"
            )
        time = np.concatenate([[0.0], np.cumsum(steps[:-1])])
        return RawMotion(
            {"time": time, **{f"q.{joint}": q[:, i] for i, joint in enumerate(names)}}, of_robot(said)
        )
