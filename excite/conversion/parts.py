"""Files that hold parts of the same recording: positions in one, torques in another, rows or clocks in common."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from excite.conversion.columns.clock import clock_column, clock_tick
from excite.conversion.columns.words import Clue, read_clue
from excite.conversion.recording import Recording, Stream, merged_names
from excite.errors import LogError

# Files of one recording have as many rows, but for what their loggers lost at the ends.
_SAME_ROWS = 0.02
# Parts of one recording cover most of the time that the shortest of them does.
_OVERLAP = 0.5
NAMELESS = "the file names no columns: they are called column1, column2 … here"


def joined_parts(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings as they are or, where each file holds other columns of as many rows, or over one time, all as one.

    Columns without names are called after their files then: ``torques[0]`` and so on.
    """
    if len(recordings) < 2 or any(len(recording.streams) != 1 for recording in recordings):
        return list(recordings)
    named = [_called_after_file(recording) for recording in recordings]
    signatures = {frozenset(_name_words(recording)) for recording in named}
    rows = np.array([recording.streams[0].n_rows for recording in named], dtype=float)
    if len(signatures) < len(named):
        return list(recordings)
    columns = [set(_name_words(recording)) for recording in named]
    shared = set.intersection(*columns)
    # What all have in common may be a clock, and nothing else.
    if len(shared) > 1:
        return list(recordings)
    if np.ptp(rows) > _SAME_ROWS * rows.max() and not _of_one_time(named):
        return list(recordings)
    first = named[0]
    streams = _in_step(tuple(stream for recording in named for stream in recording.streams))
    note = "the files are taken for parts of one recording: " + ", ".join(
        recording.name for recording in named
    )
    return [replace(first, streams=streams, notes=(*first.notes, note))]


def _in_step(streams: tuple[Stream, ...]) -> tuple[Stream, ...]:
    """Streams as they are or, where they have as many rows and at most one a clock, all as one.

    A few rows that some have more, as differences are one less, are cut off at the end.
    """
    timed = [stream for stream in streams if stream.time is not None or _clock_column(stream) is not None]
    rows = [stream.n_rows for stream in streams]
    if len(timed) > 1 or max(rows) - min(rows) > _SAME_ROWS * max(rows):
        return streams
    columns = tuple(column for stream in streams for column in stream.rows(slice(min(rows))).columns)
    if len({column.name for column in columns}) < len(columns):
        return streams
    first = timed[0] if timed else streams[0]
    return (replace(first.rows(slice(min(rows))), columns=columns),)


def _clock_column(stream: Stream) -> tuple[str, str] | None:
    """The column of a stream that is its clock."""
    return clock_column(stream, {c.name: read_clue(c.name, (), c.unit) for c in stream.columns})


def joined_by_joint(recordings: Sequence[Recording], joints: Sequence[str]) -> list[Recording]:
    """Recordings as they are or, where each file is called after a joint and holds what one joint did, all as one."""
    if len(recordings) < 2 or any(len(recording.streams) != 1 for recording in recordings):
        return list(recordings)
    named = [read_clue(recording.name, joints).exact for recording in recordings]
    inside = [read_clue(word, joints) for recording in recordings for word in _name_words(recording)]
    # A trial of the whole machine may be called after the joint that it is aimed at.
    of_several = any(said.exact or said.number is not None for said in inside)
    if not all(named) or len(set(named)) < len(named) or of_several:
        return list(recordings)
    streams = tuple(
        replace(recording.streams[0], name=joint) for recording, joint in zip(recordings, named, strict=True)
    )
    note = "each file is taken for what one joint did: " + ", ".join(named)
    first = recordings[0]
    return [merged_names(replace(first, streams=streams, notes=(*first.notes, note)))]


def _of_one_time(recordings: Sequence[Recording]) -> bool:
    """Whether files of several rates hold other quantities, all over the same time.

    Raises:
        LogError: their clocks have nothing in common.
    """
    clues = [{c.name: read_clue(c.name, (), c.unit) for c in r.streams[0].columns} for r in recordings]
    clocks = [
        clock_column(recording.streams[0], said) for recording, said in zip(recordings, clues, strict=True)
    ]
    quantities = [_recorded_quantities(said) for said in clues]
    disjoint = all(a and b and not a & b for a, b in itertools.combinations(quantities, 2))
    if not disjoint or any(clock is None for clock in clocks):
        return False
    spans = []
    for recording, clock, said in zip(recordings, clocks, clues, strict=True):
        name = clock[0] if clock else ""
        values = next(c.values for c in recording.streams[0].columns if c.name == name)
        factor, _ = clock_tick(values, said[name].unit)
        spans.append((np.nanmin(values) * (factor or 1.0), np.nanmax(values) * (factor or 1.0)))
    common = min(end for _, end in spans) - max(start for start, _ in spans)
    if common <= _OVERLAP * min(end - start for start, end in spans):
        told = ", ".join(
            f"{r.name} from {a:.6g} to {b:.6g} s" for r, (a, b) in zip(recordings, spans, strict=True)
        )
        raise LogError(
            f"the files hold other quantities of one recording, but not over the same time: {told}",
            source=recordings[0].source,
            remedy="write both with one clock, or add the difference to the times of one",
        )
    return True


def _recorded_quantities(said: Mapping[str, Clue]) -> set[tuple[str, bool]]:
    """What is recorded in a file beside its time."""
    return {(c.quantity, c.commanded) for c in said.values()} - {
        (quantity, commanded) for quantity in ("", "time", "skip") for commanded in (False, True)
    }


def _name_words(recording: Recording) -> list[str]:
    return [column.name for column in recording.streams[0].columns]


def _called_after_file(recording: Recording) -> Recording:
    if NAMELESS not in recording.notes:
        return recording
    (stream,) = recording.streams
    columns = tuple(replace(c, name=f"{recording.name}[{k}]") for k, c in enumerate(stream.columns))
    return replace(recording, streams=(replace(stream, columns=columns),))
