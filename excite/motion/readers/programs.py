"""Motions in programs of controllers: OpenHRP patterns, Unitree commands, URScript, MuJoCo keyframes."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.errors import MotionError
from excite.formats.documents import parse_json, read_json, read_xml
from excite.formats.file import check_file, first_bytes, read_text
from excite.motion.readers.reader import (
    BEGINNING,
    MAX_FILE_BYTES,
    MotionReader,
    RawMotion,
    joint_columns,
    named_joints,
    of_robot,
    stated_in_comments,
)

# Pattern files of OpenHRP: the joints' positions of ``.pos``.

STATEMENT = "excite.json"
"""What a folder of patterns says of itself, where export wrote it."""


class OpenHrpReader(MotionReader):
    """A ``.pos`` file, or a folder with one: a time, then the joints as ``excite.json`` or the robot has them."""

    name: ClassVar[str] = "openhrp"
    summary: ClassVar[str] = "OpenHRP/Choreonoid pattern .pos"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return path.suffix == ".pos" or (path / STATEMENT).is_file()

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        files = sorted(path.glob("*.pos")) if path.is_dir() else [path]
        if len(files) != 1:
            raise MotionError(f"holds {len(files)} patterns .pos", source=path, remedy="name one of them")
        (file,) = files
        check_file(file, limit=MAX_FILE_BYTES)
        said: Mapping[str, Any] = {}
        if (file.parent / STATEMENT).is_file():
            said = read_json(file.parent / STATEMENT)
        rows = np.loadtxt(file, ndmin=2)
        names = named_joints(said, joints)
        if names and rows.shape[1] != 1 + len(names):
            raise MotionError(
                f"has {rows.shape[1] - 1} joints, not {len(names)}", source=file, remedy="check the robot"
            )
        return RawMotion(joint_columns(rows[:, 0], names, q=rows[:, 1:]), of_robot(said))


# Keyframes of MuJoCo that say which joints they are of.

KEYFRAMES_STATEMENT = "excite"
"""How the name of the custom text begins that says whose motion the keys are."""


class KeyframesReader(MotionReader):
    """Files of keys that export writes: the joints and their addresses stand in a custom text."""

    name: ClassVar[str] = "mujoco-keyframes"
    summary: ClassVar[str] = "MuJoCo keyframes that export wrote"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        if path.suffix != ".xml":
            return False
        start = first_bytes(path, BEGINNING)
        return f'<custom><text name="{KEYFRAMES_STATEMENT}.'.encode() in start

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        root = read_xml(path)
        said = parse_json(root.find("custom/text").get("data", ""))  # type: ignore[union-attr]
        keys = root.findall("keyframe/key")
        # Each attribute of every key, (n, width).
        time, qpos, qvel = (
            np.array([[float(value) for value in key.get(field, "").split()] for key in keys], ndmin=2)
            for field in ("time", "qpos", "qvel")
        )
        q = qpos[:, [int(k) for k in said["qpos"]]] - np.array(said["zero"], dtype=float)
        v = qvel[:, [int(k) for k in said["qvel"]]]
        return RawMotion(joint_columns(time[:, 0], said["joints"], q=q, v=v), of_robot(said))


# Sequences of Unitree's LowCmd that export wrote.

HEADER = "excite"
"""Key of the first line, which says whose motion it is and which joint each motor drives."""


class UnitreeReader(MotionReader):
    """Positions and velocities of the motors' commands, under the names of the joints that they drive."""

    name: ClassVar[str] = "unitree"
    summary: ClassVar[str] = "Unitree LowCmd sequence that export wrote"

    def recognises(self, path: Path) -> bool:
        """See :class:`MotionReader`."""
        return path.suffix == ".jsonl" and first_bytes(path).startswith(f'{{"{HEADER}": '.encode())

    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """See :class:`MotionReader`."""
        rows: list[list[float]] = []
        with path.open(encoding="utf-8") as stream:
            said = parse_json(stream.readline())[HEADER]
            motors = {int(place): str(joint) for place, joint in said["motors"].items()}
            rows = [_command_row(json.loads(line), motors) for line in stream]
        values, names = np.array(rows, ndmin=2), [motors[place] for place in sorted(motors)]
        if not rows:
            raise MotionError("holds no commands", source=path, remedy="export it again")
        q, v = np.split(values[:, 1:], 2, axis=1)
        return RawMotion(joint_columns(values[:, 0], names, q=q, v=v), of_robot(said))


def _command_row(line: dict[str, Any], motors: dict[int, str]) -> list[float]:
    """Time, then positions, then velocities of all motors in their order."""
    commands = {int(command["index"]): command for command in line["motor_cmd"]}
    if set(commands) != set(motors):
        raise ValueError(f"at {line['t']} s other motors are commanded than the first line names")
    order = sorted(motors)
    return [float(line["t"]), *(float(commands[k][field]) for field in ("q", "dq") for k in order)]


# Programs in URScript that servo through samples.

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
        found = _SERVO.findall(read_text(path, limit=MAX_FILE_BYTES))
        q = np.array([[float(value) for value in row.split(",")] for row, _ in found])
        steps = np.array([float(step) for _, step in found])
        names = named_joints(said, joints)
        if not found or q.ndim != 2 or (names and q.shape[1] != len(names)):
            raise MotionError(
                f"holds no servoj of {len(names)} joints a line", source=path, remedy="export it again"
            )
        time = np.concatenate([[0.0], np.cumsum(steps[:-1])])
        return RawMotion(joint_columns(time, names, q=q), of_robot(said))
