"""Sequences of Unitree's LowCmd that export wrote."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.errors import MotionError
from excite.motion.readers.reader import DAMAGED, MotionReader, RawMotion, unreadable
from excite.motion.readers.remarks import of_robot
from excite.reading.file import check_file, first_bytes
from excite.reading.json_document import parse_json

HEADER = "excite"
"""Key of the first line, which says whose motion it is and which joint each motor drives."""

# A minute of 30 motors at 500 Hz: 100 MB, of which every line becomes objects in turn.
_MOST_BYTES = 512 * 1024 * 1024


class UnitreeReader(MotionReader):
    """Positions and velocities of the motors' commands, under the names of the joints that they drive."""

    name: ClassVar[str] = "unitree"
    summary: ClassVar[str] = "Unitree LowCmd sequence that export wrote"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return path.suffix == ".jsonl" and first_bytes(path).startswith(f'{{"{HEADER}": '.encode())

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        check_file(path, limit=_MOST_BYTES, error=MotionError)
        rows: list[list[float]] = []
        try:
            with path.open(encoding="utf-8") as stream:
                said = parse_json(stream.readline())[HEADER]
                motors = {int(place): str(joint) for place, joint in said["motors"].items()}
                rows = [_command_row(json.loads(line), motors) for line in stream]
        except (KeyError, TypeError, AttributeError, *DAMAGED) as error:
            raise unreadable(path, error) from error
        values, names = np.array(rows, ndmin=2), [motors[place] for place in sorted(motors)]
        if not rows:
            raise MotionError("holds no commands", source=path, remedy="export it again")
        n = len(names)
        columns = {"time": values[:, 0]}
        columns |= {f"q.{joint}": values[:, 1 + i] for i, joint in enumerate(names)}
        columns |= {f"v.{joint}": values[:, 1 + n + i] for i, joint in enumerate(names)}
        return RawMotion(columns, of_robot(said))


def _command_row(line: dict[str, Any], motors: dict[int, str]) -> list[float]:
    """Time, then positions, then velocities of all motors in their order."""
    commands = {int(command["index"]): command for command in line["motor_cmd"]}
    if set(commands) != set(motors):
        raise ValueError(f"at {line['t']} s other motors are commanded than the first line names")
    order = sorted(motors)
    return [float(line["t"]), *(float(commands[k][field]) for field in ("q", "dq") for k in order)]
