"""Shapes of tables other than a row a sample and a column a channel, brought to that one."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.columns.clock import Table, find_restarts
from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Column, Recording, Stream

# Arrays by name as streams: those of one length together, with the names of joints that lists beside them
# hold.

# Texts of a row each are as many as a recording has rows, which are more than a robot has joints.
_MOST_LABELS = 100


def stream_of_arrays(name: str, arrays: Mapping[str, Any], time: Array | None = None) -> list[Stream]:
    """Arrays as streams: those of one length together, ``(n, k)`` taken apart into ``NAME[0] … NAME[k-1]``.

    Lists of ``k`` words name the columns of arrays that are ``k`` wide, a word for every row is a text of that row.
    Arrays of three axes or more are left out, but for those of one row a sample.
    """
    arrays = in_one_order(arrays)
    lengths: dict[int, list[Column]] = {}
    words: dict[int, dict[str, NDArray[np.object_]]] = {}
    for key, values in arrays.items():
        array = np.squeeze(np.asarray(values))
        if array.dtype.kind in "SUO" and array.ndim == 1 and len(array) > _MOST_LABELS:
            texts = np.char.decode(array, "utf-8", "replace") if array.dtype.kind == "S" else array
            words.setdefault(len(array), {})[key] = texts.astype(object)
        if array.dtype.kind == "b":
            array = array.astype(float)
        if array.dtype.kind not in "fiu" or array.ndim not in (1, 2) or not array.size:
            continue
        if array.ndim == 2 and array.shape[0] < array.shape[1]:
            array = array.T
        columns = (
            [(key, array)]
            if array.ndim == 1
            else [(f"{key}[{k}]", array[:, k]) for k in range(array.shape[1])]
        )
        found = lengths.setdefault(len(array), [])
        found += [Column(label, np.asarray(column, dtype=float)) for label, column in columns]
    names = word_lists(arrays)
    _with_one_row_less(lengths)
    return [
        with_labels(
            Stream(
                name,
                tuple(columns),
                time if time is not None and len(time) == n else None,
                words=words.get(n, {}),
            ),
            names,
        )
        for n, columns in lengths.items()
    ]


def _with_one_row_less(lengths: dict[int, list[Column]]) -> None:
    """Arrays of one row less stand with those that have it, the last row not known.

    Optimal control has a control between two states: xs of 101 rows, us of 100.
    """
    for n in sorted(lengths, reverse=True):
        fewer = lengths.get(n - 1)
        if fewer is None or n not in lengths or n <= _MOST_LABELS:
            continue
        if any(read_clue(column.name, ()).quantity == "time" for column in fewer):
            continue
        lengths[n] += [replace(column, values=np.append(column.values, np.nan)) for column in fewer]
        del lengths[n - 1]


def split_batches(arrays: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Arrays of each trial, where arrays of three axes hold trials, samples and joints; empty where there are none."""
    stacked = {key: np.asarray(values) for key, values in arrays.items() if np.ndim(values) == 3}
    stacked = {
        key: values for key, values in stacked.items() if values.dtype.kind == "f" and 1 not in values.shape
    }
    shapes = {values.shape[:2] for values in stacked.values()}
    if len(shapes) != 1:
        return {}
    ((count, rows),) = shapes
    # Images have their rows and columns behind the samples, of which there are more than of trials.
    if count > rows or any(len(values) == rows for key, values in arrays.items() if np.ndim(values) == 2):
        return {}
    return {
        f"trial_{k}": {
            key: np.asarray(values)[k] if np.shape(values)[:2] == (count, rows) else values
            for key, values in arrays.items()
        }
        for k in range(count)
    }


