"""A recording as its file has it: named columns on time bases of their own, before anybody says what they mean."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, Flags, Indices
from excite.errors import NothingThereError, RobotError
from excite.formats.documents import MAX_XML_BYTES
from excite.formats.file import read_text
from excite.robot.load import load_robot
from excite.robot.loading import portable_description
from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot
from excite.robot.urdf.reading import parse_urdf, urdf_model

# How recordings call their rate and their step, letters only.
_RATES = frozenset(
    "fps fs rate ratehz hz frequency freq samplingrate samplerate samplingfrequency samplefrequency frequencyhz "
    "samplingratehz sampleratehz fshz".split()
)
_RATE_OF = re.compile(
    r"(action|control|ctrl|policy|log|logging|record|recording|data|state|loop|update)s?(hz|rate|freq|frequency)"
)
NAMELESS = "the file names no columns: they are called column1, column2 … here"
_STEPS = frozenset(
    "dt ts step timestep sampletime samplingtime deltat period tsample dts sampleperiod dtms tsms stepdt controldt "
    "ctrldt policydt envdt logdt".split()
)


@dataclass(frozen=True, eq=False)
class Column:
    """One column.

    Attributes:
        name: as the file calls it.
        values: ``(n,)``, not a number where a row has none.
        channel: what it holds (``q``, ``tau`` …) where the format itself says so; empty where it has to be guessed.
        label: the joint or sensor that the format, or a list of names in the file, names beside it; empty for none.
        unit: as the format states it; empty for none.
    """

    name: str
    values: Array
    channel: str = ""
    label: str = ""
    unit: str = ""


@dataclass(frozen=True, eq=False)
class Stream:
    """Columns that were recorded together.

    Attributes:
        name: of the topic, table or group.
        columns: in the file's order.
        time: ``(n,)`` [s] where the format says when rows were recorded; None where a column may say it.
        words: ``(n,)`` texts of columns that hold no numbers, by their names; those that a table has.
    """

    name: str
    columns: tuple[Column, ...]
    time: Array | None = None
    words: Mapping[str, NDArray[np.object_]] = field(default_factory=dict)

    @property
    def n_rows(self) -> int:
        """Rows of the stream."""
        return len(self.columns[0].values) if self.columns else 0

    def rows(self, chosen: slice | Flags | Indices) -> Stream:
        """Some of the rows, or all in another order: of numbers, texts and times alike."""
        return replace(
            self,
            columns=tuple(replace(column, values=column.values[chosen]) for column in self.columns),
            words={name: cells[chosen] for name, cells in self.words.items()},
            time=None if self.time is None else self.time[chosen],
        )


@dataclass(frozen=True, eq=False)
class Recording:
    """What was recorded without interruption.

    Attributes:
        source: the file.
        name: short name, used for the trial.
        streams: what it holds.
        said: numbers that hold for the whole of it, by name (``kp``, ``fps`` …).
        notes: what its reader found worth saying, a sentence each.
    """

    source: str
    name: str
    streams: tuple[Stream, ...]
    said: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[Column, ...]:
        """Those of all streams."""
        return tuple(column for stream in self.streams for column in stream.columns)


def stated_rate(said: Mapping[str, Any]) -> float | None:
    """Rows a second [Hz] that a recording states as a rate or as the time between rows; None for none."""
    for name, value in said.items():
        word = re.sub(r"[^a-z]", "", name.rpartition("/")[2].lower())
        number = value if isinstance(value, int | float) and not isinstance(value, bool) else 0.0
        if not np.isfinite(number) or number <= 0.0:
            continue
        if (word in _RATES or _RATE_OF.fullmatch(word)) and number >= 1.0:
            return float(number)
        if word in _STEPS:
            # Nobody records a row a second or slower: such steps are in milliseconds.
            return 1.0 / number if number < 1.0 else 1e3 / number
    return None


def merged_names(recording: Recording) -> Recording:
    """The recording with every column's name unique: that of its stream before it where two streams share one."""
    names = [column.name for column in recording.columns]
    twice = {name for name in names if names.count(name) > 1} if len(set(names)) < len(names) else set()
    streams = []
    for stream in recording.streams:
        columns = tuple(
            replace(c, name=f"{stream.name}/{c.name}") if c.name in twice else c for c in stream.columns
        )
        streams.append(replace(stream, columns=columns))
    return replace(recording, streams=tuple(streams))


def nothing_there(path: object) -> NothingThereError:
    """The error for a source that holds no numbers over time."""
    return NothingThereError(
        "holds no columns of numbers", source=path, remedy="give a recording with one row a sample"
    )


# What of a robot helps to understand a recording: its joints in order, their ranges, the text of its model.

# Joints of the simplest leg: hip and knee.
_LEG = 2


