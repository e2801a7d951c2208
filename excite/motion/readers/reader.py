"""What every reader of motions offers: named columns of numbers, and what the file says of itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from numpy.typing import NDArray

from excite.formats.documents import parse_json

# An hour of a humanoid at 1 kHz has 3.6e6 samples of 117 columns, 3.4 GB; motions here last minutes.
MAX_FILE_BYTES = 1024 * 1024 * 1024


# Remarks at the top may hold a verdict of some hundred violations, above what tells the format [bytes].
BEGINNING = 1 << 18


@dataclass(frozen=True, eq=False)
class RawMotion:
    """A motion as it stands in a file.

    Attributes:
        columns: ``(n,)`` each, by the names of ``excite.motion/1``; more may be there.
        metadata: what the file says of itself; empty for files that were made elsewhere.
        goal: whether rows are setpoints, through which a controller runs a curve of its own.
    """

    columns: Mapping[str, NDArray[Any]]
    metadata: Mapping[str, Any] = field(default_factory=dict)
    goal: bool = False


class MotionReader(ABC):
    """A format of motions.

    Attributes:
        name: name in ``READERS``.
        summary: one line for help texts.
    """

    name: ClassVar[str]
    summary: ClassVar[str]

    @abstractmethod
    def recognises(self, path: Path) -> bool:
        """Whether a file (or folder) looks like this format, by its name and its first bytes; never raises."""

    @abstractmethod
    def read(self, path: Path, joints: Sequence[str]) -> RawMotion:
        """Read a motion.

        Args:
            path: of the file or folder.
            joints: names of the robot's joints, for formats that name their columns as they like.

        What a library raises of a damaged file becomes one line where this is called.
        """


# What a text file says of itself in comments at its top.

# Longest line of comments that is read: a verdict with some hundred violations has 30 kB.
_LONGEST_LINE = 1 << 20


def stated_in_comments(path: Path) -> dict[str, Any]:
    """The first comment that is a JSON object; empty where none is.

    Args:
        path: a text file, of which only the comments at its top are read.
    """
    with path.open("rb") as stream:
        while (line := stream.readline(_LONGEST_LINE)).startswith(b"#"):
            text = line[1:].decode().strip()
            if text.startswith("{"):
                return dict(parse_json(text))
    return {}


def of_robot(said: Mapping[str, Any]) -> dict[str, Any]:
    """What a file says of its robot and its curve, under the names of ``excite.motion/1``."""
    return {name: said[name] for name in ("robot", "robot_hash", "curve", "blend_s") if name in said}


def named_joints(said: Mapping[str, Any], joints: Sequence[str]) -> tuple[str, ...]:
    """The joints that a file names; those of the robot where it names none."""
    names = said.get("joints")
    if isinstance(names, list) and all(isinstance(name, str) for name in names):
        return tuple(names)
    return tuple(joints)


def joint_columns(
    time: NDArray[Any], joints: Sequence[str], **channels: NDArray[Any]
) -> dict[str, NDArray[Any]]:
    """Columns ``time``, ``q.JOINT``, ``v.JOINT`` … of matrices ``(n, n_joints)`` by channel."""
    columns = {"time": time}
    for channel, values in channels.items():
        columns |= {f"{channel}.{joint}": values[:, i] for i, joint in enumerate(joints)}
    return columns
