"""What every controller format has in common."""

from __future__ import annotations

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.atomic import is_written
from excite.errors import InputError
from excite.formats.number import check_number, shorten_value
from excite.motion.motion import Motion
from excite.motion.readers.tables import UNSAFE
from excite.robot.prismatic import is_serial
from excite.robot.robot import Robot
from excite.safety.verdict import Violation, conditions

# What can be said of a controller format beside the motion: gains, names, orders.


@dataclass(frozen=True)
class Setting:
    """A setting of a format, declared once for command line, validation and help.

    Attributes:
        name: after ``excite export --set``.
        default: used where nothing is said; its type is the setting's.
        summary: one line for help texts.
        low: smallest number.
        high: largest number.
        unit: of numbers.
        choices: words that it may be; empty for any.
        example: a value to try, of a setting that has to be given since nothing is right for every machine.
    """

    name: str
    default: float | str
    summary: str
    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    choices: tuple[str, ...] = ()
    example: str = ""

    def read(self, value: object, source: str) -> float | str:
        """The value, a number or its text; raises InputError that names the setting."""
        if isinstance(self.default, str):
            text = str(value).strip()
            if self.choices and text not in self.choices:
                remedy = f"choose one of {', '.join(self.choices)}"
                raise InputError(f"is {shorten_value(text)}", source=source, field=self.name, remedy=remedy)
            if not text.isprintable():
                raise InputError(
                    f"is {shorten_value(text)}", source=source, field=self.name, remedy="write it in one line"
                )
            return text
        number = value
        if isinstance(value, str):
            try:
                number = float(value)
            except ValueError:
                number = value[:40]
        return check_number(number, self.name, self.low, self.high, self.unit, source=source)


def settle_settings(
    declared: Iterable[Setting], given: Mapping[str, object], source: str
) -> dict[str, float | str]:
    """Values of all declared settings; raises InputError for one that is not declared or not allowed.

    Args:
        given: by name, numbers or texts.
        source: name of the format, for errors.
    """
    known = {setting.name: setting for setting in declared}
    for name in given:
        if name not in known:
            remedy = f"choose one of {', '.join(known)}" if known else "leave it out: the format has none"
            raise InputError("is no setting", source=source, field=str(name)[:60], remedy=remedy)
    return {
        name: setting.read(given[name], source) if name in given else setting.default
        for name, setting in known.items()
    }


class Exporter(ABC):
    """Writes motions of one robot, each as one file (or one folder) that a controller reads.

    Attributes:
        name: name in ``EXPORTERS`` and after ``excite export --format``.
        suffix: what the file's name ends with; empty for a folder.
        summary: one line for help texts.
        settings: what can be said of the format beside the motion.
        rates_hz: rates that the controller runs at, the usual one first; empty where it takes any.
        usual_hz: rate where none is asked for; None for the motion's own samples.
        chain: of how many joints that turn, in a chain on a fixed base, the robot has to be; None for any robot.
        whole: whether joints that no motor drives are written, too, as a simulator needs them.
        robot: the robot whose motions are written.
        values: values of the settings.

    Args:
        robot: the robot.
        given: settings by name, others have their defaults.

    Raises:
        InputError: no such setting, or not such a value.
    """

    name: ClassVar[str]
    suffix: ClassVar[str]
    summary: ClassVar[str]
    settings: ClassVar[tuple[Setting, ...]] = ()
    rates_hz: ClassVar[tuple[float, ...]] = ()
    usual_hz: ClassVar[float | None] = None
    whole: ClassVar[bool] = False
    chain: ClassVar[int | None] = None

    def __init__(self, robot: Robot, given: Mapping[str, object] | None = None) -> None:
        self.robot = robot
        self.values = settle_settings(self.settings, given or {}, self.name)

    def number(self, name: str) -> float:
        """Value of a setting that is a number."""
        return float(self.values[name])

    def word(self, name: str) -> str:
        """Value of a setting that is a word."""
        return str(self.values[name])

    def rate(self, motion: Motion, asked_hz: float | None) -> float | None:
        """Rate of the file [Hz], None for the motion's own samples; raises InputError for one that is never run."""
        if asked_hz is None:
            return self.rates_hz[0] if self.rates_hz else self.usual_hz
        if self.rates_hz and asked_hz not in self.rates_hz:
            known = " or ".join(f"{rate:g}" for rate in self.rates_hz)
            raise InputError(
                f"is {asked_hz:g} Hz, and the controller runs at {known} Hz",
                source=self.name,
                field="rate_hz",
                remedy=f"give {known}, or leave it out",
            )
        return asked_hz

    def refuse(self, motion: Motion) -> None:
        """Raise InputError in one line where no controller of this format runs motions of the robot."""
        robot = self.robot
        if self.chain and (robot.floating or robot.n_joints != self.chain or not is_serial(robot)):
            raise InputError(
                f"robot {robot.name!r} is no chain of {self.chain} joints that turn on a fixed base",
                source=motion.name,
                field=self.name,
                remedy="choose another format",
            )

    def violations(self, motion: Motion) -> tuple[Violation, ...]:
        """What the controller would refuse of a motion as it is written, beyond the robot's own limits."""
        return ()

    def joint_order(self, names: Sequence[str], field: str, *, blank: str | None = None) -> list[int]:
        """For each of some joints its place among those that a setting names, between commas.

        Args:
            field: name of the setting.
            blank: what stands for a place that no joint has; None where all have to have one.

        Raises:
            InputError: a joint is missing or stands twice, or a name is none of them.
        """
        stated = [name.strip() for name in self.word(field).split(",")]
        wrong = [name for name in names if stated.count(name) != 1]
        wrong += [name for name in stated if name not in names and name != blank]
        if wrong:
            raise InputError(
                f"names not each joint of robot {self.robot.name!r} once: {wrong[0][:40]!r}",
                source=self.name,
                field=field,
                remedy="name them all, in their order",
            )
        return [stated.index(name) for name in names]

    def destination(self, path: Path) -> Path:
        """Where a motion is written that shall be called ``path``: with the format's suffix."""
        return (
            path if not self.suffix or path.suffix == self.suffix else path.with_name(path.name + self.suffix)
        )

    @abstractmethod
    def write(self, motion: Motion, path: Path) -> None:
        """Write ``motion``, every sample of it, to ``path``, which appears only when it is complete.

        Args:
            motion: the motion, already on the grid that the controller wants.
            path: the file or folder to write; an older one is replaced.
        """

    def mistake_in(self, method: str, result: object, *given: Any) -> str:
        """What is wrong with what a derived class's method returns; empty for nothing."""
        left = [
            path for path in given if isinstance(path, Path) and method == "write" and not is_written(path)
        ]
        return f"leaves no file {left[0]}" if left else ""


