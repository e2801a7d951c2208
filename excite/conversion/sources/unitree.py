"""Unitree's LowState and LowCmd: numbered motors, of which a machine has some, and the robot's own clock."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.conversion.recording import Column, Stream
from excite.conversion.sources.messages import MOTOR
from excite.formats.unitree import H1, QUADRUPED, WHEELED

# Motors behind linkages of unitree_hg, which stand as motors A and B where mode_pr is 1: ankles, and the G1's waist.
_LINKED, _WAIST, _WITH_WAIST = (4, 5, 10, 11), (13, 14), 29
# The message of the quadrupeds and of H1 has twenty motors, that of later humanoids more.
_LEGGED = 20
# motor_state/q[3] as JSON's rows are read, motor_state[3].q and motorState_3_tauEst as tables are flattened.
_OF_MOTOR = re.compile(
    r"(?:.*[/._])?motor_?state[/._]?(?:(?P<word>[a-z_]+)\[(?P<k>\d+)\]|\[?(?P<n>\d+)\]?[/._](?P<field>[a-z_]+))",
    re.IGNORECASE,
)
_CHANNELS = {"q": ("q", "q"), "dq": ("dq", "v"), "tauest": ("tau_est", "tau")}


@dataclass(frozen=True, eq=False)
class Doubt:
    """Columns of motors behind linkages, which do not hold what their place says.

    Attributes:
        columns: their names.
        motors: numbers of the motors.
        marks: patterns of their columns, as a map ignores them.
    """

    columns: tuple[str, ...]
    motors: tuple[str, ...]
    marks: str


@dataclass
class Named:
    """Streams of this family under their joints' names.

    Attributes:
        streams: of the motors that the machine has.
        said: ``gains`` by label, ``doubts``, and whether ``linkages`` stand as their ``motors`` or as ``joints``.
        notes: what was done, in words.
    """

    streams: list[Stream] = field(default_factory=list)
    said: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def is_unitree(kind: str) -> bool:
    """Whether a message type is one of these."""
    return kind.startswith(("unitree_hg/", "unitree_go/"))


def name_motors(streams: Sequence[tuple[str, Stream]]) -> Named:
    """Streams with the motors that the machine has, under their joints' names, at the robot's own times.

    Args:
        streams: message type and stream of each topic of this family.
    """
    states = [stream for kind, stream in streams if kind.endswith("LowState")]
    # Motors of which any number was ever other than zero.
    alive = {
        number
        for stream in states or [stream for _, stream in streams]
        for column in stream.columns
        if (number := _number(column)) is not None and np.nan_to_num(column.values).any()
    }
    legged = streams[0][0].startswith("unitree_go/")
    order = next((names for names in (QUADRUPED, WHEELED) if max(alive, default=0) < len(names)), H1)
    # Models leave out what a machine does not have, and count on.
    labels = {number: f"{MOTOR}{k}" for k, number in enumerate(sorted(alive))}
    names = {k: f"{order[k] or 'unused'}_joint" for k in alive if legged and k < len(order)}
    found = Named()
    for _, stream in streams:
        timed, note = _at_its_ticks(stream)
        found.notes += [note] if note else []
        columns: list[Column] = []
        for column in timed.columns:
            number, word = _number(column), column.name.partition(".")[0]
            if number is None:
                columns.append(column)
            elif number in alive:
                name = names.get(number, column.label)
                columns.append(
                    replace(column, name=f"{word}.{name}", label=names.get(number, labels[number]))
                )
                # Gains that stay what they are from the first command to the last.
                if word in ("kp", "kd") and np.ptp(column.values) == 0.0:
                    found.said.setdefault("gains", {}).setdefault(word, {})[name] = float(column.values[0])
        found.streams.append(replace(timed, columns=tuple(columns)))
        mode = next((column.values for column in stream.columns if column.name == "mode_pr"), None)
        if mode is not None and np.nan_to_num(mode).any():
            linked = [*_LINKED, *(_WAIST if len(alive) == _WITH_WAIST else ())]
            of = tuple(f"{word}.{MOTOR}{k}" for word in ("q", "dq", "tau_est") for k in linked)
            marks = ", ".join(f'"*.{MOTOR}{k}"' for k in linked)
            found.said["doubts"] = [Doubt(of, tuple(map(str, linked)), marks)]
    if not legged:
        found.said["linkages"] = "motors" if "doubts" in found.said else "joints"
    return found


def _number(column: Column) -> int | None:
    return int(column.label.removeprefix(MOTOR)) if column.label.startswith(MOTOR) else None


def _at_its_ticks(stream: Stream) -> tuple[Stream, str]:
    """The stream at the robot's own times where messages were written late."""
    tick = next((column.values for column in stream.columns if column.name == "tick"), None)
    if tick is None or stream.time is None or len(tick) < 10:
        return stream, ""
    # Ticks are milliseconds of a counter of 32 bits; messages of a queue may overtake each other.
    steps = np.mod(np.diff(tick) + 2.0**31, 2.0**32) - 2.0**31
    own: Array = 1e-3 * np.concatenate([[0.0], np.cumsum(steps)])
    pace = float(np.ptp(own)) / max(float(np.ptp(stream.time)), 1e-9)
    if abs(pace - 1.0) > 0.02:
        return (
            stream,
            f"{stream.name}: the robot's ticks go {pace:.3g} times as fast as the log's clock, which is used",
        )
    late = stream.time - own
    late = late - late.min()
    # Messages that were written two milliseconds after the robot's own clock stood in a queue.
    if np.percentile(late, 95) - np.percentile(late, 5) < 2e-3:
        return stream, ""
    note = f"{stream.name}: messages were written up to {1000.0 * late.max():.0f} ms late; times are the robot's ticks"
    order = np.argsort(own, kind="stable")
    return replace(stream, time=own + (stream.time - own).min()).rows(order), note


def name_motors_of_tables(streams: Sequence[Stream]) -> tuple[list[Stream], Mapping[str, Any]]:
    """The streams, motors of a LowState in a table or JSON under their joints' names, and what they say as bags do."""
    done: list[Stream] = []
    said: dict[str, Any] = {}
    for stream in streams:
        columns: list[Column] = []
        motors: dict[str, set[int]] = {}
        for column in stream.columns:
            match = _OF_MOTOR.fullmatch(column.name)
            word = (match["word"] or match["field"]).replace("_", "").lower() if match else ""
            if match is None or column.channel:
                columns.append(column)
            elif word in _CHANNELS:
                name, channel = _CHANNELS[word]
                label = f"{MOTOR}{match['k'] or match['n']}"
                motors.setdefault(name, set()).add(int(label.removeprefix(MOTOR)))
                columns.append(replace(column, name=f"{name}.{label}", channel=channel, label=label))
        count = len(motors.get("q", ()))
        if count > 1 and all(numbers == set(range(count)) for numbers in motors.values()):
            kind = "unitree_go/LowState" if count <= _LEGGED else "unitree_hg/LowState"
            found = name_motors([(kind, replace(stream, columns=tuple(columns)))])
            done += found.streams
            said |= found.said
        else:
            done.append(stream)
    return done, said
