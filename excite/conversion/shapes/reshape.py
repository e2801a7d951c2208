"""All shapes of tables brought to one: a row a sample, a column a channel, a recording a trial."""

from __future__ import annotations

from dataclasses import replace

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes.cells import unpack_cells
from excite.conversion.shapes.episodes import by_episode
from excite.conversion.shapes.labels import apply_labels
from excite.conversion.shapes.long import widen_table
from excite.conversion.shapes.melted import spread_signals
from excite.conversion.shapes.motor_states import with_motors_named
from excite.conversion.shapes.own_clocks import by_clock
from excite.conversion.shapes.split_stamps import with_whole_stamps


def reshape_recording(recording: Recording) -> list[Recording]:
    """The recording with arrays in cells unpacked, one column a joint, its stamps whole; one for each trial in it.

    Raises:
        LogError: it holds words only.
    """
    notes = list(recording.notes)
    streams = []
    parts = [by_clock(stream) for stream in recording.streams]
    notes += [note for _, note in parts if note]
    for stream in (one for streams_of, _ in parts for one in streams_of):
        for step in (unpack_cells, spread_signals, widen_table, apply_labels, with_whole_stamps):
            stream, note = step(stream)
            notes += [note] if note else []
        streams.append(stream)
    if not any(stream.columns for stream in streams):
        raise nothing_there(recording.source)
    streams, said = with_motors_named(streams)
    said = {**recording.said, **said}
    return by_episode(
        replace(recording, streams=tuple(streams), said=said, notes=tuple(dict.fromkeys(notes)))
    )
