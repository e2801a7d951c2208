"""Several trials in one table, told apart by a column."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.conversion.recording import Column, Recording, Stream

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