@dataclass(frozen=True, eq=False)
class Machine:
    """A robot as a recording sees it.

    Attributes:
        name: of the robot.
        joints: names of the joints that move by themselves, in the model's order.
        lower: ``(n,)`` [rad or m], ``upper`` too; infinite where the model states none.
        speed: ``(n,)`` largest speeds [rad/s or m/s]; nan where the model states none.
        torque: ``(n,)`` largest torques [N·m or N]; infinite where none is stated.
        slides: ``(n,)`` whether a joint slides instead of turning.
        floating: whether the base is free.
        base_link: the root link.
        gravity: ``(3,)`` in the world frame [m/s²].
        text: of the URDF, or of a robot.yaml where a URDF does not say all of it.
        robot: the robot with its limits, None for a bare URDF whose base is fixed.
    """

    name: str
    joints: tuple[str, ...]
    lower: Array
    upper: Array
    speed: Array
    torque: Array
    slides: Array
    floating: bool
    base_link: str
    gravity: tuple[float, float, float]
    text: str
    robot: Robot | None

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def file(self) -> str:
        """Name of the model's file in a log."""
        return "robot.urdf" if self.robot is None or self.robot.mechanism is None else "robot.yaml"

    @property
    def motors(self) -> frozenset[str]:
        """Motors of transmissions, which move joints together."""
        blocks = () if self.robot is None else self.robot.description.transmissions
        return frozenset(motor.name for block in blocks for motor in block.motors)


def load_machine(name_or_path: str | Path) -> Machine:
    """A bundled robot, a ``robot.yaml``, or a bare URDF, xacro or MuJoCo model; raises RobotError."""
    path = Path(name_or_path)
    if path.suffix == ".urdf":
        return _of_urdf(path)
    robot = load_robot(name_or_path)
    return _of_robot(robot, robot.driven_names)


def at_joints(machine: Machine) -> Machine:
    """The machine as a recording has it that speaks of joints where transmissions have motors."""
    robot = machine.robot
    if robot is None:
        return machine
    there = {
        motor.name: joint
        for block in robot.description.transmissions
        for motor, joint in zip(block.motors, block.joints, strict=True)
    }
    return _of_robot(robot, tuple(there.get(name, name) for name in machine.joints))


def _of_robot(robot: Robot, joints: tuple[str, ...]) -> Machine:
    places = [robot.joint_index(name) for name in joints]
    gravity = np.asarray(robot.model.gravity.linear, dtype=float)
    return Machine(
        name=robot.name,
        joints=joints,
        lower=np.asarray(robot.limits.position_lower, dtype=float)[places],
        upper=np.asarray(robot.limits.position_upper, dtype=float)[places],
        speed=_stated(np.asarray(robot.limits.velocity, dtype=float)[places]),
        torque=np.asarray(robot.limits.torque, dtype=float)[places],
        slides=np.array([is_prismatic(robot.model, robot.n_base_v + place) for place in places]),
        floating=robot.floating,
        base_link=robot.base_link,
        gravity=(float(gravity[0]), float(gravity[1]), float(gravity[2])),
        text=robot.urdf if robot.mechanism is None else portable_description(robot),
        robot=robot,
    )


def _stated(speeds: Array) -> Array:
    """Limits of speed, nan for those that are none."""
    return np.where(np.isfinite(speeds) & (speeds > 0.0), speeds, np.nan)


def _of_urdf(path: Path) -> Machine:
    root = parse_urdf(path)
    model = urdf_model(root, path)
    followers = {joint.get("name") for joint in root.findall("joint") if joint.find("mimic") is not None}
    names = tuple(name for name in tuple(model.names)[1:] if name not in followers)
    children = {joint.find("child").get("link") for joint in root.findall("joint")}  # type: ignore[union-attr]
    links = [link.get("name", "") for link in root.findall("link")]
    moved = [model.joints[model.getJointId(name)] for name in names]
    order = [joint.idx_v for joint in moved]
    # What turns on and on has the two numbers of a direction for a position, and no range.
    ends = np.array([joint.nq == 1 for joint in moved])

    def limits(values: Array, missing: float, places: list[int] = order) -> Array:
        found = np.asarray(values, dtype=float)[places]
        return np.where(np.isfinite(found) & (np.abs(found) < 1e10), found, missing)

    at = [joint.idx_q for joint in moved]
    lower = limits(model.lowerPositionLimit, -np.inf, at)
    upper = limits(model.upperPositionLimit, np.inf, at)
    # A joint that is logged moves: a range without width is one that nobody has filled in.
    ends &= lower < upper
    effort = limits(model.effortLimit, np.inf)
    standing = _standing_robot(path, model)
    return Machine(
        name=model.name or path.stem,
        joints=names,
        lower=np.where(ends, lower, -np.inf),
        upper=np.where(ends, upper, np.inf),
        speed=_stated(limits(model.velocityLimit, np.nan)),
        torque=np.where(effort > 0.0, effort, np.inf),
        slides=np.array([is_prismatic(model, place) for place in order]),
        floating=standing is not None,
        base_link=next((link for link in links if link not in children), ""),
        gravity=(0.0, 0.0, -9.81),
        text=read_text(path, limit=MAX_XML_BYTES),
        robot=standing,
    )


def _standing_robot(path: Path, model: pin.Model) -> Robot | None:
    """The robot of a bare URDF whose base is free, as the first description has it of a model that has limbs."""
    limbs = ((len(model.subtrees[child]) >= _LEG for child in children) for children in model.children)
    if all(sum(several) < 2 for several in limbs):
        return None
    try:
        robot = load_robot(path)
    except RobotError:
        return None
    return robot if robot.floating and robot.mechanism is None else None


def live_columns(recording: Recording) -> frozenset[str]:
    """Names of the columns whose numbers are not the same in every row."""
    return frozenset(
        column.name
        for column in recording.columns
        if len(np.unique(column.values[np.isfinite(column.values)])) > 1
    )
