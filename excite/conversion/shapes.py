"""Shapes of tables other than a row a sample and a column a channel, brought to that one."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, is_whole
from excite.conversion.columns.clock import FEWEST_ROWS, Table, find_restarts, is_clock
from excite.conversion.recording import Column, Recording, Stream, nothing_there
from excite.conversion.sources.unitree import name_motors_of_tables
from excite.errors import LogError
from excite.finding import first_names

# More names than a humanoid with hands has joints are no names of joints; texts of a row each are more.
_MOST = 100
_ARRAY = re.compile(r"\s*(?:(?:np\.|torch\.)?(?:array|tensor)\()?\s*[\[(]")
# Not the 64 of np.float64(0.5), as numpy writes the numbers of a list.
_NUMBER = re.compile(r"(?<![A-Za-z\d.])[+-]?(?:\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?|nan|inf)")
_NUMBERED = re.compile(r"(.*?)[\[_.]?(\d+)\]?$")
_OF_JOINTS = frozenset("joint joints motor motors axis actuator servo dof".split())
_OF_TRIALS = frozenset(
    "episode episodes ep trial trials run runs demo rollout traj trajectory experiment exp test recording "
    "take session sequence motion segment repetition rep versuch essai".split()
)
_BESIDE = frozenset("index idx id nr no num number name label".split())


def reshape_recording(recording: Recording) -> list[Recording]:
    """The recording with a column a number, names of joints and one clock; one for each trial in it.

    Raises:
        LogError: it holds words only, or rows of one joint each.
    """
    streams, notes = list(recording.streams), list(recording.notes)
    for stream in streams:
        _refuse_shape(stream, recording.source)
    for change in (_unpack_cells, _apply_labels, _join_stamps, _leave_out_empty):
        changed = [change(stream) for stream in streams]
        streams = [stream for stream, _ in changed]
        notes += [note for _, note in changed if note]
    if not any(stream.columns for stream in streams):
        raise nothing_there(recording.source)
    streams, said = name_motors_of_tables(streams)
    whole = {**recording.said, **said}
    return _by_episode(
        replace(recording, streams=tuple(streams), said=whole, notes=tuple(dict.fromkeys(notes)))
    )


def _unpack_cells(stream: Stream) -> tuple[Stream, str]:
    """The stream with ``NAME[0] … NAME[k-1]`` for a column whose cells hold ``k`` numbers each.

    Cells that hold words, as names of joints, are words of ``NAME[0]`` and so on.
    """
    columns, words, done = list(stream.columns), dict(stream.words), []
    for name, cells in stream.words.items():
        first = next((str(cell) for cell in cells if cell), "")
        if not _ARRAY.match(first):
            continue
        if quoted := re.findall(r"""["']([^"']+)["']""", first):
            del words[name]
            same = all(cell == cells[0] for cell in cells)
            words |= {
                f"{name}[{k}]": np.full(len(cells), one, object) for k, one in enumerate(quoted) if same
            }
            continue
        found = [_NUMBER.findall(str(cell)) for cell in cells]
        width = len(_NUMBER.findall(first))
        # Rows that a killed logger leaves incomplete are few.
        if width and np.mean([len(numbers) == width for numbers in found]) >= 0.95:
            table = np.array([one if len(one) == width else [np.nan] * width for one in found], float)
            columns += [Column(f"{name}[{k}]", table[:, k]) for k in range(width)]
            del words[name]
            done.append(name)
    note = f"cells of {', '.join(done)} hold arrays, a column each here" if done else ""
    return replace(stream, columns=tuple(columns), words=words), note


def _refuse_shape(stream: Stream, source: str) -> None:
    """Raise LogError for rows that are of one joint each."""
    counts = {column.name: column.values for column in stream.columns if _is_count(column.values)}
    for name, cells in {**counts, **stream.words}.items():
        if _is_called(name, _OF_JOINTS | _BESIDE) and _is_called(name, _OF_JOINTS, some=True):
            if 1 < len(set(cells.tolist())) <= _MOST and (cells[1:] != cells[:-1]).mean() > 0.5:
                remedy = "write a row a sample and a column a joint (pandas: pivot by time and this column)"
                raise LogError("says whose joint each row is", source=source, field=name, remedy=remedy)


def _apply_labels(stream: Stream) -> tuple[Stream, str]:
    """The stream with labels on its numbered columns where other columns name as many joints, the same in every row."""
    names: dict[str, list[str]] = {}
    for name, cells in stream.words.items():
        if cells[0] and (cells == cells[0]).all():
            names.setdefault(_stem(name), []).append(str(cells[0]))
    return with_labels(stream, names), ""


def _join_stamps(stream: Stream) -> tuple[Stream, str]:
    """The stream with one clock for every pair of columns that are whole seconds and parts of them."""
    columns: list[Column] = []
    done = []
    for column in stream.columns:
        before = columns[-1] if columns and stream.time is None and not columns[-1].channel else None
        whole = None if before is None else _whole_stamps(before.values, column.values)
        if before is None or whole is None:
            columns.append(column)
            continue
        columns[-1] = Column(f"{before.name}+{column.name}", whole, channel="time", unit="s")
        done.append(columns[-1].name)
    note = f"{', '.join(done)}: seconds and parts of a second are one time" if done else ""
    return replace(stream, columns=tuple(columns)), note


def _whole_stamps(seconds: Array, parts: Array) -> Array | None:
    """Seconds with their parts; None where these columns are no such pair.

    Seconds that go on in most rows need no parts; of a recording of some seconds the parts come near both ends of one.
    """
    known = np.isfinite(seconds) & np.isfinite(parts)
    s, p = seconds[known], parts[known]
    if (
        len(s) < 3
        or not (_is_count(s) and _is_count(p))
        or p.min() < 0.0
        or not 0.0 < (np.diff(s) > 0.0).mean() <= 0.5
    ):
        return None
    scale = next((one for one in (1e3, 1e6, 1e9) if p.max() < one), np.inf)
    if p.max() < 0.8 * scale or p.min() > 0.2 * scale or not (np.diff(p) < 0.0).any():
        return None
    whole = np.asarray(seconds + parts / scale)
    return whole if is_clock(whole) else None


def _leave_out_empty(stream: Stream) -> tuple[Stream, str]:
    """Without columns in which no row has a number."""
    kept = [np.isfinite(column.values).any() for column in stream.columns]
    if all(kept):
        return stream, ""
    empty = [column.name for column, some in zip(stream.columns, kept, strict=True) if not some]
    columns = tuple(column for column, some in zip(stream.columns, kept, strict=True) if some)
    return replace(stream, columns=columns), f"no row has a number in {first_names(empty, 3)}: left out"


def _by_episode(recording: Recording) -> list[Recording]:
    """A recording for each stretch of rows with one value of a column such as ``episode`` or ``trial_id``."""
    stream = recording.streams[0]
    keys: dict[str, NDArray[Any]] = {c.name: c.values for c in stream.columns if _is_count(c.values)} | dict(
        stream.words
    )
    for name, cells in keys.items() if len(recording.streams) == 1 else ():
        if not _is_called(name, _OF_TRIALS | _BESIDE) or not _is_called(name, _OF_TRIALS, some=True):
            continue
        edges = [0, *(np.flatnonzero(cells[1:] != cells[:-1]) + 1).tolist(), len(cells)]
        if len(edges) < 3 or np.median(np.diff(edges)) < FEWEST_ROWS:
            continue
        rest = replace(
            stream,
            columns=tuple(column for column in stream.columns if column.name != name),
            words={key: words for key, words in stream.words.items() if key != name},
        )
        word = "_".join(w for w in re.findall(r"[a-z]+", name.lower()) if w not in _BESIDE)
        notes = (*recording.notes, f"{name} tells {len(edges) - 1} trials apart")
        labels = {
            start: re.sub(r"[^A-Za-z0-9_.+-]+", "_", cells[start])
            if isinstance(cells[start], str)
            else f"{word}{float(cells[start]):g}"
            for start in edges[:-1]
        }
        return [
            replace(
                recording,
                name=f"{recording.name}_{labels[start]}",
                streams=(rest.rows(slice(start, end)),),
                notes=notes,
            )
            for start, end in itertools.pairwise(edges)
            if end - start >= FEWEST_ROWS
        ]
    return [recording]


def _is_called(name: str, words: frozenset[str], *, some: bool = False) -> bool:
    """Whether a name has nothing but some words, or one of them."""
    said = set(re.findall(r"[a-z]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower()))
    return bool(said & words) and (some or said <= words)


def _is_count(values: Array) -> bool:
    return bool(np.isfinite(values).all()) and is_whole(values)


def _stem(name: str) -> str:
    match = _NUMBERED.match(name)
    return match[1] if match else name


def stream_of_arrays(name: str, arrays: Mapping[str, Any]) -> list[Stream]:
    """Arrays as streams: those of one length together, ``(n, k)`` taken apart into ``NAME[0] … NAME[k-1]``.

    Lists of ``k`` words name the columns of arrays that are ``k`` wide, a word for every row is a text of that row.
    Arrays of three axes or more are left out, but for those of one row a sample.
    """
    lengths: dict[int, list[Column]] = {}
    words: dict[int, dict[str, NDArray[np.object_]]] = {}
    tables = {key: np.asarray(values) for key, values in arrays.items()}
    arrays = _in_one_order(
        {
            key: np.char.decode(table, "utf-8", "replace") if table.dtype.kind == "S" else table
            for key, table in tables.items()
        }
    )
    for key, values in arrays.items():
        array = np.squeeze(values)
        if array.dtype.kind in "UO" and array.ndim == 1 and len(array) > _MOST:
            words.setdefault(len(array), {})[key] = array.astype(object)
        if array.dtype.kind not in "fiub" or array.ndim not in (1, 2) or not array.size:
            continue
        array = (array.T if array.ndim == 2 and array.shape[0] < array.shape[1] else array).astype(float)
        found = lengths.setdefault(len(array), [])
        if array.ndim == 1:
            found.append(Column(key, array))
        else:
            found += [Column(f"{key}[{k}]", array[:, k]) for k in range(array.shape[1])]
    names = {key: _word_list(values) for key, values in arrays.items()}
    return [
        with_labels(Stream(name, tuple(columns), words=words.get(n, {})), names)
        for n, columns in lengths.items()
    ]


def longest_streams(streams: Iterable[Stream]) -> tuple[Stream, ...]:
    """Streams that may be signals: not those with a hundredth of the longest one's rows, which are constants."""
    kept = list(streams)
    most = max((stream.n_rows for stream in kept), default=0)
    return tuple(stream for stream in kept if stream.n_rows >= max(3, most // 100))


def with_labels(stream: Stream, names: Mapping[str, Sequence[str]]) -> Stream:
    """The stream with the names of a list on the columns ``NAME[0] … NAME[k-1]`` of each array as long as the list.

    Args:
        names: lists of names, by what the recording calls them.
    """
    lists = {key: list(words) for key, words in names.items() if 1 < len(set(words)) == len(words) <= _MOST}
    stems = [_stem(column.name) for column in stream.columns] if lists else []
    found = list(stream.columns)
    for k, stem in enumerate(stems):
        column = found[k]
        fitting = [key for key, words in lists.items() if len(words) == stems.count(stem)]
        if fitting and not column.label and stem != column.name:
            best = max(
                fitting, key=lambda key: (_shared_depth(key, stream.columns[k].name), "joint" in key.lower())
            )
            found[k] = replace(column, label=lists[best][stems[:k].count(stem)])
    return replace(stream, columns=tuple(found))


def _shared_depth(a: str, b: str) -> int:
    """Folders that two paths have in common."""
    return sum(one == other for one, other in zip(a.split("/")[:-1], b.split("/")[:-1], strict=False))


def _word_list(array: NDArray[Any]) -> list[str]:
    """A list of words; a table of words whose rows are all the same is one, too."""
    if array.dtype.kind == "U" and array.ndim == 2 and len(array) and (array == array[0]).all():
        array = array[0]
    return [str(word).strip() for word in array] if array.dtype.kind == "U" and array.ndim == 1 else []


def _in_one_order(arrays: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays, those as wide as a table of words beside them in the order of its first row throughout.

    Messages of joint states name their joints anew each time, and some drivers in another order each time.
    """
    done = dict(arrays)
    for key, words in arrays.items():
        if words.dtype.kind != "U" or words.ndim != 2 or not len(words) or (words == words[0]).all():
            continue
        sorted_words, place = np.sort(words, axis=1), np.argsort(words, axis=1)
        if (sorted_words != sorted_words[0]).any() or len(set(words[0])) < words.shape[1]:
            continue
        back = place[:, np.argsort(place[0])]
        for name, other in arrays.items():
            if other.shape == words.shape and name.rpartition("/")[0] == key.rpartition("/")[0]:
                done[name] = np.take_along_axis(other, back, axis=1)
    return done


# A clock that started anew within a recording, and rows that were written out of order.


def in_runs(table: Table) -> list[Table]:
    """The table in the order of its times, one for each run of its clock."""
    if (np.diff(table.columns["time"]) >= 0.0).all():
        # An hour of a humanoid is not held twice.
        return [table]
    known = np.isfinite(table.columns["time"])
    columns = {name: values[known] for name, values in table.columns.items()}
    time = columns["time"]
    edges = [0, *find_restarts(time).tolist(), len(time)]
    several = len(edges) > 2
    found = []
    for k, (start, end) in enumerate(itertools.pairwise(edges)):
        late = int((np.diff(time[start:end]) < 0.0).sum())
        order = start + np.argsort(time[start:end], kind="stable")
        notes = [
            f"its clock starts anew {len(edges) - 2} times: each run is a recording of its own"
        ] * several
        notes += [f"{late} rows stood after later ones: sorted by their times"] if late else []
        name = f"{table.name}_run{k + 1}" if several else table.name
        run = {key: values[order] for key, values in columns.items()}
        found.append(replace(table, name=name, columns=run, notes=(*table.notes, *notes)))
    return found
