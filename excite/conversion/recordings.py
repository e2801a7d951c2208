"""All recordings of what people name: files, and folders of files, in one shape."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.columns.clock import goes_evenly, is_clock
from excite.conversion.columns.words import name_tokens, read_clue
from excite.conversion.recording import Column, Recording, Stream, merged_names, nothing_there
from excite.conversion.repairs import restore_signs, with_drives_on
from excite.conversion.shapes import apply_labels, by_episode
from excite.conversion.sources.messages import finished
from excite.conversion.sources.registry import read_source, recognised, recognised_recording
from excite.conversion.trials import joined_by_trial
from excite.errors import LogError, NothingThereError
from excite.finding import list_names

# How far below a folder that is named recordings may have folders of their own: a session's, a trial's.
_DEPTH = 2
# Files of one fault that an error names; of more only the first.
_NAMED = 2


def read_recordings(sources: Sequence[str | Path]) -> list[Recording]:
    """All recordings, files of a folder in the order of their names; every source that is wrong is said at once."""
    found: list[Recording] = []
    apart: list[Recording] = []
    wrong: list[LogError] = []
    for source in map(Path, sources):
        try:
            ours = _read_source(source, source_files(source))
            found += ours
            apart += [] if ours else _of_folders(source)
        except LogError as error:
            wrong.append(error)
    if len(wrong) == 1:
        raise wrong[0]
    if wrong:
        raise _all_of(wrong)
    whole = [*_join_recordings(found), *apart]
    return [with_drives_on(restore_signs(merged_names(recording))) for recording in whole]


def _read_source(source: Path, files: Sequence[Path]) -> list[Recording]:
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
    if len(alike) == 1:
        ((what, field, remedy), sources) = next(iter(alike.items()))
        return LogError(what, source=_check_few(sources), field=field, remedy=remedy)
    said = [
        LogError(what, source=_check_few(of), field=field, remedy=do)
        for (what, field, do), of in alike.items()
    ]
    return LogError("; ".join(map(str, said)))


def _check_few(sources: Sequence[str]) -> str:
    if len(sources) > _NAMED:
        return f"{sources[0]} and {len(sources) - 1} more"
    return ", ".join(sources)


def _join_recordings(recordings: Sequence[Recording]) -> list[Recording]:
    return joined_by_trial([part for recording in recordings for part in reshape_recording(recording)])


def source_files(source: Path) -> list[Path]:
    """What a source stands for: itself, or the files in it of a folder that is no recording; none of those below it."""
    if not source.is_dir() or recognised(source) is not None:
        return [source]
    files = [file for file in sorted(source.iterdir()) if recognised_recording(file)]
    # Descriptions beside recordings are JSON, too.
    return [file for file in files if file.suffix.lower() != ".json"] or files


def _of_folders(source: Path) -> list[Recording]:
    """Recordings that have a folder each below one that holds none, called after it; parts in a folder are one."""
    found: list[Recording] = []
    for folder, name in nested_folders(source, _DEPTH):
        ours = _join_recordings(_read_source(folder, source_files(folder)))
        alone = len(ours) == 1
        found += [replace(one, name=name if alone else f"{name}_{one.name}") for one in ours]
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


# All shapes of tables brought to one: a row a sample, a column a channel, a recording a trial.


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


# Whole arrays in the cells of a table, as data frames write them.

_ARRAY = re.compile(r"\s*(?:(?:np\.|torch\.)?(?:array|tensor)\()?\s*[\[(]")
# Not the 64 of np.float64(0.5), as numpy writes the numbers of a list.
_NUMBER = re.compile(r"(?<![A-Za-z\d.])[+-]?(?:\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?|nan|inf)")
_WORD = re.compile(r"""["']([^"']+)["']""")
# Rows that a killed logger leaves incomplete are few.
_WHOLE = 0.95


def unpack_cells(stream: Stream) -> tuple[Stream, str]:
    """The stream with ``NAME[0] … NAME[k-1]`` for a column whose cells hold ``k`` numbers each, and a note.

    Cells that hold words, as names of joints, are words of ``NAME[0]`` and so on.
    """
    columns, words, done = list(stream.columns), dict(stream.words), []
    for name, cells in stream.words.items():
        first = next((str(cell) for cell in cells if cell), "")
        if not _ARRAY.match(first):
            continue
        quoted = _WORD.findall(first)
        if quoted:
            del words[name]
            if all(cell == cells[0] for cell in cells):
                words |= {f"{name}[{k}]": np.full(len(cells), word, object) for k, word in enumerate(quoted)}
            continue
        found = [_NUMBER.findall(str(cell)) for cell in cells]
        width = len(_NUMBER.findall(first))
        whole = np.array([len(numbers) == width for numbers in found])
        if not width or whole.mean() < _WHOLE:
            continue
        none = [float("nan")] * width
        table = np.array(
            [numbers if there else none for numbers, there in zip(found, whole, strict=True)], float
        )
        columns += [Column(f"{name}[{k}]", table[:, k]) for k in range(width)]
        del words[name]
        done.append(name)
    note = f"cells of {', '.join(done)} hold arrays, a column each here" if done else ""
    return replace(stream, columns=tuple(columns), words=words), note


# Long tables: a row a joint and sample, or a row a quantity and sample, with a column that says which.

_KEYS = frozenset("joint joints name motor motors id axis actuator servo dof".split())
# Joints of a humanoid with hands; samples that are worth a table; how unequal joints' rows may be.
_MOST, _FEWEST, _UNEQUAL = 100, 10, 0.02


def widen_table(stream: Stream) -> tuple[Stream, str]:
    """The stream with a column for each joint of ``position`` … where a column names the joint of its row; a note."""
    if len(stream.columns) > _MOST:
        return stream, ""
    for name, cells in _key_columns(stream).items():
        found = _rows_by_key(cells)
        if found is None:
            continue
        labels, rows = found
        if name in stream.words and _are_quantities(labels):
            return _a_row_a_quantity(stream, name, labels, rows)
        if not _is_key(name):
            continue
        columns: list[Column] = []
        for column in stream.columns:
            if column.name == name:
                continue
            table = column.values[rows]
            if (table == table[0]).all() or all(is_clock(values) for values in table):
                columns.append(replace(column, values=table[0]))
            else:
                columns += [
                    replace(column, name=f"{column.name}.{label}", values=values, label=label)
                    for label, values in zip(labels, table, strict=True)
                ]
        time = None if stream.time is None else stream.time[rows[0]]
        note = f"{name} names the joint of each row: {len(labels)} rows a sample, a column a joint here"
        return replace(stream, columns=tuple(columns), words={}, time=time), note
    return stream, ""


def _are_quantities(labels: list[str]) -> bool:
    """Whether each names a quantity, positions among them, and no two the same one."""
    said = [read_clue(label, ()) for label in labels]
    named = {(one.quantity, one.commanded) for one in said if one.quantity not in ("", "skip")}
    return ("q", False) in named and len(named) == len(labels)


def _a_row_a_quantity(
    stream: Stream, name: str, labels: list[str], rows: NDArray[np.int64]
) -> tuple[Stream, str]:
    """A column a joint and quantity, of lines that begin with ``Position``, ``Velocity``, ``Torque`` in turn."""
    columns: list[Column] = []
    for column in stream.columns:
        values = column.values[rows]
        if all(is_clock(one) for one in values):
            columns.append(replace(column, values=values[0]))
            continue
        at = len(columns) // len(labels)
        columns += [
            replace(
                column, name=f"{label}[{at}]" if stream.nameless else f"{label}.{column.name}", values=one
            )
            for label, one in zip(labels, values, strict=True)
        ]
    time = None if stream.time is None else stream.time[rows[0]]
    note = f"{name} names the quantity of each row: {', '.join(labels)}"
    return replace(stream, columns=tuple(columns), words={}, time=time, nameless=False), note


def _key_columns(stream: Stream) -> dict[str, NDArray[np.object_]]:
    """Columns that may say which joint or quantity a row is of."""
    numbers = {
        column.name: np.array([f"{value:g}" for value in column.values], object)
        for column in stream.columns
        if _is_key(column.name) and _is_count(column.values)
    }
    return dict(stream.words) | numbers


def _is_key(name: str) -> bool:
    words = [word for word in re.split(r"[^a-z]+", name.lower()) if word]
    return bool(words) and set(words) <= _KEYS and not re.search(r"\d", name)


def _is_count(values: Array) -> bool:
    return bool(np.isfinite(values).all() and (values == np.round(values)).all() and np.ptp(values) <= _MOST)


def _rows_by_key(cells: NDArray[np.object_]) -> tuple[list[str], NDArray[np.int64]] | None:
    """Labels in their order, and ``(joints, samples)`` rows; None where rows do not go round the joints."""
    text = np.array([str(cell) for cell in cells])
    labels = list(dict.fromkeys(text[: 10 * _MOST].tolist()))
    if not 1 < len(labels) <= _MOST or len(text) < _FEWEST * len(labels):
        return None
    rows = [np.flatnonzero(text == label) for label in labels]
    counts = [len(found) for found in rows]
    if sum(counts) < len(text) or np.ptp(counts) > max(1.0, _UNEQUAL * max(counts)):
        return None
    return labels, np.array([found[: min(counts)] for found in rows])


# Tables of one value a row, as data bases and data frames give them out: which signal it is of stands beside
# it.

_VALUES = frozenset("value values val data number reading y".split())
# Signals of a humanoid with hands, measured and commanded; rows of each that are worth a table.
_MELTED_MOST, _MELTED_FEWEST = 400, 10


def spread_signals(stream: Stream) -> tuple[Stream, str]:
    """The stream with a column a signal, where each row has one value and words that say of which signal; a note.

    Signals need not have been written at the same times: rows are those of all of them, empty where one has none.
    """
    parts = _time_and_value(stream)
    if parts is None:
        return stream, ""
    time, value = parts
    text, keys = _row_labels(stream)
    labels, which = np.unique(text, return_inverse=True)
    there = np.isfinite(time.values)
    if not 1 < len(labels) <= _MELTED_MOST or not any(
        read_clue(str(label), ()).quantity == "q" for label in labels
    ):
        return stream, ""
    if np.bincount(which[there], minlength=len(labels)).min() < _MELTED_FEWEST:
        return stream, ""
    times, place = np.unique(time.values[there], return_inverse=True)
    table = np.full((len(labels), len(times)), np.nan)
    table[which[there], place] = value.values[there]
    columns = [replace(time, values=times)]
    columns += [Column(str(label), row) for label, row in zip(labels, table, strict=True)]
    note = f"{' and '.join(keys)} say which signal a row is of: {len(labels)} signals, a column each here"
    return replace(stream, columns=tuple(columns), words={}), note


def _time_and_value(stream: Stream) -> tuple[Column, Column] | None:
    """The columns of times and of values; None where there is more than one of either, or no word beside them."""
    if stream.time is not None or stream.nameless or not stream.words:
        return None
    varying = [column for column in stream.columns if _has_variation(column.values)]
    times = [column for column in varying if read_clue(column.name, ()).quantity == "time"]
    values = [column for column in varying if set(name_tokens(column.name)) <= _VALUES]
    return (times[0], values[0]) if len(times) == 1 and len(values) == 1 else None


def _row_labels(stream: Stream) -> tuple[NDArray[np.str_], list[str]]:
    """What the words of each row say together, and the names of the columns that they stand in."""
    said = {name: np.array([str(cell or "") for cell in cells]) for name, cells in stream.words.items()}
    keys = [name for name, cells in said.items() if len(cells) and (cells != cells[0]).any()]
    text = np.array([""] * stream.n_rows) if not keys else said[keys[0]]
    for name in keys[1:]:
        text = np.char.add(np.char.add(text, "."), said[name])
    return text, keys


def _has_variation(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and float(np.ptp(known)) > 0.0


# Unitree's LowState in a table or as JSON: an array of motors, of which a machine has some, in the vendor's
# order.

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


# Tables whose columns have clocks of their own: time, signal, time, signal, as oscilloscopes of controllers
# write.

# Clocks are one where, in the units of one, what they differ by changes less than this share of a step.
_SAME = 0.05
# Units of time that may stand side by side: seconds, milliseconds, microseconds, nanoseconds.
_UNITS = 1e3


def by_clock(stream: Stream) -> tuple[list[Stream], str]:
    """A stream for each clock of a table in which clocks stand before their signals; a note where there are several.

    TwinCAT's Scope exports each channel so. Read as one table the torques of a slower task went by twice as fast.
    """
    groups = _clock_groups(stream)
    if len(groups) < 2:
        return [stream], ""
    parts: list[tuple[Column, list[Column]]] = []
    for clock, signals in groups:
        same = next((part for part in parts if _are_one(part[0].values, clock.values)), None)
        if same is None:
            parts.append((clock, list(signals)))
        else:
            same[1].extend(signals)
    if len(parts) < 2:
        return [stream], ""
    made = []
    for k, (clock, signals) in enumerate(parts):
        # Not called by the file: ``a_1`` would say what its columns are.
        whole = replace(stream, name=f"part_{k + 1}", columns=(clock, *signals), words={})
        made.append(whole.rows(np.isfinite(clock.values)))
    return (
        made,
        f"{stream.name} has {len(parts)} clocks, each before its signals: {parts[1][0].name} is another one",
    )


def _clock_groups(stream: Stream) -> list[tuple[Column, list[Column]]]:
    """Clocks with the signals behind them; none where the table does not begin with one, or one has no signal."""
    if stream.time is not None or not stream.columns:
        return []
    first = _name_stem(stream.columns[0].name)
    groups: list[tuple[Column, list[Column]]] = []
    for column in stream.columns:
        named = _name_stem(column.name) == first or read_clue(column.name, ()).quantity == "time"
        if named and goes_evenly(column.values):
            groups.append((column, []))
        elif groups:
            groups[-1][1].append(column)
        else:
            return []
    return groups if all(signals for _, signals in groups) else []


def _name_stem(name: str) -> str:
    """A name without the number of its column."""
    return re.sub(r"~\d+$", "", name)


def _are_one(a: Array, b: Array) -> bool:
    """Whether two clocks are one, though perhaps in other units and from another zero."""
    known = np.isfinite(a) & np.isfinite(b)
    if not np.array_equal(np.isfinite(a), np.isfinite(b)) or known.sum() < 2:
        return False
    steps = np.median(np.diff(a[known])), np.median(np.diff(b[known]))
    if min(steps) <= 0.0:
        return False
    unit = _UNITS ** round(float(np.log(steps[1] / steps[0]) / np.log(_UNITS)))
    differ = b[known] / unit - a[known]
    return float(np.ptp(differ)) < _SAME * float(steps[0])


# Times of which one column holds the seconds and the next one what is beyond them.

# Nanoseconds, microseconds, milliseconds of a second.
_PARTS = (1e9, 1e6, 1e3)
# Of a recording of some seconds the parts come near both ends of a second.
_LEAST, _SPLIT_STAMPS_MOST = 0.2, 0.8


def with_whole_stamps(stream: Stream) -> tuple[Stream, str]:
    """The stream with one clock for every pair of columns that are whole seconds and parts of them, and a note."""
    if stream.time is not None:
        return stream, ""
    columns: list[Column] = []
    done = []
    for column in stream.columns:
        before = columns[-1] if columns else None
        whole = None if before is None or before.channel else _join_stamps(before.values, column.values)
        if before is None or whole is None:
            columns.append(column)
            continue
        name = f"{before.name}+{column.name}"
        columns[-1] = Column(name, whole, channel="time", unit="s")
        done.append(name)
    note = f"{', '.join(done)}: seconds and parts of a second are one time" if done else ""
    return replace(stream, columns=tuple(columns)), note


def _join_stamps(seconds: Array, parts: Array) -> Array | None:
    """Seconds with their parts; None where these columns are no such pair."""
    known = np.isfinite(seconds) & np.isfinite(parts)
    if known.sum() < 3:
        return None
    s, p = seconds[known], parts[known]
    steps = np.diff(s)
    if (s != np.round(s)).any() or (p != np.round(p)).any() or p.min() < 0.0 or not (steps > 0.0).any():
        return None
    if (steps > 0.0).mean() > 0.5:
        # Seconds that go on in most rows need no parts.
        return None
    scale = next((one for one in reversed(_PARTS) if p.max() < one), None)
    if scale is None or p.max() < _SPLIT_STAMPS_MOST * scale or p.min() > _LEAST * scale:
        return None
    whole = seconds + parts / scale
    return np.asarray(whole) if is_clock(whole) and (np.diff(p) < 0.0).any() else None
