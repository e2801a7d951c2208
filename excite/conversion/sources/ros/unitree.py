"""Unitree's LowState and LowCmd: numbered motors, of which a machine has some, and the robot's own clock.

Order of motors as in the vendor's SDK (unitree_sdk2: ``example/go2``, ``example/h1``, ``example/g1``): quadrupeds count
legs FR, FL, RR, RL, those on wheels the wheels after them; H1 has an order of its own; of unitree_hg's humanoids every
model counts left leg, right leg, waist, left arm, right arm, as their models do, and leaves out what it does not have.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from excite.arrays import Array
from excite.conversion.recording import Column, Stream
from excite.conversion.sources.ros.gathered import Field, Row

_LEGS = ("FR", "FL", "RR", "RL")
_QUADRUPED = tuple(f"{leg}_{joint}_joint" for leg in _LEGS for joint in ("hip", "thigh", "calf"))
_WHEELED = (*_QUADRUPED, *(f"{leg}_foot_joint" for leg in _LEGS))
_H1 = tuple(
    f"{name}_joint"
    for name in (
        *("right_hip_roll", "right_hip_pitch", "right_knee", "left_hip_roll", "left_hip_pitch", "left_knee"),
        *("torso", "left_hip_yaw", "right_hip_yaw", "unused", "left_ankle", "right_ankle"),
        *(f"{side}_{joint}" for side in ("right", "left") for joint in (
            "shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")),
    )
)  # fmt: skip
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
    order = _QUADRUPED if highest < len(_QUADRUPED) else _WHEELED if highest < len(_WHEELED) else _H1
    return {k: order[k] for k in alive if k < len(order)}


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