def longest_streams(streams: Iterable[Stream]) -> tuple[Stream, ...]:
    """Streams that may be signals: not those with a hundredth of the longest one's rows, which are constants."""
    kept = list(streams)
    most = max((stream.n_rows for stream in kept), default=0)
    return tuple(stream for stream in kept if stream.n_rows >= max(3, most // 100))


# Names of joints that stand beside their numbers: in a list of names, or in columns that hold the same word
# always.

# More names than a humanoid with hands has joints are no names of joints.
_MOST = 100
_NUMBERED = re.compile(r"(.*?)[\[_.]?(\d+)\]?$")
# What a JointState holds behind its names, in this order.
_OF_JOINT_STATE = ("position", "velocity", "effort")


def apply_labels(stream: Stream) -> tuple[Stream, str]:
    """The stream with labels on its numbered columns where other columns name as many joints, and a note."""
    constant = {
        name: str(cells[0]) for name, cells in stream.words.items() if cells[0] and (cells == cells[0]).all()
    }
    if len(constant) < 2:
        return stream, ""
    if stream.nameless:
        return _joint_states(stream, constant)
    names: dict[str, list[str]] = {}
    for name, word in constant.items():
        names.setdefault(_name_stem(name), []).append(word)
    return with_labels(stream, names), ""


def with_labels(stream: Stream, names: Mapping[str, Sequence[str]]) -> Stream:
    """The stream with the names of a list on the columns ``NAME[0] … NAME[k-1]`` of each array as long as the list.

    Args:
        stream: any.
        names: lists of names, by what the recording calls them.
    """
    lists = {key: list(words) for key, words in names.items() if 1 < len(set(words)) == len(words) <= _MOST}
    if not lists:
        return stream
    stems = [_name_stem(column.name) for column in stream.columns]
    found = []
    for k, column in enumerate(stream.columns):
        width = stems.count(stems[k])
        fitting = [key for key, words in lists.items() if len(words) == width]
        if column.label or not fitting or stems[k] == column.name:
            found.append(column)
            continue
        best = max(fitting, key=lambda key: (_shared_depth(key, column.name), "joint" in key.lower()))
        found.append(replace(column, label=lists[best][stems[:k].count(stems[k])]))
    return replace(stream, columns=tuple(found))


def word_lists(arrays: Mapping[str, Any]) -> dict[str, list[str]]:
    """Lists of words among arrays; a table of words whose rows are all the same is one list."""
    found = {}
    for key, values in arrays.items():
        array = np.asarray(values)
        if array.dtype.kind == "S":
            array = np.char.decode(array, "utf-8", "replace")
        if array.dtype.kind == "U" and array.ndim == 2 and len(array) and (array == array[0]).all():
            array = array[0]
        if array.dtype.kind == "U" and array.ndim == 1 and 1 < len(array) <= _MOST:
            found[key] = [str(word).strip() for word in array]
    return found


def in_one_order(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The arrays, those as wide as a table of words beside them in the order of its first row throughout.

    Messages of joint states name their joints anew each time, and some drivers in another order each time.
    """
    done = dict(arrays)
    for key, values in arrays.items():
        words = np.asarray(values)
        if words.dtype.kind != "U" or words.ndim != 2 or not len(words) or (words == words[0]).all():
            continue
        sorted_words, place = np.sort(words, axis=1), np.argsort(words, axis=1)
        if (sorted_words != sorted_words[0]).any() or len(set(words[0])) < words.shape[1]:
            continue
        back = place[:, np.argsort(place[0])]
        for name, other in arrays.items():
            if np.shape(other) == words.shape and (name.rpartition("/")[0] == key.rpartition("/")[0]):
                done[name] = np.take_along_axis(np.asarray(other), back, axis=1)
    return done


def _joint_states(stream: Stream, constant: Mapping[str, str]) -> tuple[Stream, str]:
    """Messages of joint states, printed in lines without names: stamp, names, positions, velocities, efforts."""
    place = {name: int(match[2]) for name in constant if (match := _NUMBERED.match(name))}
    order = sorted(place, key=lambda name: place[name])
    words = [constant[name] for name in order]
    behind = [c for c in stream.columns if (m := _NUMBERED.match(c.name)) and int(m[2]) > place[order[-1]]]
    behind = [column for column in behind if np.isfinite(column.values).any()]
    if len(set(words)) < len(words) or len(behind) not in {k * len(words) for k in (1, 2, 3)}:
        return stream, ""
    named = {
        column.name: replace(
            column,
            name=f"{_OF_JOINT_STATE[k // len(words)]}.{words[k % len(words)]}",
            label=words[k % len(words)],
        )
        for k, column in enumerate(behind)
    }
    columns = tuple(named.get(column.name, column) for column in stream.columns)
    note = "lines hold names and as many numbers: read as joint states (position, velocity, effort)"
    return replace(stream, columns=columns), note


def _name_stem(name: str) -> str:
    match = _NUMBERED.match(name)
    return match[1] if match else name


def _shared_depth(a: str, b: str) -> int:
    """Folders that two paths have in common."""
    pairs = zip(a.split("/")[:-1], b.split("/")[:-1], strict=False)
    return sum(1 for one, other in pairs if one == other)


# A clock that started anew within a recording, and rows that were written out of order.


def in_runs(table: Table) -> list[Table]:
    """The table in the order of its times, one for each run of its clock."""
    time = table.columns["time"]
    if (np.diff(time) >= 0.0).all():
        # An hour of a humanoid is not held twice.
        return [table]
    known = np.isfinite(time)
    columns = {name: values[known] for name, values in table.columns.items()}
    time = columns["time"]
    edges = [0, *find_restarts(time).tolist(), len(time)]
    if len(edges) == 2:
        return [_in_order(table, time, columns, slice(None), table.name, ())]
    note = f"its clock starts anew {len(edges) - 2} times: each run is a recording of its own"
    return [
        _in_order(table, time, columns, slice(start, end), f"{table.name}_run{k + 1}", (note,))
        for k, (start, end) in enumerate(itertools.pairwise(edges))
    ]


def _in_order(
    table: Table, time: Array, columns: dict[str, Array], rows: slice, name: str, notes: tuple[str, ...]
) -> Table:
    late = int((np.diff(time[rows]) < 0.0).sum())
    order = np.argsort(time[rows], kind="stable") if late else slice(None)
    if late:
        notes = (*notes, f"{late} rows stood after later ones: sorted by their times")
    found = {key: values[rows][order] for key, values in columns.items()}
    return replace(table, name=name, columns=found, notes=(*table.notes, *notes))


# Several trials in one table, told apart by a column.

_WORDS = frozenset(
    "episode episodes ep trial trials run runs demo rollout traj trajectory experiment exp test recording "
    "take session sequence motion segment repetition rep versuch essai".split()
)
_BESIDE = frozenset("index idx id nr no num number name label".split())
# A trial has more rows than this, or the column counts something else.
FEWEST_ROWS = 20


def by_episode(recording: Recording) -> list[Recording]:
    """A recording for each stretch of rows with one value of a column such as ``episode`` or ``trial_id``."""
    if len(recording.streams) != 1:
        return [recording]
    (stream,) = recording.streams
    for name, cells in _key_columns(stream).items():
        starts = np.flatnonzero(cells[1:] != cells[:-1]) + 1
        ends = [*starts.tolist(), len(cells)]
        lengths = np.diff([0, *ends])
        if not len(starts) or np.median(lengths) < FEWEST_ROWS:
            continue
        note = f"{name} tells {len(ends)} trials apart"
        found = []
        for start, end in zip([0, *starts.tolist()], ends, strict=True):
            if end - start < FEWEST_ROWS:
                continue
            part = _drop_column(stream, name).rows(slice(start, end))
            label = f"{recording.name}_{_episode_label(name, cells[start])}"
            found.append(replace(recording, name=label, streams=(part,), notes=(*recording.notes, note)))
        return found
    return [recording]


def _key_columns(stream: Stream) -> dict[str, NDArray[np.object_]]:
    numbers = {
        c.name: np.asarray(c.values, object) for c in stream.columns if _is_key(c.name) and _is_counting(c)
    }
    return numbers | {name: cells for name, cells in stream.words.items() if _is_key(name)}


def _is_key(name: str) -> bool:
    words = re.findall(r"[a-z]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower())
    return bool(set(words) & _WORDS) and set(words) <= _WORDS | _BESIDE


def _is_counting(column: Column) -> bool:
    return bool(np.isfinite(column.values).all() and (column.values == np.round(column.values)).all())


def _episode_label(name: str, value: object) -> str:
    if isinstance(value, str):
        return re.sub(r"[^A-Za-z0-9_.+-]+", "_", value)
    words: Sequence[str] = [w for w in re.findall(r"[a-z]+", name.lower()) if w not in _BESIDE]
    return f"{'_'.join(words)}{float(str(value)):g}"


def _drop_column(stream: Stream, name: str) -> Stream:
    return replace(
        stream,
        columns=tuple(column for column in stream.columns if column.name != name),
        words={key: cells for key, cells in stream.words.items() if key != name},
    )
