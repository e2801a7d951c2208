"""The time column and its unit, and streams of one recording on one time base."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.columns.units import derivative_of
from excite.conversion.columns.vocabulary import OF_WORD
from excite.conversion.columns.words import Clue
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.recording import Recording, Stream
from excite.errors import LogError
from excite.logs.units import TICKS

# Which column is the time, and in which unit.

# Days that spreadsheets and MATLAB count (from 1900 and from the year 0): dates of 1954 to 2119 are numbers from here
# to there. Steps of rows in days are those of no other unit.
_SERIAL_DATES = ((20_000.0, 80_000.0), (714_000.0, 774_000.0))
# Rates that robots are recorded at [Hz]. Three powers of ten lie between units, so that at most two of them fit.
SLOWEST_HZ, FASTEST_HZ = 4.0, 20_000.0
# Share of intervals that have to be positive: loggers repeat stamps, and write some rows out of order.
_FORWARD = 0.9
# A step back by more rows than this is a clock that was set anew; buffers that mix rows hold fewer.
_RESET_ROWS = 50.0
# A run has more rows than this; of more late rows the order is not known.
_FEWEST_ROWS, _LATE = 20, 0.4
# Velocities are slopes where they are so alike, and of one rate where they differ by less.
_SLOPE, _ONE_RATE = 0.95, 0.1
# Steps longer than this many usual ones are pauses.
_PAUSE = 5.0


def is_clock(values: Array) -> bool:
    """Whether a column's numbers go forward evenly enough to be times."""
    values = values[np.isfinite(values)]
    if len(values) < 3:
        return False
    steps = np.diff(values)
    forward = steps[steps > 0.0]
    if len(forward) < 0.3 * len(steps) or (steps >= 0.0).mean() < _FORWARD:
        return False
    # A joint that turns one way goes forward too, but not at one pace from the first sample to the last.
    middle = np.median(forward)
    return bool(np.percentile(forward, 25) > 0.3 * middle and np.percentile(forward, 75) < 3.0 * middle)


def find_restarts(values: Array) -> NDArray[np.int64]:
    """Rows in which a clock begins anew; rows out of order step back by less."""
    steps = np.diff(values)
    forward = steps[steps > 0.0]
    if not len(forward):
        return np.zeros(0, dtype=np.int64)
    return np.asarray(np.flatnonzero(steps < -_RESET_ROWS * np.median(forward)) + 1, dtype=np.int64)


def _is_clock_of_runs(values: Array) -> bool:
    """Whether numbers are times of several runs, or of rows that do not stand in their order."""
    values = values[np.isfinite(values)]
    edges = [0, *find_restarts(values).tolist(), len(values)]
    if len(values) < _FEWEST_ROWS * (len(edges) - 1) or (np.diff(values) < 0.0).mean() > _LATE:
        return False
    return all(is_clock(np.sort(values[a:b])) for a, b in itertools.pairwise(edges))


def clock_column(stream: Stream, clues: dict[str, Clue]) -> tuple[str, str] | None:
    """The column that holds a stream's times, and why; None where there is none."""
    named = [c for c in stream.columns if clues[c.name].quantity == "time" and is_clock(c.values)]
    if named:
        # Of several clocks the one of the machine itself, which comes first, unless another one is finer.
        best = max(named, key=lambda c: len(np.unique(c.values)))
        return best.name, "its name, and it goes forward evenly"
    for column in stream.columns:
        if clues[column.name].quantity == "time" and _is_clock_of_runs(column.values):
            return column.name, "its name, and it goes forward evenly within its runs"
    for column in stream.columns:
        said = clues[column.name]
        if _counts_rows(column.values):
            # A counter of rows, whatever it is called: how fast it counts is not in it.
            continue
        # state[0] is a position by its number alone.
        numbered = said.number is not None and any(OF_WORD.get(word) for word in said.stem.split("_"))
        if said.quantity in ("", "skip") or (
            said.quantity in ("q", "i", "a", "v") and not said.exact and not numbered
        ):
            if goes_evenly(column.values):
                return column.name, "it goes forward evenly from row to row, as no joint does"
    return None


