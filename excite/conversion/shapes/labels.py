"""Names of joints that stand beside their numbers: in a list of names, or in columns that hold the same word always."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from excite.conversion.recording import Stream

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
