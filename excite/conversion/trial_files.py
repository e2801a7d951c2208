"""Files of several trials that each have several: positions of the first in one, its torques in another, and so on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from excite.conversion.columns.words import name_tokens
from excite.conversion.parts import joined_parts
from excite.conversion.recording import Recording


def joined_by_trial(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings with those that are parts of one joined: all of them, or those whose names differ in one word.

    ``trial0_positions``, ``trial0_torques``, ``trial1_positions``, ``trial1_torques`` are ``trial0`` and ``trial1``.
    """
    whole = joined_parts(recordings)
    if len(whole) < len(recordings):
        return whole
    found: list[Recording] = []
    for name, parts in _trials(recordings).items():
        ours = joined_parts(parts)
        if len(ours) > 1:
            return whole
        found.append(replace(ours[0], name=name))
    return found or whole


def _trials(recordings: Sequence[Recording]) -> dict[str, list[Recording]]:
    """Parts by the names of their trials; empty where no word of the names says what a file is of."""
    names = [name_tokens(recording.name) for recording in recordings]
    if len({len(words) for words in names}) != 1:
        return {}
    ways = [_parted(recordings, names, at) for at in range(len(names[0]))]
    told = [way for way in ways if way]
    return told[0] if len(told) == 1 else {}


def _parted(
    recordings: Sequence[Recording], names: Sequence[Sequence[str]], at: int
) -> dict[str, list[Recording]]:
    """Parts by the names without one word; empty where not every trial has a part of every such word, or one alone."""
    kinds = {words[at] for words in names}
    trials: dict[str, dict[str, Recording]] = {}
    for words, recording in zip(names, recordings, strict=True):
        trials.setdefault("_".join([*words[:at], *words[at + 1 :]]), {})[words[at]] = recording
    complete = all(parts.keys() == kinds for parts in trials.values())
    if min(len(kinds), len(trials)) < 2 or not complete or len(trials) * len(kinds) != len(recordings):
        return {}
    # All positions have the columns of positions; a trial's number would have those of one trial.
    alike = all(len({_columns(parts[kind]) for parts in trials.values()}) == 1 for kind in kinds)
    apart = len({_columns(recording) for recording in recordings}) == len(kinds)
    if not alike or not apart:
        return {}
    # Columns are called after what their file is of, which is the same in all trials.
    return {name: [_called(part, kind) for kind, part in parts.items()] for name, parts in trials.items()}


def _called(recording: Recording, kind: str) -> Recording:
    streams = tuple(replace(stream, name=kind) for stream in recording.streams)
    return replace(recording, name=kind, streams=streams)


def _columns(recording: Recording) -> tuple[str, ...]:
    return tuple(column.name for stream in recording.streams for column in stream.columns)
