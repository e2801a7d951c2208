"""The time column and its unit, and streams of one recording on one time base."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array, Indices, is_whole
from excite.conversion.columns.units import derivative_of
from excite.conversion.columns.vocabulary import OF_WORD
from excite.conversion.columns.words import Clue
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.recording import Recording, Stream
from excite.errors import LogError
from excite.logs.units import TICKS

# Rates that robots are recorded at [Hz]. Three powers of ten lie between units, so that at most two of them fit.
SLOWEST_HZ, FASTEST_HZ = 4.0, 20_000.0
# Days that spreadsheets and MATLAB count (from 1900 and from the year 0): dates of 1954 to 2119 are numbers from here
# to there. Steps of rows in days are those of no other unit.
_SERIAL_DATES = ((20_000.0, 80_000.0), (714_000.0, 774_000.0))
# A run has more rows than this.
FEWEST_ROWS = 20


def is_clock(values: Array) -> bool:
    """Whether a column's numbers go forward evenly enough to be times.

    Loggers repeat stamps, and write some rows out of order. A joint that turns one way goes forward too, but not at one
    pace from the first sample to the last.
    """
    steps = np.diff(values[np.isfinite(values)])
    forward = steps[steps > 0.0]
    if len(steps) < 2 or len(forward) < 0.3 * len(steps) or (steps >= 0.0).mean() < 0.9:
        return False
    middle, quarters = np.median(forward), np.percentile(forward, (25, 75))
    return bool(quarters[0] > 0.3 * middle and quarters[1] < 3.0 * middle)


def goes_evenly(values: Array) -> bool:
    """Whether a column's numbers go forward evenly from the first row to the last, as no joint's do."""
    known = values[np.isfinite(values)]
    if not is_clock(known):
        return False
    rows = np.arange(len(known))
    fit = np.polyfit(rows, known, 1)
    return bool(fit[0] > 0.0 and (known - np.polyval(fit, rows)).std() < 0.05 * np.ptp(known))


def find_restarts(values: Array) -> Indices:
    """Rows in which a clock begins anew: it steps back by more rows than buffers hold that mix them."""
    steps = np.diff(values)
    forward = steps[steps > 0.0]
    least = 50.0 * np.median(forward) if len(forward) else np.inf
    return np.asarray(np.flatnonzero(steps < -least) + 1, dtype=np.int64)


def _is_clock_of_runs(values: Array) -> bool:
    """Whether numbers are times of several runs, or of rows that do not stand in their order."""
    values = values[np.isfinite(values)]
    edges = [0, *find_restarts(values).tolist(), len(values)]
    if len(values) < FEWEST_ROWS * (len(edges) - 1) or (np.diff(values) < 0.0).mean() > 0.4:
        return False
    return all(is_clock(np.sort(values[start:end])) for start, end in itertools.pairwise(edges))


def clock_column(stream: Stream, clues: Mapping[str, Clue]) -> tuple[str, str] | None:
    """The column that holds a stream's times, and why; None where there is none."""
    named = [column for column in stream.columns if clues[column.name].quantity == "time"]
    even = [column for column in named if is_clock(column.values)]
    if even:
        # Of several clocks the one of the machine itself, which comes first, unless another one is finer.
        best = max(even, key=lambda column: len(np.unique(column.values)))
        return best.name, "its name, and it goes forward evenly"
    for column in named:
        if _is_clock_of_runs(column.values):
            return column.name, "its name, and it goes forward evenly within its runs"
    for column in stream.columns:
        said = clues[column.name]
        # state[0] is a position by its number alone.
        numbered = said.number is not None and any(OF_WORD.get(word) for word in said.stem.split("_"))
        maybe = said.quantity in ("q", "i", "a", "v") and not said.exact and not numbered
        # A counter of rows, whatever it is called, is none: how fast it counts is not in it.
        if (
            (maybe or said.quantity in ("", "skip"))
            and not _counts_rows(column.values)
            and goes_evenly(column.values)
        ):
            return column.name, "it goes forward evenly from row to row, as no joint does"
    return None


