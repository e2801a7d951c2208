"""All recordings of what people name: files, and folders of files, parts of one recording put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.conversion.columns.clock import clock_column, clock_tick
from excite.conversion.columns.words import Clue, read_clue
from excite.conversion.recording import NAMELESS, Recording, Stream, merged_names
from excite.conversion.repairs import restore_signs, with_drives_on
from excite.conversion.shapes import reshape_recording
from excite.conversion.sources.registry import read_source, recognised, recognised_recording
from excite.errors import LogError, NothingThereError
from excite.finding import list_names

# How far below a folder that is named recordings may have folders of their own: a session's, a trial's.
_DEPTH = 2
# Files of one recording have as many rows, but for what their loggers lost at the ends, or cover most of one time.
_SAME_ROWS, _OVERLAP = 0.02, 0.5


def read_recordings(sources: Sequence[str | Path]) -> list[Recording]:
    """All recordings, files of a folder in the order of their names; every source that is wrong is said at once."""
    found: list[Recording] = []
    apart: list[Recording] = []
    wrong: list[LogError] = []
    for source in map(Path, sources):
        try:
            ours = _read_files(source, source_files(source))
            found += ours
            apart += [] if ours else _read_folders(source)
        except LogError as error:
            wrong.append(error)
    if wrong:
        raise wrong[0] if len(wrong) == 1 else _all_of(wrong)
    whole = [*_join_parts(found), *apart]
    return [with_drives_on(restore_signs(merged_names(recording))) for recording in whole]


def _read_files(source: Path, files: Sequence[Path]) -> list[Recording]:
    """Recordings of the files that a source stands for; of several, those that hold nothing are named in a note.

    Raises:
        LogError: a file is damaged, or none of them holds anything and no folder below may.
    """
    found: list[Recording] = []
    empty: list[NothingThereError] = []
    for file in files:
        try:
            found += read_source(file)
        except NothingThereError as error:
            empty.append(error)
    if found and empty:
        note = f"nothing was read from {list_names([Path(str(e.source)).name for e in empty])}: they hold no numbers"
        found[0] = replace(found[0], notes=(*found[0].notes, note))
    if not found and empty and not (source.is_dir() and nested_folders(source, _DEPTH)):
        raise empty[0]
    return found


def _all_of(wrong: Sequence[LogError]) -> LogError:
    """One error of several; what is wrong with many files alike is said once."""
    alike: dict[tuple[str, str | None, str | None], list[str]] = {}
    for error in wrong:
        alike.setdefault((error.what, error.field, error.remedy), []).append(str(error.source))
    said = [
        LogError(
            what,
            source=", ".join(of) if len(of) < 3 else f"{of[0]} and {len(of) - 1} more",
            field=field,
            remedy=remedy,
        )
        for (what, field, remedy), of in alike.items()
    ]
    return said[0] if len(said) == 1 else LogError("; ".join(map(str, said)))


def source_files(source: Path) -> list[Path]:
    """What a source stands for: itself, or the files in it of a folder that is no recording; none of those below it."""
    if not source.is_dir() or recognised(source) is not None:
        return [source]
    if (source / "log.yaml").is_file():
        raise LogError(
            "is a log already", source=source, remedy="give it to excite doctor, identify or diagnose"
        )
    files = [file for file in sorted(source.iterdir()) if recognised_recording(file)]
    # Descriptions beside recordings are JSON, too.
    return [file for file in files if file.suffix.lower() != ".json"] or files


def _read_folders(source: Path) -> list[Recording]:
    """Recordings that have a folder each below one that holds none, called after it; parts in a folder are one."""
    found: list[Recording] = []
    for folder, name in nested_folders(source, _DEPTH):
        ours = _join_parts(_read_files(folder, source_files(folder)))
        found += [replace(one, name=name if len(ours) == 1 else f"{name}_{one.name}") for one in ours]
    if not found:
        raise LogError("holds no recordings", source=source, remedy="name the files")
    return found


def nested_folders(source: Path, depth: int) -> list[tuple[Path, str]]:
    """The nearest folders below one that hold recordings, and what to call them."""
    found: list[tuple[Path, str]] = []
    for folder in sorted(path for path in source.iterdir() if path.is_dir()) if depth else []:
        if source_files(folder):
            found.append((folder, folder.name))
        else:
            found += [(deeper, f"{folder.name}_{name}") for deeper, name in nested_folders(folder, depth - 1)]
    return found


def _join_parts(read: Sequence[Recording]) -> list[Recording]:
    """Recordings, reshaped, or where each file holds other columns of as many rows, or over one time, all as one.

    Columns without names are called after their files then: ``torques[0]`` and so on.
    """
    recordings = [part for recording in read for part in reshape_recording(recording)]
    if len(recordings) < 2 or any(len(recording.streams) != 1 for recording in recordings):
        return recordings
    streams = [_called_after_file(recording) for recording in recordings]
    columns = [frozenset(column.name for column in stream.columns) for stream in streams]
    rows = [stream.n_rows for stream in streams]
    in_step = max(rows) - min(rows) <= _SAME_ROWS * max(rows)
    # What all have in common may be a clock, and nothing else.
    apart = len(set(columns)) == len(columns) and len(frozenset.intersection(*columns)) <= 1
    if not apart or not (in_step or _are_of_one_time(recordings, streams)):
        return recordings
    timed = [stream for stream in streams if stream.time is not None or clock_column(stream, _clues(stream))]
    if in_step and len(timed) <= 1 and sum(map(len, columns)) == len(frozenset.union(*columns)):
        # A few rows that some have more, as differences are one less, are cut off at the end.
        short = [stream.rows(slice(min(rows))) for stream in streams]
        first = (timed or streams)[0].rows(slice(min(rows)))
        streams = [replace(first, columns=tuple(column for stream in short for column in stream.columns))]
    names = ", ".join(recording.name for recording in recordings)
    notes = (*recordings[0].notes, f"the files are taken for parts of one recording: {names}")
    return [replace(recordings[0], streams=tuple(streams), notes=notes)]


def _called_after_file(recording: Recording) -> Stream:
    (stream,) = recording.streams
    if NAMELESS not in recording.notes:
        return stream
    columns = (replace(column, name=f"{recording.name}[{k}]") for k, column in enumerate(stream.columns))
    return replace(stream, columns=tuple(columns))


def _clues(stream: Stream) -> dict[str, Clue]:
    """What the names of a stream's columns say."""
    return {c.name: read_clue(c.name, (), c.unit) for c in stream.columns}