def goes_evenly(values: Array) -> bool:
    """Whether a column's numbers go forward evenly from the first row to the last, as no joint's do."""
    return is_clock(values) and _is_steady(values)


def _counts_rows(values: Array) -> bool:
    """Whether numbers go up by one from row to row, but for rows that are missing."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(len(steps)) and bool((steps == np.round(steps)).all()) and float(np.median(steps)) == 1.0


def _is_steady(values: Array) -> bool:
    steps = np.diff(values[np.isfinite(values)])
    fit = np.polyfit(np.arange(len(values[np.isfinite(values)])), values[np.isfinite(values)], 1)
    rest = values[np.isfinite(values)] - np.polyval(fit, np.arange(len(steps) + 1))
    return bool(fit[0] > 0.0 and rest.std() < 0.05 * np.ptp(values[np.isfinite(values)]))


def clock_pace(values: Array, unit: str, rate: float | None) -> tuple[float | None, str]:
    """Seconds per unit of a clock, and why; None where it cannot be told.

    Args:
        values: the times as they stand in the file.
        unit: that name or header state; empty for none.
        rate: rows a second that the recording states [Hz]; None for none.
    """
    if rate and not unit and _counts_rows(values):
        # A count, whatever it is called: how fast it goes is what the recording states.
        return 1.0 / rate, f"it counts rows, of which the recording states {rate:.4g} a second"
    return clock_tick(values, unit)


def clock_tick(values: Array, stated: str) -> tuple[float | None, str]:
    """Seconds per unit of a clock, and why; None where it cannot be told.

    Args:
        values: the times as they stand in the file.
        stated: the unit that name or header state; empty for none.
    """
    steps = np.diff(values[np.isfinite(values)])
    step = float(np.median(steps[steps > 0.0]))
    possible = [unit for unit, tick in TICKS.items() if SLOWEST_HZ <= 1.0 / (step * tick) <= FASTEST_HZ]
    if possible == ["d"] and stated != "d" and not _is_serial_date(values):
        possible = []
    if stated in TICKS and (stated in possible or not possible):
        return TICKS[stated], f"{stated} by its name: {1.0 / (step * TICKS[stated]):.4g} Hz"
    if not possible:
        return None, f"rows are {step:.4g} apart"
    if stated in TICKS:
        return TICKS[possible[0]], (
            f"{possible[0]}, though its name says {stated}: that would be {1.0 / (step * TICKS[stated]):.3g} Hz"
        )
    unit = possible[0]
    return TICKS[unit], f"{unit}: rows are {step:.4g} apart, {1.0 / (step * TICKS[unit]):.4g} Hz"


def _is_serial_date(values: Array) -> bool:
    first = float(values[np.isfinite(values)][0])
    return any(low < first < high for low, high in _SERIAL_DATES)


def row_seconds(time: Array) -> float | None:
    """Time from row to row ``(n,)`` [s]; None where time stands still."""
    steps = np.diff(time)
    if not (steps > 0.0).any():
        return None
    pace = float(np.median(steps[steps > 0.0]))
    # Stamps of few digits stand several times: what counts is how they go on over many rows, pauses left out.
    going = steps[(steps >= 0.0) & (steps < _PAUSE * pace)]
    return float(going.mean()) if (going == 0.0).any() else pace


def rate_by_velocities(positions: Array, velocities: Array) -> float | None:
    """Rows a second of which velocities are the positions' slopes; None where most of them are not, or not of one.

    Args:
        positions: ``(n, m)``, of the joints.
        velocities: ``(n, m)``, the same angles or lengths a second.
    """
    if len(positions) < _FEWEST_ROWS:
        return None
    slopes = [derivative_of(q, v, 1.0) for q, v in zip(positions.T, velocities.T, strict=True)]
    # What is regressed on the slope, as encoders have less noise than the velocities of drives.
    rates = np.array([alike**2 / slope for slope, alike in slopes if slope > 0.0 and alike > _SLOPE])
    if 2 * len(rates) <= len(slopes):
        return None
    rate = float(np.median(rates))
    same = np.abs(rates / rate - 1.0).max() < _ONE_RATE
    return rate if same and SLOWEST_HZ <= rate <= FASTEST_HZ else None


# Streams of one recording on one time base: that of its fastest torques, others between their samples.

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
