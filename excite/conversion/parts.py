"""Files that hold parts of the same recording: positions in one, torques in another, rows or clocks in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.conversion.recording import Recording

# Files of one recording have as many rows, but for what their loggers lost at the ends.
_SAME_ROWS = 0.02
NAMELESS = "the file names no columns: they are called column1, column2 … here"


def joined_parts(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings as they are or, where each file holds other columns of as many rows, all of them as one.

    Columns without names are called after their files then: ``torques[0]`` and so on.
    """
    if len(recordings) < 2 or any(len(recording.streams) != 1 for recording in recordings):
        return list(recordings)
    named = [_called_after_file(recording) for recording in recordings]
    signatures = {frozenset(_words(recording)) for recording in named}
    rows = np.array([recording.streams[0].n_rows for recording in named], dtype=float)
    if len(signatures) < len(named) or np.ptp(rows) > _SAME_ROWS * rows.max():
        return list(recordings)
    columns = [set(_words(recording)) for recording in named]
    shared = set.intersection(*columns)
    # What all have in common may be a clock, and nothing else.
    if len(shared) > 1:
        return list(recordings)
    first = named[0]
    streams = tuple(stream for recording in named for stream in recording.streams)
    note = "the files are taken for parts of one recording: " + ", ".join(
        recording.name for recording in named
    )
    return [replace(first, streams=streams, notes=(*first.notes, note))]


def _words(recording: Recording) -> list[str]:
    return [column.name for column in recording.streams[0].columns]


def _called_after_file(recording: Recording) -> Recording:
    if NAMELESS not in recording.notes:
        return recording
    (stream,) = recording.streams
    columns = tuple(replace(c, name=f"{recording.name}[{k}]") for k, c in enumerate(stream.columns))
    return replace(recording, streams=(replace(stream, columns=columns),))
