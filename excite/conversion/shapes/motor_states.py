"""Unitree's LowState in a table or as JSON: an array of motors, of which a machine has some, in the vendor's order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from excite.conversion.recording import Column, Stream
from excite.conversion.sources.ros.unitree import finished

# motor_state/q[3] as JSON's rows are read, motor_state[3].q and motorState_3_tauEst as tables are flattened.
_OF_MOTOR = re.compile(
    r"(?:.*[/._])?motor_?state[/._]?(?:(?P<word>[a-z_]+)\[(?P<k>\d+)\]|\[?(?P<n>\d+)\]?[/._](?P<field>[a-z_]+))",
    re.IGNORECASE,
)
_CHANNELS = {"q": ("q", "q"), "dq": ("dq", "v"), "tauest": ("tau_est", "tau")}
# The message of the quadrupeds and of H1 has twenty motors, that of later humanoids more.
_LEGGED = 20


def with_motors_named(streams: Sequence[Stream]) -> tuple[list[Stream], dict[str, Any]]:
    """The streams, motors of a LowState under their joints' names, without those that the machine lacks.

    Returns:
        Streams, and what they say as bags of these messages do (``doubts``, ``linkages``); nothing where there is no
        such message.
    """
    done: list[Stream] = []
    said: dict[str, Any] = {}
    for stream in streams:
        named, count = _as_in_bags(stream)
        if count:
            kind = "unitree_go/LowState" if count <= _LEGGED else "unitree_hg/LowState"
            found = finished([(kind, named)])
            done += found.streams
            said |= found.said
        else:
            done.append(stream)
    return done, said


def _as_in_bags(stream: Stream) -> tuple[Stream, int]:
    """The stream, its motors' columns called as in bags, and how many motors the message has; zero for none."""
    columns: list[Column] = []
    motors: dict[str, set[int]] = {}
    for column in stream.columns:
        match = _OF_MOTOR.fullmatch(column.name)
        word = (match["word"] or match["field"]).replace("_", "").lower() if match else ""
        if match is None or column.channel:
            columns.append(column)
        elif word in _CHANNELS:
            name, channel = _CHANNELS[word]
            k = int(match["k"] or match["n"])
            motors.setdefault(name, set()).add(k)
            label = f"motor_{k}"
            columns.append(replace(column, name=f"{name}.{label}", channel=channel, label=label))
    counts = {len(numbers) for numbers in motors.values()}
    if (
        "q" not in motors
        or len(motors) < 2
        or len(counts) != 1
        or motors["q"] != set(range(len(motors["q"])))
    ):
        return stream, 0
    return replace(stream, columns=tuple(columns)), counts.pop()
