"""Messages of ROS and of Unitree as rows of numbers with what they mean, by the table ``message_types.csv``.

A row of the table is one number, or one for each joint: the names of joints stand in the list ``joints`` of the
message, or motors are counted in the list ``joints[]``; ``path`` is where the numbers are, in the first of several
places that has any. The fields are those of the types' definitions (sensor_msgs, control_msgs, geometry_msgs, nav_msgs,
trajectory_msgs, unitree_hg, unitree_go); a decoder of any library that gives them as attributes serves."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache, reduce
from typing import Any, NamedTuple

import numpy as np

from excite.arrays import Array, Indices
from excite.conversion.columns.families import TARGETS
from excite.conversion.columns.vocabulary import SURELY_COMMANDED
from excite.conversion.columns.words import name_tokens
from excite.conversion.recording import Column, Stream
from excite.data_tables import read_rows

# Rows of a recording's topics as they come, in bounded memory however long the recording is.

# Numbers that are kept of all topics together: 112 MB, of which a conversion takes five to six times as much with the
# doctor at its end (0.44 GB for 58 MB, 0.57 GB for 72 MB, 0.17 GB of them for libraries). An hour of a humanoid's 90
# channels at 500 Hz has twelve times as many, and its motion, below 10 Hz, loses nothing in means of sixteen rows.
_MOST_NUMBERS = 14_000_000
_LAYOUTS = 1024


@dataclass(frozen=True)
class Field:
    """One number of a message: its name, and what the message type says of it.

    Attributes:
        name: such as ``position.elbow``.
        channel: the log's channel, empty where the type does not say one.
        label: joint or axis.
    """

    name: str
    channel: str = ""
    label: str = ""


Row = tuple[Sequence[Field], Array | list[float]]


class Room:
    """What the topics of a recording may keep together; the one that keeps most gives way."""

    def __init__(self, most: int = _MOST_NUMBERS) -> None:
        self._most = most
        self.topics: list[Gathered] = []

    def fit(self) -> None:
        """Take means of rows of the largest topics until all fit."""
        while sum(topic.size for topic in self.topics) > self._most:
            if not max(self.topics, key=lambda topic: topic.size).halve():
                return


class Gathered:
    """Collects rows whose columns may differ in order and number from message to message."""

    def __init__(self, name: str, room: Room) -> None:
        self.name = name
        self._room = room
        self._fields: dict[str, Field] = {}
        self._known: dict[tuple[Field, ...], Indices] = {}
        self._last: dict[int, tuple[tuple[Field, ...], Indices]] = {}
        # Rows one after the other, each with its time before its numbers.
        self._numbers = array("d")
        self._every = 1
        self._block: list[Array] = []
        room.topics.append(self)

    def add(self, time: float | Array, fields: Sequence[Field], values: Sequence[float] | Array) -> None:
        """A message at a time [s], or several: times ``(n,)``, values ``(n_fields, n)``."""
        places, times = self._places(fields), np.atleast_1d(time)
        rows = np.full((len(times), 1 + len(self._fields)), np.nan)
        rows[:, 0] = times
        rows[:, places] = np.reshape(values, (len(places), -1)).T
        if self._every == 1:
            self._numbers.frombytes(rows.tobytes())
            self._room.fit()
            return
        for row in rows:
            self._block.append(row)
            if len(self._block) >= self._every:
                alike = [one for one in self._block if len(one) == len(row)]
                self._numbers.frombytes(np.asarray(sum(alike) / len(alike)).tobytes())
                self._block.clear()
                self._room.fit()

    def stream(self, start: float) -> Stream | None:
        """What was gathered, times from ``start``; None for nothing."""
        time, *values = self._rows.T
        pairs = zip(self._fields.values(), values, strict=True)
        columns = tuple(Column(field.name, column, field.channel, field.label) for field, column in pairs)
        return Stream(self.name, columns, time - start) if len(time) else None

    def has_channel(self, channel: str) -> bool:
        """Whether a field of this channel was seen."""
        return any(field.channel == channel for field in self._fields.values())

    @property
    def size(self) -> int:
        """Numbers that are kept."""
        return len(self._numbers)

    @property
    def note(self) -> str:
        """What was left out; empty for nothing."""
        return "" if self._every == 1 else f"{self.name}: rows are means of {self._every}, to fit into memory"

    @property
    def first_s(self) -> float:
        """Time of the first row; infinite for none."""
        return self._numbers[0] if self._numbers else float("inf")

    def halve(self) -> bool:
        """Keep means of two rows in half the room; whether there was anything to halve."""
        rows = self._rows
        pairs = len(rows) // 2
        # The row without a partner stands for as many as it is the mean of.
        self._block[:0] = [row.copy() for row in rows[2 * pairs :]] * self._every
        self._keep(rows[: 2 * pairs].reshape(pairs, 2, -1).mean(axis=1))
        self._every *= 2
        return pairs > 0

    @property
    def _rows(self) -> Array:
        """``(n, 1 + n_fields)``, not copied."""
        return np.asarray(self._numbers).reshape(-1, 1 + len(self._fields))

    def _keep(self, rows: Array) -> None:
        self._numbers = array("d", rows.tobytes())

    def _places(self, fields: Sequence[Field]) -> Indices:
        """Where a row has these fields. Decoders hand the same tuple over again and again, which need not be hashed."""
        known = self._last.get(id(fields))
        if known is not None:
            return known[1]
        key = tuple(fields)
        if key not in self._known:
            rows, before = self._rows, len(self._fields)
            for field in key:
                self._fields.setdefault(field.name, field)
            if new := len(self._fields) - before:
                self._keep(np.pad(rows, ((0, 0), (0, new)), constant_values=np.nan))
            names = list(self._fields)
            self._known[key] = np.array([1 + names.index(field.name) for field in key], dtype=int)
        if fields is key:
            if len(self._last) >= _LAYOUTS:
                self._last.clear()
            # With the tuple, so that no other one comes to its address.
            self._last[id(fields)] = (key, self._known[key])
        return self._known[key]


MOTOR = "motor_"
TRAJECTORY = "trajectory_msgs/JointTrajectory"
# A message of more bytes is no state of joints; longer lists are images, clouds and scans.
MOST_BYTES = 20_000
_MOST_NUMBERS, _DEEPEST = 100, 4
_DYNAMIC = "control_msgs/DynamicJointState"
_NAMES = ("name", "names", "joint_name", "joint_names")
_LEFT_OUT = {"header", "stamp", "covariance", "crc", "reserve"}


class _Part(NamedTuple):
    """A row of the table for one type."""

    joints: str
    field: str
    channel: str
    label: str
    paths: tuple[tuple[str, ...], ...]


@cache
def _types() -> dict[str, list[_Part]]:
    found: dict[str, list[_Part]] = {_DYNAMIC: []}
    for row in read_rows(__file__, "message_types.csv"):
        paths = tuple(tuple(path.split(".")) for path in row["path"].split())
        part = _Part(row["joints"], row["field"], row["channel"], row["label"], paths)
        for kind in row["type"].split():
            found.setdefault(kind, []).append(part)
    return found


def is_wanted(kind: str) -> bool:
    """Whether a message type is read; names with or without ``/msg/``."""
    return kind.replace("/msg/", "/") in _types()


def is_of_rows(kind: str) -> bool:
    """Whether messages of a type are a row of numbers each, so that several may be read together."""
    return is_wanted(kind) and not is_trajectory(kind) and kind.replace("/msg/", "/") != _DYNAMIC


def is_trajectory(kind: str) -> bool:
    """Whether a message type holds a whole motion."""
    return kind.replace("/msg/", "/") == TRAJECTORY


def decode(kind: str, message: Any, topic: str, names: Iterable[str] = ()) -> Row:
    """Fields and numbers of a message, or of several ``(n_fields, n)``; ``names`` of joints that stand elsewhere.

    Arrays over joints that are empty, as efforts may be, are left out.
    """
    kind = kind.replace("/msg/", "/")
    if kind == _DYNAMIC:
        return _decode_interfaces(message)
    parts: list[int] = []
    numbers: list[Any] = []
    names = tuple(names)
    for k, part in enumerate(_types()[kind]):
        if part.joints.endswith("[]"):
            motors = getattr(message, part.joints[:-2])
            names = names or tuple(f"{MOTOR}{number}" for number in range(len(motors)))
            values: Any = [getattr(motor, part.paths[0][0]) for motor in motors]
        else:
            names = names or tuple(getattr(message, part.joints, ()) if part.joints else ())
            values = next(
                (value for path in part.paths if (value := _follow(message, path)) is not None), None
            )
            if not part.joints:
                values = [values]
        if values is not None and (not part.joints or len(values) == len(names)):
            parts.append(k)
            numbers.extend(values)
    sensor = _topic_word(topic) or getattr(getattr(message, "header", None), "frame_id", "") or "wrench"
    return _layout(kind, names, tuple(parts), str(sensor), _is_of_commands(topic)), np.array(
        numbers, dtype=float
    )


def _follow(message: Any, path: tuple[str, ...]) -> Any:
    """What stands at a path; None for nothing, and for an empty list."""
    step = lambda value, word: value[int(word)] if word.isdigit() else getattr(value, word, None)  # noqa: E731
    found = reduce(step, path, message)
    return None if found is None or (np.ndim(found) and not len(found)) else found


@cache
def _topic_word(topic: str) -> str:
    words = [word for word in topic.split("/") if word and word not in {"wrench", "data", "raw", "filtered"}]
    return "".join(words[-1:])


@cache
def _is_of_commands(topic: str) -> bool:
    """Whether a topic is called after what was asked for: ``/joint_commands`` has the type of ``/joint_states``."""
    return not SURELY_COMMANDED.isdisjoint(name_tokens(_topic_word(topic)))


# Layouts of some topics; orders of joints may differ from message to message.
@lru_cache(maxsize=1024)
def _layout(
    kind: str, names: tuple[str, ...], parts: tuple[int, ...], sensor: str, commanded: bool
) -> tuple[Field, ...]:
    """Fields of a message: the same object for the same ones, as making them takes longer than decoding."""
    found: list[Field] = []
    for part in (_types()[kind][k] for k in parts):
        if part.joints:
            asked = commanded and (part.channel, False) in TARGETS
            channel = TARGETS.get((part.channel, True), "skip") if asked else part.channel
            found += [Field(f"{part.field}.{name}", channel, name) for name in names]
        else:
            named = (text.replace("SENSOR", sensor) for text in (part.field, part.label))
            found.append(Field(next(named), part.channel, next(named)))
    return tuple(found)


def _decode_interfaces(message: Any) -> Row:
    """Values of each joint by the names of its interfaces, as ros2_control's broadcaster has them."""
    channels = {"position": "q", "velocity": "v", "effort": "tau"}
    fields: list[Field] = []
    numbers: list[float] = []
    for joint, values in zip(message.joint_names, message.interface_values, strict=False):
        for name, value in zip(values.interface_names, values.values, strict=False):
            fields.append(Field(f"{name}.{joint}", channels.get(name, ""), joint if name in channels else ""))
            numbers.append(float(value))
    return fields, numbers