def _counts_rows(values: Array) -> bool:
    """Whether numbers go up by one from row to row, but for rows that are missing."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(len(steps)) and is_whole(steps) and float(np.median(steps)) == 1.0


def clock_tick(values: Array, stated: str, rate: float | None = None) -> tuple[float | None, str]:
    """Seconds per unit of a clock by the rates that robots are recorded at, and why; None where it cannot be told.

    Args:
        values: the times as they stand in the file.
        stated: the unit that name or header state; empty for none.
        rate: rows a second that the recording states [Hz]; None for none.
    """
    if rate and not stated and _counts_rows(values):
        # A count, whatever it is called: how fast it goes is what the recording states.
        return 1.0 / rate, f"it counts rows, of which the recording states {rate:.4g} a second"
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    step = float(np.median(steps[steps > 0.0]))
    rates = {unit: 1.0 / (step * tick) for unit, tick in TICKS.items()}
    possible = [unit for unit, rate in rates.items() if SLOWEST_HZ <= rate <= FASTEST_HZ]
    if possible == ["d"] and stated != "d" and not any(low < known[0] < high for low, high in _SERIAL_DATES):
        possible = []
    if stated in TICKS and (stated in possible or not possible):
        return TICKS[stated], f"{stated} by its name: {rates[stated]:.4g} Hz"
    if not possible:
        return None, f"rows are {step:.4g} apart"
    unit = possible[0]
    if stated in TICKS:
        return TICKS[unit], f"{unit}, though its name says {stated}: that would be {rates[stated]:.3g} Hz"
    return TICKS[unit], f"{unit}: rows are {step:.4g} apart, {rates[unit]:.4g} Hz"


def row_seconds(time: Array) -> float | None:
    """Time from row to row ``(n,)`` [s]; None where time stands still."""
    steps = np.diff(time)
    if not (steps > 0.0).any():
        return None
    pace = float(np.median(steps[steps > 0.0]))
    # Stamps of few digits stand several times: what counts is how they go on over many rows, pauses left out.
    going = steps[(steps >= 0.0) & (steps < 5.0 * pace)]
    return float(going.mean()) if (going == 0.0).any() else pace


def rate_by_velocities(positions: Array, velocities: Array) -> float | None:
    """Rows a second of which velocities are the positions' slopes; None where most of them are not, or not of one.

    Args:
        positions: ``(n, m)``, of the joints.
        velocities: ``(n, m)``, the same angles or lengths a second.
    """
    if len(positions) < FEWEST_ROWS:
        return None
    slopes = [derivative_of(q, v, 1.0) for q, v in zip(positions.T, velocities.T, strict=True)]
    # What is regressed on the slope, as encoders have less noise than the velocities of drives.
    rates = np.array([alike**2 / slope for slope, alike in slopes if slope > 0.0 and alike > 0.95])
    if 2 * len(rates) <= len(slopes):
        return None
    rate = float(np.median(rates))
    return rate if np.abs(rates / rate - 1.0).max() < 0.1 and SLOWEST_HZ <= rate <= FASTEST_HZ else None


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
    """Join a recording's streams on one time base: that of its fastest torques, others between their samples.

    Args:
        found: what its columns are.
        rate_hz: of streams without a clock; None where there is none.

    Raises:
        LogError: a column is missing in this recording, or its streams do not overlap.
    """
    clocks = {item.source: item.factor for item in found.of("time")}
    wanted = {item.source: item for item in found.mapped if item.target != "time"}
    there = {column.name for column in recording.columns}
    if missing := [name for name in wanted if name not in there]:
        raise LogError(
            f"lacks the columns {', '.join(missing[:4])}, which the first recording has",
            source=recording.source,
            remedy="convert it on its own, or leave it out",
        )
    parts = []
    for stream in recording.streams:
        if items := [(wanted[c.name], c.values) for c in stream.columns if c.name in wanted]:
            stamps = (c.values * clocks[c.name] for c in stream.columns if c.name in clocks)
            time = next(stamps, stream.time)
            time = np.arange(stream.n_rows) / (rate_hz or 1.0) if time is None else time
            leads = any(item.channel == "tau" for item, _ in items)
            pace = len(time) / max(float(np.ptp(time)), 1e-9)
            parts.append((not leads, -pace, stream.name, time, items))
    if len(parts) > 1:
        parts.sort(key=lambda part: part[:2])
    *_, base, time, items = parts[0]
    columns = {"time": time} | {item.target: _in_si(values, item) for item, values in items}
    if len(parts) == 1:
        return Table(recording.name, columns)
    start, end = max(part[3].min() for part in parts), min(part[3].max() for part in parts)
    inside = (time >= start) & (time <= end)
    if inside.sum() < 10:
        raise LogError(
            f"has streams that do not overlap in time ({base} and others)",
            source=recording.source,
            remedy="check their clocks; map the time column of each under columns",
        )
    columns = {name: values if inside.all() else values[inside] for name, values in columns.items()}
    for *_, own, others in parts[1:]:
        order = np.argsort(own, kind="stable")
        for item, values in others:
            whole = order[np.isfinite(values[order])]
            if item.target not in columns and len(whole):
                columns[item.target] = np.interp(time[inside], own[whole], _in_si(values, item)[whole])
    rates = ", ".join(f"{name} at {-pace:.0f} Hz" for _, pace, name, *_ in parts)
    note = f"joined on the times of {base}, other streams between their samples ({rates})"
    return Table(recording.name, columns, (note,))


def _in_si(values: Array, item: Mapped) -> Array:
    """A column by its factor and offset; the same numbers, not copied, where nothing is to do."""
    if item.factor != 1.0:
        values = values * item.factor
    return values + item.offset if item.offset else values
