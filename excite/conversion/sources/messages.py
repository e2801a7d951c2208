"""Messages of ROS and of Unitree as rows of numbers with what they mean: one function a type.

The fields are those of the types' definitions (sensor_msgs, control_msgs, geometry_msgs, nav_msgs, trajectory_msgs,
unitree_hg, unitree_go); a decoder of any library that gives them as attributes serves."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from excite.arrays import Array
from excite.conversion.recording import Column, Stream
from excite.conversion.sources.ros import Field, Row
from excite.formats.unitree import H1, QUADRUPED, WHEELED

# Unitree's LowState and LowCmd: numbered motors, of which a machine has some, and the robot's own clock.

# Motors behind linkages of unitree_hg, which stand as motors A and B where mode_pr is 1: ankles, and the G1's waist.
_LINKED = (4, 5, 10, 11)
_WAIST, _WITH_WAIST = (13, 14), 29
# Ticks are milliseconds; a clock that runs off by more is another one.
_TICK_S, _SAME_PACE = 1e-3, 0.02
# Messages that were written this much after the robot's own clock stood in a queue [s].
_LATE_S = 2e-3
_MOTOR = "motor_"
_OF_ROBOT = (
    Field("tick", "skip"),
    Field("mode_pr", "skip"),
    *(Field(f"imu_state.{axis}", "imu", axis) for axis in ("gx", "gy", "gz", "ax", "ay", "az")),
)


@dataclass(frozen=True, eq=False)
class Doubt:
    """Columns that do not hold what their place says.

    Attributes:
        columns: their names.
        what: what they hold.
        line: of ``map.yaml``, that would settle it.
    """

    columns: tuple[str, ...]
    what: str
    line: str


def motors(channels: Mapping[str, str], attribute: str, others: Callable[[Any], Row]) -> Callable[..., Row]:
    """A decoder of one message: fields of its motors by ``channels``, and what ``others`` takes of it."""

    @cache
    def layout(count: int, more: tuple[Field, ...]) -> tuple[Field, ...]:
        labels = [f"{_MOTOR}{k}" for k in range(count)]
        return (
            *(Field(f"{word}.{k}", channel, k) for word, channel in channels.items() for k in labels),
            *more,
        )

    def decoder(message: Any, topic: str) -> Row:
        """Columns and numbers of a message."""
        found = getattr(message, attribute)
        more, numbers = others(message)
        values = [float(getattr(m, word)) for word in channels for m in found]
        return layout(len(found), tuple(more)), values + numbers

    return decoder


def state_of_robot(message: Any) -> Row:
    """Tick, mode and IMU of a LowState."""
    gyro, acceleration = message.imu_state.gyroscope, message.imu_state.accelerometer
    numbers = [message.tick, getattr(message, "mode_pr", 0), *gyro, *acceleration]
    return _OF_ROBOT, [float(number) for number in numbers]


def nothing_else(message: Any) -> Row:
    """A LowCmd has nothing but its motors."""
    return (), []


LOW_STATE = motors({"q": "q", "dq": "v", "tau_est": "tau"}, "motor_state", state_of_robot)
LOW_COMMAND = motors({"q": "q_cmd", "tau": "tau_cmd", "kp": "skip", "kd": "skip"}, "motor_cmd", nothing_else)


def is_unitree(kind: str) -> bool:
    """Whether a message type is one of these."""
    return kind.startswith(("unitree_hg/", "unitree_go/"))


class Finished(NamedTuple):
    """Streams of this family under their joints' names.

    Attributes:
        streams: of the motors that the machine has.
        said: ``gains`` by label, ``doubts``, and whether ``linkages`` stand as their ``motors`` or as ``joints``.
        notes: what was done, in words.
    """

    streams: list[Stream]
    said: dict[str, Any]
    notes: list[str]


def finished(
    streams: Sequence[tuple[str, Stream]],
) -> Finished:
    """Streams with the motors that the machine has, under their joints' names, at the robot's own times.

    Args:
        streams: message type and stream of each topic of this family.
    """
    states = [stream for kind, stream in streams if kind.endswith("LowState")]
    alive = _alive(states or [stream for _, stream in streams])
    legged = streams[0][0].startswith("unitree_go/")
    names = _names(alive) if legged else {}
    said: dict[str, Any] = {}
    notes: list[str] = []
    done = []
    for _, stream in streams:
        gains = _gains(stream, alive, names)
        said |= {"gains": gains} if gains else {}
        timed, note = _at_its_ticks(stream)
        notes += [note] if note else []
        doubt = _linked(stream, alive)
        said |= {"doubts": [doubt]} if doubt else {}
        said |= {} if legged else {"linkages": "motors" if doubt or "doubts" in said else "joints"}
        done.append(_named(timed, alive, names))
    return Finished(done, said, notes)


def _number(column: Column) -> int | None:
    return int(column.label.removeprefix(_MOTOR)) if column.label.startswith(_MOTOR) else None


def _alive(streams: Sequence[Stream]) -> set[int]:
    """Motors of which any number was ever other than zero."""
    return {
        number
        for stream in streams
        for column in stream.columns
        if (number := _number(column)) is not None and np.nan_to_num(column.values).any()
    }


def _names(alive: set[int]) -> dict[int, str]:
    highest = max(alive, default=0)
    order = next((names for names in (QUADRUPED, WHEELED) if highest < len(names)), H1)
    return {k: f"{order[k] or 'unused'}_joint" for k in alive if k < len(order)}


def _named(stream: Stream, alive: set[int], names: Mapping[int, str]) -> Stream:
    columns = []
    # Models leave out what a machine does not have, and count on.
    place = {number: k for k, number in enumerate(sorted(alive))}
    for column in stream.columns:
        number = _number(column)
        if number is None:
            columns.append(column)
        elif number in alive:
            word, name = column.name.partition(".")[0], names.get(number, column.label)
            label = names.get(number, f"{_MOTOR}{place[number]}")
            columns.append(replace(column, name=f"{word}.{name}", label=label))
    return replace(stream, columns=tuple(columns))


def _gains(stream: Stream, alive: set[int], names: Mapping[int, str]) -> dict[str, dict[str, float]]:
    """Gains that stay what they are from the first command to the last."""
    found: dict[str, dict[str, float]] = {}
    for column in stream.columns:
        word, number = column.name.partition(".")[0], _number(column)
        if word in ("kp", "kd") and number in alive and np.ptp(column.values) == 0.0:
            found.setdefault(word, {})[names.get(number, column.label)] = float(column.values[0])
    return found


def _linked(stream: Stream, alive: set[int]) -> Doubt | None:
    mode = next((column.values for column in stream.columns if column.name == "mode_pr"), None)
    if mode is None or not np.nan_to_num(mode).any():
        return None
    linked = [*_LINKED, *(_WAIST if len(alive) == _WITH_WAIST else ())]
    columns = tuple(f"{word}.{_MOTOR}{k}" for word in ("q", "dq", "tau_est") for k in linked)
    marks = ", ".join(f'"*.{_MOTOR}{k}"' for k in linked)
    return Doubt(
        columns,
        f"motors {', '.join(map(str, linked))} stand as A and B of their linkages (mode_pr is 1), not as joints",
        f"ignore: [{marks}]   # or record with mode_pr 0, or columns: {{q.JOINT: q.{_MOTOR}4}} to take them as joints",
    )


def _at_its_ticks(stream: Stream) -> tuple[Stream, str]:
    """The stream at the robot's own times where messages were written late."""
    tick = next((column.values for column in stream.columns if column.name == "tick"), None)
    if tick is None or stream.time is None or len(tick) < 10:
        return stream, ""
    # The counter has 32 bits; messages of a queue may overtake each other.
    steps = np.mod(np.diff(tick) + 2.0**31, 2.0**32) - 2.0**31
    own: Array = _TICK_S * np.concatenate([[0.0], np.cumsum(steps)])
    pace = float(np.ptp(own)) / max(float(np.ptp(stream.time)), 1e-9)
    if abs(pace - 1.0) > _SAME_PACE:
        return (
            stream,
            f"{stream.name}: the robot's ticks go {pace:.3g} times as fast as the log's clock, which is used",
        )
    late = stream.time - own
    late = late - late.min()
    if np.percentile(late, 95) - np.percentile(late, 5) < _LATE_S:
        return stream, ""
    note = f"{stream.name}: messages were written up to {1000.0 * late.max():.0f} ms late; times are the robot's ticks"
    order = np.argsort(own, kind="stable")
    return replace(stream, time=own + (stream.time - own).min()).rows(order), note


