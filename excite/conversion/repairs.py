"""What is put right in a recording before it is understood or cut: seams, signs, rows that hold nothing."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.columns.clock import Table, is_clock
from excite.conversion.columns.units import BEYOND
from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Column, Machine, Recording
from excite.errors import LogError
from excite.logs.signals.resample import resample_smooth, without_seams
from excite.logs.units import TO_SI

# Rows in which something was not measured: filled between neighbours where that is sound, else left out.

# Longer than this nothing is made up between two samples [s].
_LONGEST_S = 0.05
# A first value that is this many steps from zero was not reached by moving, nor by the noise of a sensor, which is
# less than this share of all that it measures.
_AT_ONCE, _OF_SPREAD = 10.0, 0.02


def whole_rows(table: Table, source: object) -> Table:
    """The table with finite numbers only; short holes of single channels are filled, what remains is left out.

    Raises:
        LogError: no whole row is left.
    """
    time = table.columns["time"]
    known = np.isfinite(time)
    columns = _select_rows(known, table.columns)
    time = columns["time"]
    filled, notes = 0, list(table.notes)
    silent = _silent_rows(columns)
    if silent.any():
        notes.append(
            f"{int(silent.sum())} rows at the ends hold zeros of all joints, which nothing moved to or from: left out"
        )
        columns = _select_rows(~silent, columns)
        time = columns["time"]
    for name, values in columns.items():
        holes = ~np.isfinite(values)
        if not holes.any() or holes.all():
            continue
        there = np.flatnonzero(~holes)
        after = (
            np.clip(np.searchsorted(there, np.flatnonzero(holes)), 1, len(there) - 1)
            if len(there) > 1
            else None
        )
        if after is None:
            continue
        rows = np.flatnonzero(holes)
        # What comes before the first sample or after the last stands between none.
        near = (
            (time[there[after]] - time[there[after - 1]] <= _LONGEST_S)
            & (rows > there[0])
            & (rows < there[-1])
        )
        rows = rows[near]
        columns[name] = values.copy()
        columns[name][rows] = _interpolate_channel(name, time[there], values[there], time[rows])
        filled += len(rows)
    whole = np.ones(len(time), dtype=bool)
    for values in columns.values():
        whole &= np.isfinite(values)
    if whole.sum() < 10:
        empty = [name for name, values in columns.items() if not np.isfinite(values).any()]
        raise LogError(
            f"has {int(whole.sum())} rows in which every channel was measured"
            + (f"; empty are {', '.join(empty[:4])}" if empty else ""),
            source=source,
            remedy="leave the empty columns out by `ignore` in map.yaml",
        )
    if filled:
        notes.append(f"{filled} single values that were missing stand between their neighbours")
    if not whole.all() or not known.all():
        notes.append(f"{int((~whole).sum() + (~known).sum())} rows with missing values were left out")
    return replace(table, columns=_select_rows(whole, columns), notes=tuple(notes))


def _interpolate_channel(name: str, time: Array, values: Array, at: Array) -> Array:
    """A channel between its samples: positions by a spline, as straight lines between them have no accelerations."""
    if not name.startswith("q."):
        return np.interp(at, time, values)
    stamps, first = np.unique(time, return_index=True)
    return resample_smooth(stamps, values[first], at)


def _select_rows(rows: NDArray[np.bool_], columns: dict[str, Array]) -> dict[str, Array]:
    """Columns in some rows; not copied where all are meant."""
    return dict(columns) if rows.all() else {name: values[rows] for name, values in columns.items()}


def _silent_rows(columns: dict[str, Array]) -> NDArray[np.bool_]:
    """Rows before a driver's first message and after its last, in which all joints' values are the zeros of memory."""
    silent = np.zeros(len(columns["time"]), dtype=bool)
    for channel in ("q", "tau", "i"):
        found = [values for name, values in columns.items() if name.startswith(f"{channel}.")]
        if len(found) < 2:
            continue
        if any(values[0] != 0.0 for values in found) and any(values[-1] != 0.0 for values in found):
            continue
        table = np.column_stack(found)
        there = np.flatnonzero((table != 0.0).any(axis=1))
        if not len(there):
            continue
        for rows, first, second in (
            (slice(0, there[0]), there[0], min(there[0] + 1, len(table) - 1)),
            (slice(there[-1] + 1, None), there[-1], max(there[-1] - 1, 0)),
        ):
            # A motion that begins at zero leaves it in steps; a stream that begins is there at once.
            jump, step = np.abs(table[first]).max(), np.abs(table[second] - table[first]).max()
            if jump > _AT_ONCE * step and jump > _OF_SPREAD * np.ptp(table[there[0] :], axis=0).max():
                silent[rows] = True
    return silent


# Rows in which a drive was off: what moves then follows no command, and a brake may hold it.

# Dynamixel and Feetech: torque_enable; drives: enabled, power_on, servo_on, drive_enabled, motor_powered.
_SWITCH = re.compile(
    r"(?:^|[^a-z])(?:(?:torque|motor|servo|drive|axis|actuator)s?_?)?(?:enabled?|powered)(?:$|[^a-z])"
    r"|(?:^|[^a-z])(?:torque|motor|servo|drive|power)s?_?on(?:$|[^a-z])",
    re.IGNORECASE,
)
# Of a column that is to count as a switch, rows in either state.
_FEWEST = 10


def with_drives_on(recording: Recording) -> Recording:
    """The recording without rows in which a column such as ``torque_enable`` says that a drive was off.

    A column that never changes decides nothing: what is off all the time may be a joint that is not used.
    """
    notes = list(recording.notes)
    streams = []
    for stream in recording.streams:
        off = {column.name: rows for column in stream.columns if (rows := _rows_off(column)) is not None}
        if off:
            on = ~np.any(list(off.values()), axis=0)
            if on.sum() >= _FEWEST:
                notes.append(
                    f"{', '.join(off)}: a drive was off in {int((~on).sum())} of {len(on)} rows of {recording.name}, "
                    "which are left out"
                )
                stream = stream.rows(on)
        streams.append(stream)
    if len(notes) == len(recording.notes):
        return recording
    return replace(recording, streams=tuple(streams), notes=tuple(notes))


def _rows_off(column: Column) -> NDArray[np.bool_] | None:
    """Rows in which a switch is off; None for what is no switch."""
    if not _SWITCH.search(column.name):
        return None
    known = np.isfinite(column.values)
    if not np.isin(column.values[known], (0.0, 1.0)).all():
        return None
    off = known & (column.values == 0.0)
    return off if _FEWEST <= off.sum() <= known.sum() - _FEWEST else None


# Whole turns by which an encoder that counts on, or one that counts from 0 to 360 degrees, differs from its
# joint.

WHOLE_TURNS = "whole turns bring joints into their ranges"
_TURN = 2.0 * np.pi
# Damaged numbers are larger [rad].
_FAR = 1e6


def within_ranges(table: Table, machine: Machine, stated: Mapping[str, float]) -> Table:
    """The table with joints moved by the whole turns that bring them into their ranges, where nothing less does.

    Each recording by itself: the same angle goes on from 350 degrees in one and from -10 in the next. Commands are
    moved to where their joint is.

    Args:
        table: channels in SI units.
        machine: the robot, whose ranges are asked.
        stated: zeros that a map states, by channel or joint; these stay.
    """
    columns, moved = dict(table.columns), []
    for k, joint in enumerate(machine.joints):
        lower, upper = float(machine.lower[k]), float(machine.upper[k])
        if machine.slides[k]:
            continue
        measured = columns.get(f"q.{joint}")
        for channel in ("q", "q_cmd"):
            name = f"{channel}.{joint}"
            values = columns.get(name)
            if values is None or not np.isfinite(values).any() or {name, channel} & set(stated):
                continue
            if channel == "q" or measured is None:
                turns = _whole_turns(float(np.nanmin(values)), float(np.nanmax(values)), lower, upper)
            else:
                away = np.nanmedian(columns[f"q.{joint}"] - values)
                turns = round(float(away) / _TURN) if abs(away) < _FAR else 0
            if turns:
                columns[name] = values + turns * _TURN
                moved.append(f"{name} {turns:+d}")
    if not moved:
        return table
    note = f"{WHOLE_TURNS}: {', '.join(moved)}"
    return replace(table, columns=columns, notes=(*table.notes, note))


def _whole_turns(low: float, high: float, lower: float, upper: float) -> int:
    """Turns to add to an angle that leaves its range without them and keeps it with them; zero for none."""
    if not max(lower - low, high - upper) > BEYOND or not abs(high + low) < _FAR or np.isinf(upper - lower):
        return 0
    turns = round((0.5 * (lower + upper) - 0.5 * (low + high)) / _TURN)
    kept = max(lower - low - turns * _TURN, high + turns * _TURN - upper) <= BEYOND
    return int(turns) if kept else 0


# Numbers at the ends of their range: signed ones written without their sign, clocks that began anew, whole
# turns.

# A signal of sixteen bits that changes its sign leaves the middle half of the range empty.
_BITS = (16, 32)
_CLOCK_BITS = (16, 24, 32)
# A clock passes its end seldom, and loses no more rows there than elsewhere.
_RARE, _GAP = 0.01, 50.0
# Turns in the units that angles come in, and in shares of ±100; degrees and radians may jump wherever they are.
_ANGLES = (360.0, 2.0 * np.pi)
_TURNS = (
    *_ANGLES,
    *(2.0 * np.pi / TO_SI[unit] for unit in ("rev", "mrad", "mdeg", "arcmin", "arcsec")),
    200.0,
)


def restore_signs(recording: Recording) -> Recording:
    """The recording with whole numbers of 16 or 32 bits that jump between both ends of their range taken as signed.

    Angles that jump from one end of a turn to the other go on.
    """
    recording = _without_seams(recording)
    turned: list[str] = []
    wrapped: list[str] = []

    def of(column: Column) -> Column:
        values = column.values
        known = values[np.isfinite(values)]
        whole_clock = _continue_clock(known) if len(known) == len(values) else None
        if whole_clock is not None:
            wrapped.append(column.name)
            return replace(column, values=whole_clock)
        if not len(known) or known.min() < 0.0 or known.max() < 2.0**15 or (known != np.round(known)).any():
            return column
        for bits in _BITS:
            whole = 2.0**bits
            high, low = known > 0.75 * whole, known < 0.25 * whole
            if (
                known.max() < whole
                and high.any()
                and low.any()
                and (high | low).all()
                and _has_jumps(known, whole)
            ):
                turned.append(column.name)
                return replace(column, values=np.where(values > 0.5 * whole, values - whole, values))
        return column

    streams = tuple(replace(s, columns=tuple(of(c) for c in s.columns)) for s in recording.streams)
    if turned:
        # Another joint's, of the same driver, may be negative all the time.
        streams = tuple(
            replace(s, columns=tuple(_negative_column(c, turned) for c in s.columns)) for s in streams
        )
    if not turned and not wrapped:
        return recording
    notes = list(recording.notes)
    if turned:
        notes.append(
            f"{', '.join(turned[:4])}: whole numbers without sign jump by their whole range, and are taken as signed"
        )
    if wrapped:
        notes.append(f"{', '.join(wrapped[:4])}: a counter that began at zero again goes on here")
    return replace(recording, streams=streams, notes=tuple(notes))


def _without_seams(recording: Recording) -> Recording:
    """The recording with angles that drivers keep within a turn going on beyond it."""
    names = []
    streams = []
    for stream in recording.streams:
        whole = {c.name: values for c in stream.columns if (values := _unwind_angle(c)) is not None}
        names += list(whole)
        columns = tuple(replace(c, values=whole.get(c.name, c.values)) for c in stream.columns)
        streams.append(replace(stream, columns=columns))
    if not names:
        return recording
    note = f"{', '.join(names[:4])}: an angle that jumps by a whole turn goes on here"
    return replace(recording, streams=tuple(streams), notes=(*recording.notes, note))


def _negative_column(column: Column, turned: list[str]) -> Column:
    """A column that never leaves the upper end of its range as signed, where others of its driver were."""
    known = column.values[np.isfinite(column.values)]
    if not len(known) or (known != np.round(known)).any() or is_clock(known):
        return column
    for bits in _BITS:
        whole = 2.0**bits
        if known.min() > 0.75 * whole and known.max() < whole:
            turned.append(column.name)
            return replace(column, values=column.values - whole)
    return column


def _continue_clock(values: Array) -> Array | None:
    """A clock of whole ticks that went over the end of its range, going on; None where it is none."""
    steps = np.diff(values)
    back = steps < 0.0
    if not back.any() or back.mean() > _RARE or (values != np.round(values)).any() or values.min() < 0.0:
        return None
    usual = float(np.median(steps))
    for bits in _CLOCK_BITS:
        mended = steps[back] + 2.0**bits
        if values.max() < 2.0**bits and usual > 0.0 and (mended >= 0.0).all() and mended.max() < _GAP * usual:
            whole = values + 2.0**bits * np.concatenate([[0.0], np.cumsum(back)])
            return np.asarray(whole) if is_clock(whole) else None
    return None


def _unwind_angle(column: Column) -> Array | None:
    """An angle that jumps from one end of a turn to the other, going on; None where it is none."""
    if read_clue(column.name, ()).quantity not in ("", "q", "skip"):
        return None
    values = column.values
    known = values[np.isfinite(values)]
    # No seam is without a step of half a turn, which most channels never make.
    step = float(np.abs(np.diff(known)).max(initial=0.0))
    turns = [turn for turn in _turns(known) if step > 0.5 * turn] if step else []
    found = (without_seams(values, turn, within=turn not in _ANGLES) for turn in turns)
    return next((whole for whole in found if whole is not None), None)


def _turns(known: Array) -> tuple[float, ...]:
    """What a turn may be in the unit of some numbers: of counts the power of two that they stay below."""
    size = float(np.ptp(known))
    counted = (known == np.round(known)).all() and 0.0 < size < 2.0**53
    return (*_TURNS, *([2.0 ** float(np.ceil(np.log2(size + 1.0)))] if counted else []))


def _has_jumps(values: np.ndarray, whole: float) -> bool:
    """Whether it goes from one end to the other more than once, as a counter that overflows does not so fast."""
    return int((np.abs(np.diff(values)) > 0.5 * whole).sum()) >= 2