# What a ROS 2 joint trajectory controller takes for one goal.

SINGLE = float(np.finfo(np.float32).eps)
"""Epsilon of single precision: what is slower [rad/s or m/s] is at rest. ros2_controllers takes a velocity for
zero up to it, and since Jazzy refuses goals that end with another one (allow_nonzero_velocity_at_trajectory_end)."""


def goal_velocities(motion: Motion) -> Array:
    """Velocities of the joints, ``(n, n_joints)``; the last are zero where no other motion goes on from there.

    The check has found that the motion ends at rest, up to half a percent of each velocity limit; a controller would
    refuse the whole for less than that.
    """
    velocities = motion.joint_velocities().copy()
    rests = not motion.metadata.following and (motion.metadata.verdict or {}).get("safe")
    if rests and np.abs(velocities[-1]).max() > SINGLE:
        velocities[-1] = 0.0
    return velocities


def between_rests(motion: Motion) -> list[Motion]:
    """Parts of a motion between instants at which all joints stand still, each from and to rest; both own the instant.

    Each begins at its own time, so that the parts in order, and the times between them, are the motion.
    """
    still = np.abs(motion.joint_velocities()).max(axis=1) <= SINGLE
    # The first sample of each time at rest; whoever waits there, waits in the next part.
    cuts = np.flatnonzero(still[1:-1] & ~still[:-2]) + 1
    edges = [0, *cuts.tolist(), motion.n_samples - 1]
    return [motion_rows(motion, slice(i, j + 1)) for i, j in pairwise(edges)]


def motion_rows(motion: Motion, rows: slice | NDArray[np.intp]) -> Motion:
    """Some samples of a motion."""
    return replace(
        motion,
        time=motion.time[rows],
        q=motion.q[rows],
        v=motion.v[rows],
        a=motion.a[rows],
        contacts={name: flags[rows] for name, flags in motion.contacts.items()},
    )


def join_motions(motion: Motion, parts: Sequence[Motion]) -> Motion:
    """The samples of several parts one after another, as a motion that is otherwise as ``motion``."""
    return replace(
        motion,
        time=np.concatenate([part.time for part in parts]),
        q=np.vstack([part.q for part in parts]),
        v=np.vstack([part.v for part in parts]),
        a=np.vstack([part.a for part in parts]),
        contacts={name: np.concatenate([part.contacts[name] for part in parts]) for name in motion.contacts},
    )


# What a file says of itself: whose motion it is, and what the independent check said of it.


def motion_statement(motion: Motion) -> dict[str, Any]:
    """``robot``, ``robot_hash``, ``joints`` in their order and ``verdict`` of a motion that was cleared."""
    metadata = motion.metadata
    return {
        "robot": motion.robot,
        "robot_hash": metadata.robot_hash,
        "joints": list(motion.joint_names),
        "verdict": metadata.verdict,
    }


def motion_warnings(motion: Motion) -> list[str]:
    """What whoever opens the file has to know, one line each; nothing of a motion that is safe."""
    verdict = motion.metadata.verdict or {}
    if "unsafe_anyway" not in verdict:
        return []
    said = [str(Violation(**item)) for item in verdict["violations"]]
    lines = [f"written all the same, {verdict['unsafe_anyway']}", *said]
    return [f"{UNSAFE}: {' '.join(line.split())}" for line in lines]


def motion_remarks(motion: Motion) -> list[str]:
    """Lines for a person who opens the file: warnings, whose motion it is, and the smallest margins."""
    verdict = motion.metadata.verdict or {}
    lines = [
        *motion_warnings(motion),
        f"motion {motion.name} of robot {motion.robot}, {motion.duration:.3f} s",
    ]
    if verdict.get("safe"):
        margins = {name: value for name, value in verdict["margins"].items() if value is not None}
        stated = ", ".join(f"{name} {value:.4g}" for name, value in margins.items())
        held = conditions(verdict.get("as_far_as", ()))
        lines.append(f"found safe by the independent check{held}; smallest margins: {stated}")
    return [" ".join(line.split()) for line in lines]


def comment_lines(motion: Motion, **more: Any) -> str:
    """Comment lines for a text file: the remarks, and the statement and more as a line of JSON that is read again."""
    return as_comments([*motion_remarks(motion), json.dumps(motion_statement(motion) | more)])


def write_statement(motion: Motion, file: Path, **more: Any) -> None:
    """Write what a folder of files has no place for beside them, as JSON: statement, more, and remarks."""
    said = motion_statement(motion) | more | {"remarks": motion_remarks(motion)}
    file.write_text(json.dumps(said, ensure_ascii=False, indent=2) + "\n", encoding="utf-8")


def as_comments(lines: Iterable[str]) -> str:
    """Lines as comments."""
    return "".join(f"# {line}\n" for line in lines)