def is_wanted(kind: str) -> bool:
    """Whether a message type is read; names with or without ``/msg/``."""
    return _short(kind) in _DECODERS


def decode(kind: str, message: Any, topic: str) -> Row:
    """Fields and numbers of one message."""
    return _DECODERS[_short(kind)](message, topic)


def stamp_s(message: Any) -> float | None:
    """The time that a message's header states [s]; None for none, or for one that was left at zero."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    seconds = getattr(stamp, "sec", getattr(stamp, "secs", 0))
    rest = getattr(stamp, "nanosec", getattr(stamp, "nsecs", 0))
    found = float(seconds) + 1e-9 * float(rest)
    return found or None


def _short(kind: str) -> str:
    return kind.replace("/msg/", "/")


def _joints(names: Iterable[str], parts: Iterable[tuple[str, str, Any]]) -> Row:
    """Arrays over joints; those that are empty, as efforts may be, are left out."""
    names = tuple(names)
    words: list[tuple[str, str]] = []
    numbers: list[float] = []
    for word, channel, values in parts:
        if values is not None and len(values) == len(names):
            words.append((word, channel))
            numbers += np.asarray(values, dtype=float).tolist()
    return _layout(names, tuple(words)), numbers


# Layouts of some topics; orders of joints may differ from message to message.
@lru_cache(maxsize=1024)
def _layout(names: tuple[str, ...], words: tuple[tuple[str, str], ...]) -> tuple[Field, ...]:
    """Fields of arrays over joints: the same object for the same ones, as making them takes longer than decoding."""
    return tuple(Field(f"{word}.{name}", channel, name) for word, channel in words for name in names)


def _joint_state(message: Any, topic: str) -> Row:
    parts = (
        ("position", "q", message.position),
        ("velocity", "v", message.velocity),
        ("effort", "tau", message.effort),
    )
    return _joints(message.name, parts)


def _controller_state(message: Any, topic: str) -> Row:
    """Reference, feedback and output; ``desired`` and ``actual`` in older versions."""
    wanted = _first(message, ("reference", "desired"))
    actual = _first(message, ("feedback", "actual"))
    output = getattr(message, "output", None)
    parts = [
        ("feedback.position", "q", getattr(actual, "positions", None)),
        ("feedback.velocity", "v", getattr(actual, "velocities", None)),
        ("feedback.effort", "tau", getattr(actual, "effort", None)),
        ("reference.position", "q_cmd", getattr(wanted, "positions", None)),
        ("output.effort", "tau_cmd", getattr(output, "effort", None)),
    ]
    return _joints(message.joint_names, parts)


def _first(message: Any, names: tuple[str, ...]) -> Any:
    found = [getattr(message, name) for name in names if getattr(message, name, None) is not None]
    with_positions = [item for item in found if len(item.positions)]
    return (with_positions or found or [None])[0]


def _wrench(message: Any, topic: str) -> Row:
    force, torque = message.wrench.force, message.wrench.torque
    sensor = _sensor(topic, getattr(message.header, "frame_id", ""))
    values = (force.x, force.y, force.z, torque.x, torque.y, torque.z)
    axes = ("fx", "fy", "fz", "tx", "ty", "tz")
    return [Field(f"{sensor}.{axis}", "wrench", f"{sensor}.{axis}") for axis in axes], [
        float(v) for v in values
    ]


def _sensor(topic: str, frame: str) -> str:
    words = [word for word in topic.split("/") if word and word not in {"wrench", "data", "raw", "filtered"}]
    return (words[-1] if words else frame) or "wrench"


def _odometry(message: Any, topic: str) -> Row:
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    values = {
        "px": place.x,
        "py": place.y,
        "pz": place.z,
        "qx": turn.x,
        "qy": turn.y,
        "qz": turn.z,
        "qw": turn.w,
    }
    return [Field(f"pose.{axis}", "base", axis) for axis in values], [float(v) for v in values.values()]


def _imu(message: Any, topic: str) -> Row:
    parts = (("orientation", message.orientation, "xyzw"), ("gyro", message.angular_velocity, "xyz"),
             ("acc", message.linear_acceleration, "xyz"))  # fmt: skip
    called = {"gyro": "g", "acc": "a"}
    fields = [
        Field(f"{word}.{axis}", "imu", called[word] + axis)
        if word in called
        else Field(f"{word}.{axis}", "skip", axis)
        for word, _, axes in parts
        for axis in axes
    ]
    return fields, [float(getattr(value, axis)) for _, value, axes in parts for axis in axes]


def _dynamic_joint_state(message: Any, topic: str) -> Row:
    """Values of each joint by the names of its interfaces, as ros2_control's broadcaster has them."""
    channels = {"position": "q", "velocity": "v", "effort": "tau"}
    fields: list[Field] = []
    numbers: list[float] = []
    for joint, values in zip(message.joint_names, message.interface_values, strict=False):
        for name, value in zip(values.interface_names, values.values, strict=False):
            fields.append(Field(f"{name}.{joint}", channels.get(name, ""), joint if name in channels else ""))
            numbers.append(float(value))
    return fields, numbers