def stamp_s(message: Any) -> Array:
    """Times that headers state [s]; not a number for none, or for one that was left at zero."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    seconds = np.asarray(np.nan if stamp is None else _seconds(stamp), dtype=float)
    return np.where(seconds == 0.0, np.nan, seconds)


def _seconds(stamp: Any) -> Any:
    return getattr(stamp, "sec", getattr(stamp, "secs", 0)) + 1e-9 * getattr(
        stamp, "nanosec", getattr(stamp, "nsecs", 0)
    )


def trajectory_rows(message: Any) -> Iterable[tuple[float, Row]]:
    """Times and rows of a JointTrajectory: a whole motion in one message."""
    for point in message.points:
        yield float(_seconds(point.time_from_start)), decode(TRAJECTORY, point, "", message.joint_names)


def decode_any(message: Any) -> Row:
    """Fields and numbers of a message of a type that nothing is known of, by its own definition.

    Every number is called by the path of its field; lists of numbers that are as long as a list of names beside them
    are called after the names.
    """
    fields: list[Field] = []
    numbers: list[float] = []

    def collect(path: str, value: Any, names: list[str], depth: int) -> None:
        if isinstance(value, bool | int | float | np.number):
            fields.append(Field(path))
            numbers.append(float(value))
        elif isinstance(value, np.ndarray | list | tuple):
            if 0 < len(value) <= _MOST_NUMBERS:
                for k, one in enumerate(value):
                    place = f".{names[k]}" if len(names) == len(value) else f"[{k}]"
                    collect(path + place, one, [], depth + 1)
        elif not isinstance(value, str | bytes | None) and depth <= _DEEPEST:
            members = _members(value)
            words = (members.get(name) for name in _NAMES)
            lists = (list(one) for one in words if isinstance(one, list | tuple) and one)
            named = next((one for one in lists if all(isinstance(word, str) for word in one)), [])
            for name, inner in members.items():
                if name not in _LEFT_OUT and not name.startswith("__"):
                    collect(f"{path}.{name}" if path else name, inner, named, depth + 1)

    collect("", message, [], 0)
    return fields, numbers


def _members(message: Any) -> dict[str, Any]:
    if isinstance(message, Mapping):
        return dict(message)
    names = getattr(message, "__dataclass_fields__", None) or getattr(message, "__slots__", ())
    return {str(name): getattr(message, name) for name in (names or ()) if not str(name).startswith("_")}
