"""Streams of one recording on one time base: that of its fastest torques, others between their samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.recording import Recording, Stream
from excite.errors import LogError

# Streams that say how fast things happened, the more telling first.
_LEADING = ("tau", "i", "q", "q_cmd")


@dataclass(frozen=True, eq=False)
class Table:
    """One recording's channels on one time base.

    Attributes:
        name: of the recording.
        columns: ``(n,)`` each, by the contract's names, SI; ``time`` among them.
        notes: what was done, a sentence each.
    """

    name: str
    columns: dict[str, Array]
    notes: tuple[str, ...] = ()


def assemble_streams(recording: Recording, found: Guesses, rate_hz: float | None) -> Table:
    """Join a recording's streams.

    Args:
        recording: what was read.
        found: what its columns are.
        rate_hz: of streams without a clock; None where there is none.

    Raises:
        LogError: a column is missing in this recording, or its streams do not overlap.
    """
    clocks = {item.source: item for item in found.mapped if item.target == "time"}
    parts: list[tuple[Stream, Array, list[Mapped]]] = []
    wanted = {item.source: item for item in found.mapped if item.target != "time"}
    seen: set[str] = set()
    for stream in recording.streams:
        items = [wanted[c.name] for c in stream.columns if c.name in wanted]
        if items:
            parts.append((stream, _stream_times(stream, clocks, rate_hz), items))
            seen |= {item.source for item in items}
    missing = [name for name in wanted if name not in seen]
    if missing:
        raise LogError(
            f"lacks the columns {', '.join(missing[:4])}, which the first recording has",
            source=recording.source,
            remedy="convert it on its own, or leave it out",
        )
    if len(parts) == 1:
        stream, time, items = parts[0]
        return Table(recording.name, {"time": time} | _stream_channels(stream, items))
    return _join_tables(recording, parts)


def _stream_times(stream: Stream, clocks: dict[str, Mapped], rate_hz: float | None) -> Array:
    for column in stream.columns:
        if column.name in clocks:
            return np.asarray(column.values * clocks[column.name].factor)
    if stream.time is not None:
        return stream.time
    return np.arange(stream.n_rows) / (rate_hz or 1.0)


def _stream_channels(stream: Stream, items: list[Mapped]) -> dict[str, Array]:
    columns = {column.name: column.values for column in stream.columns}
    return {item.target: _in_si(columns[item.source], item) for item in items}


def _in_si(values: Array, item: Mapped) -> Array:
    """A column by its factor and offset; the same numbers, not copied, where nothing is to do."""
    if item.factor != 1.0:
        values = values * item.factor
    return values + item.offset if item.offset else values


def _join_tables(recording: Recording, parts: list[tuple[Stream, Array, list[Mapped]]]) -> Table:
    def rank(part: tuple[Stream, Array, list[Mapped]]) -> tuple[int, float]:
        channels = {item.channel for item in part[2]}
        leading = next((k for k, name in enumerate(_LEADING) if name in channels), len(_LEADING))
        return min(leading, 1), -len(part[1]) / max(float(np.ptp(part[1])), 1e-9)

    parts = sorted(parts, key=rank)
    base, time, items = parts[0]
    start, end = max(t.min() for _, t, _ in parts), min(t.max() for _, t, _ in parts)
    inside = (time >= start) & (time <= end)
    if inside.sum() < 10:
        raise LogError(
            f"has streams that do not overlap in time ({base.name} and others)",
            source=recording.source,
            remedy="check their clocks; map the time column of each under columns",
        )
    kept = slice(None) if inside.all() else inside
    columns = {"time": time[kept]}
    columns |= {name: values[kept] for name, values in _stream_channels(base, items).items()}
    for stream, own, others in parts[1:]:
        order = np.argsort(own, kind="stable")
        for name, values in _stream_channels(stream, others).items():
            whole = order[np.isfinite(values[order])]
            if name not in columns and len(whole):
                columns[name] = np.interp(time[inside], own[whole], values[whole])
    rates = ", ".join(f"{s.name} at {len(t) / max(float(np.ptp(t)), 1e-9):.0f} Hz" for s, t, _ in parts)
    note = f"joined on the times of {base.name}, other streams between their samples ({rates})"
    return Table(recording.name, columns, (note,))