_DECODERS: dict[str, Callable[[Any, str], Row]] = {
    "sensor_msgs/JointState": _joint_state,
    "control_msgs/JointTrajectoryControllerState": _controller_state,
    "control_msgs/DynamicJointState": _dynamic_joint_state,
    "geometry_msgs/WrenchStamped": _wrench,
    "nav_msgs/Odometry": _odometry,
    "sensor_msgs/Imu": _imu,
    "unitree_hg/LowState": LOW_STATE,
    "unitree_hg/LowCmd": LOW_COMMAND,
    "unitree_go/LowState": LOW_STATE,
    "unitree_go/LowCmd": LOW_COMMAND,
}


def trajectory_rows(message: Any) -> Iterable[tuple[float, Row]]:
    """Times and rows of a JointTrajectory: a whole motion in one message."""
    for point in message.points:
        lasts = point.time_from_start
        seconds = getattr(lasts, "sec", getattr(lasts, "secs", 0))
        rest = getattr(lasts, "nanosec", getattr(lasts, "nsecs", 0))
        parts = (
            ("position", "q_cmd", point.positions),
            ("velocity", "skip", point.velocities),
            ("effort", "tau_cmd", point.effort),
        )
        yield float(seconds) + 1e-9 * float(rest), _joints(message.joint_names, parts)