def _are_of_one_time(recordings: Sequence[Recording], streams: Sequence[Stream]) -> bool:
    """Whether files of several rates hold other quantities, all over the same time.

    Raises:
        LogError: their clocks have nothing in common.
    """
    held: list[set[tuple[str, bool]]] = []
    spans = []
    for stream in streams:
        clues = _clues(stream)
        said = {(c.quantity, c.commanded) for c in clues.values() if c.quantity not in ("", "time", "skip")}
        clock = clock_column(stream, clues)
        if clock is None or not said or any(said & other for other in held):
            return False
        held.append(said)
        values = next(c.values for c in stream.columns if c.name == clock[0])
        tick = clock_tick(values, clues[clock[0]].unit)[0] or 1.0
        spans.append((np.nanmin(values) * tick, np.nanmax(values) * tick))
    common = min(end for _, end in spans) - max(start for start, _ in spans)
    if common <= _OVERLAP * min(end - start for start, end in spans):
        pairs = zip(recordings, spans, strict=True)
        told = ", ".join(f"{recording.name} from {a:.6g} to {b:.6g} s" for recording, (a, b) in pairs)
        raise LogError(
            f"the files hold other quantities of one recording, but not over the same time: {told}",
            source=recordings[0].source,
            remedy="write both with one clock, or add the difference to the times of one",
        )
    return True