TRAJECTORY = "trajectory_msgs/JointTrajectory"


def is_trajectory(kind: str) -> bool:
    """Whether a message type holds a whole motion."""
    return _short(kind) == TRAJECTORY


# Messages of any type, decoded by their own definition: every number of them under the path of its field.

# Longer lists are images, clouds and scans; joints with hands are below a hundred.
_MOST_NUMBERS = 100
_DEEPEST = 4
# A message of more bytes is no state of joints.
MOST_BYTES = 20_000
_NAMES = ("name", "names", "joint_name", "joint_names")
_LEFT_OUT = {"header", "stamp", "covariance", "crc", "reserve"}


def decode_any(message: Any) -> Row:
    """Fields and numbers of a message of a type that nothing is known of.

    Lists of numbers that are as long as a list of names beside them are called after the names.
    """
    fields: list[Field] = []
    numbers: list[float] = []
    _collect("", message, fields, numbers, 0)
    return fields, numbers


def _members(message: Any) -> dict[str, Any]:
    if isinstance(message, Mapping):
        return dict(message)
    names = getattr(message, "__dataclass_fields__", None) or getattr(message, "__slots__", ())
    return {str(name): getattr(message, name) for name in (names or ()) if not str(name).startswith("_")}


def _collect(path: str, value: Any, fields: list[Field], numbers: list[float], depth: int) -> None:
    if isinstance(value, bool | int | float | np.number):
        fields.append(Field(path))
        numbers.append(float(value))
    elif isinstance(value, np.ndarray | list | tuple):
        _list(path, value, (), fields, numbers, depth)
    elif not isinstance(value, str | bytes | None) and depth <= _DEEPEST:
        members = _members(value)
        names = _names_of(members)
        for name, inner in members.items():
            where = f"{path}.{name}" if path else name
            if name in _LEFT_OUT or name.startswith("__"):
                continue
            if isinstance(inner, np.ndarray | list | tuple):
                _list(where, inner, names if len(names) == len(inner) else (), fields, numbers, depth)
            else:
                _collect(where, inner, fields, numbers, depth + 1)


def _names_of(members: Mapping[str, Any]) -> list[str]:
    lists = (members.get(name, ()) for name in _NAMES)
    return next((list(words) for words in lists if _are_words(words)), [])


def _are_words(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(isinstance(word, str) for word in value)


def _list(path: str, values: Any, names: Any, fields: list[Field], numbers: list[float], depth: int) -> None:
    if not 0 < len(values) <= _MOST_NUMBERS or isinstance(values[0], str | bytes):
        return
    for k, value in enumerate(values):
        where = f"{path}.{names[k]}" if len(names) else f"{path}[{k}]"
        _collect(where, value, fields, numbers, depth + 1)
