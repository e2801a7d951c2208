"""What is put right in a recording before it is understood or cut: seams, signs, rows that hold nothing."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from excite.arrays import Array, Flags, is_whole
from excite.conversion.columns.clock import Table, is_clock
from excite.conversion.columns.units import BEYOND
from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Column, Machine, Recording
from excite.errors import LogError
from excite.logs.signals.resample import resample_smooth, without_seams
from excite.logs.units import TO_SI

WHOLE_TURNS = "whole turns bring joints into their ranges"
# Longer than this nothing is made up between two samples [s].
_LONGEST_S = 0.05
# Of a column that is to count as a switch, rows in either state.
_FEWEST = 10
# Dynamixel and Feetech: torque_enable; drives: enabled, power_on, servo_on, drive_enabled, motor_powered.
_SWITCH = re.compile(
    r"(?:^|[^a-z])(?:(?:torque|motor|servo|drive|axis|actuator)s?_?)?(?:enabled?|powered)(?:$|[^a-z])"
    r"|(?:^|[^a-z])(?:torque|motor|servo|drive|power)s?_?on(?:$|[^a-z])",
    re.IGNORECASE,
)
_TURN = 2.0 * np.pi
# Turns in the units that angles come in, and in shares of ±100; degrees and radians may jump wherever they are.
_ANGLES = (360.0, _TURN)
_TURNS = (*_ANGLES, *(_TURN / TO_SI[unit] for unit in ("rev", "mrad", "mdeg", "arcmin", "arcsec")), 200.0)


def whole_rows(table: Table, source: object) -> Table:
    """The table with finite numbers only; short holes of single channels are filled, what remains is left out.

    Raises:
        LogError: no whole row is left.
    """
    notes, filled = list(table.notes), 0
    known = np.isfinite(table.columns["time"])
    columns = _select_rows(known, table.columns)
    silent = _silent_rows(columns)
    if silent.any():
        notes.append(
            f"{int(silent.sum())} rows at the ends hold zeros of all joints, which nothing moved to or from: left out"
        )
        columns = _select_rows(~silent, columns)
    time = columns["time"]
    for name, values in columns.items():
        there, holes = np.flatnonzero(np.isfinite(values)), np.flatnonzero(~np.isfinite(values))
        if len(there) < 2 or not len(holes):
            continue
        # What comes before the first sample or after the last stands between none.
        after = np.clip(np.searchsorted(there, holes), 1, len(there) - 1)
        near = time[there[after]] - time[there[after - 1]] <= _LONGEST_S
        rows = holes[near & (holes > there[0]) & (holes < there[-1])]
        columns[name] = values.copy()
        if name.startswith("q."):
            # Straight lines between positions have no accelerations.
            stamps, first = np.unique(time[there], return_index=True)
            columns[name][rows] = resample_smooth(stamps, values[there][first], time[rows])
        else:
            columns[name][rows] = np.interp(time[rows], time[there], values[there])
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
    if lost := int((~whole).sum() + (~known).sum()):
        notes.append(f"{lost} rows with missing values were left out")
    return replace(table, columns=_select_rows(whole, columns), notes=tuple(notes))


def _select_rows(rows: Flags, columns: dict[str, Array]) -> dict[str, Array]:
    """Columns in some rows; not copied where all are meant."""
    return dict(columns) if rows.all() else {name: values[rows] for name, values in columns.items()}


def _silent_rows(columns: dict[str, Array]) -> Flags:
    """Rows before a driver's first message and after its last, in which all joints' values are the zeros of memory.

    A motion that begins at zero leaves it in steps; a stream that begins is there at once, by more than the noise of a
    sensor, which is less than a fiftieth of all that it measures.
    """
    silent = np.zeros(len(columns["time"]), dtype=bool)
    for channel in ("q", "tau", "i"):
        found = [values for name, values in columns.items() if name.startswith(f"{channel}.")]
        if len(found) < 2 or (any(v[0] != 0.0 for v in found) and any(v[-1] != 0.0 for v in found)):
            continue
        table = np.column_stack(found)
        there = np.flatnonzero((table != 0.0).any(axis=1))
        for rows, first, step in (
            ((np.s_[: there[0]], there[0], 1), (np.s_[there[-1] + 1 :], there[-1], -1))
            if len(there) > 1
            else ()
        ):
            jump, next_step = np.abs(table[first]).max(), np.abs(table[first + step] - table[first]).max()
            silent[rows] |= jump > 10.0 * next_step and jump > 0.02 * np.ptp(table[there[0] :], axis=0).max()
    return silent


def with_drives_on(recording: Recording) -> Recording:
    """The recording without rows in which a column such as ``torque_enable`` says that a drive was off.

    What moves then follows no command, and a brake may hold it. A column that never changes decides nothing: what is
    off all the time may be a joint that is not used.
    """
    streams, notes = [], list(recording.notes)
    for stream in recording.streams:
        off = {}
        for column in stream.columns:
            known = column.values[np.isfinite(column.values)]
            if _SWITCH.search(column.name) and np.isin(known, (0.0, 1.0)).all():
                if _FEWEST <= (known == 0.0).sum() <= len(known) - _FEWEST:
                    off[column.name] = column.values == 0.0
        on = ~np.any([*off.values(), np.zeros(stream.n_rows, dtype=bool)], axis=0)
        if off and on.sum() >= _FEWEST:
            rows = f"{int((~on).sum())} of {len(on)} rows of {recording.name}"
            notes.append(f"{', '.join(off)}: a drive was off in {rows}, which are left out")
            stream = stream.rows(on)
        streams.append(stream)
    return replace(recording, streams=tuple(streams), notes=tuple(notes))


def within_ranges(table: Table, machine: Machine, stated: Mapping[str, float]) -> Table:
    """The table with joints moved by the whole turns that bring them into their ranges, where nothing less does.

    Encoders count on, or from 0 to 360 degrees. Each recording by itself: the same angle goes on from 350 degrees in
    one and from -10 in the next. Commands are moved to where their joint is.

    Args:
        table: channels in SI units.
        machine: the robot, whose ranges are asked.
        stated: zeros that a map states, by channel or joint; these stay.
    """
    columns, moved = dict(table.columns), []
    for k, joint in enumerate(machine.joints):
        for channel in ("q", "q_cmd") if not machine.slides[k] else ():
            name = f"{channel}.{joint}"
            values = columns.get(name, np.array([np.nan]))
            if not np.isfinite(values).any() or {name, channel} & set(stated):
                continue
            if channel == "q" or f"q.{joint}" not in columns:
                ends = float(np.nanmin(values)), float(np.nanmax(values))
                turns = _whole_turns(*ends, float(machine.lower[k]), float(machine.upper[k]))
            else:
                away = float(np.nanmedian(columns[f"q.{joint}"] - values))
                # Damaged numbers are larger.
                turns = round(away / _TURN) if abs(away) < 1e6 else 0
            if turns:
                columns[name] = values + turns * _TURN
                moved.append(f"{name} {turns:+d}")
    notes = [f"{WHOLE_TURNS}: {', '.join(moved)}"] if moved else []
    return replace(table, columns=columns, notes=(*table.notes, *notes))


def _whole_turns(low: float, high: float, lower: float, upper: float) -> int:
    """Turns to add to an angle that leaves its range without them and keeps it with them; zero for none."""
    if max(lower - low, high - upper) <= BEYOND or abs(high + low) > 1e6 or not np.isfinite(upper - lower):
        return 0
    turns = round((0.5 * (lower + upper) - 0.5 * (low + high)) / _TURN)
    kept = max(lower - low - turns * _TURN, high + turns * _TURN - upper) <= BEYOND
    return int(turns) if kept else 0


def restore_signs(recording: Recording) -> Recording:
    """The recording with numbers that pass the end of their range going on, and with the signs of those that lost them.

    Angles that jump from one end of a turn to the other go on, clocks that begin at zero again do, and whole numbers of
    16 or 32 bits that jump between both ends of their range are signed; so are, of the same driver, those that never
    leave its upper end.
    """
    recording, seams = _change_columns(recording, _unwind_angle)
    recording, clocks = _change_columns(recording, _continue_clock)
    recording, signed = _change_columns(recording, lambda column: _signed(column, jumps=True))
    if signed:
        recording, more = _change_columns(recording, lambda column: _signed(column, jumps=False))
        signed += more
    said = {
        "an angle that jumps by a whole turn goes on here": seams,
        "whole numbers without sign jump by their whole range, and are taken as signed": signed,
        "a counter that began at zero again goes on here": clocks,
    }
    notes = [f"{', '.join(names[:4])}: {text}" for text, names in said.items() if names]
    return replace(recording, notes=(*recording.notes, *notes))


def _change_columns(
    recording: Recording, change: Callable[[Column], Array | None]
) -> tuple[Recording, list[str]]:
    """The recording with the columns that are changed, and their names."""
    names: list[str] = []
    streams = []
    for stream in recording.streams:
        changed = {c.name: values for c in stream.columns if (values := change(c)) is not None}
        names += list(changed)
        columns = (replace(c, values=changed[c.name]) if c.name in changed else c for c in stream.columns)
        streams.append(replace(stream, columns=tuple(columns)))
    return (replace(recording, streams=tuple(streams)) if names else recording), names


def _counts(values: Array) -> bool:
    return len(values) > 0 and values.min() >= 0.0 and is_whole(values)


def _signed(column: Column, *, jumps: bool) -> Array | None:
    """Whole numbers without sign as signed ones; None for none.

    A signal that changes its sign leaves the middle half of its range empty, and goes from one end to the other more
    than once; others of its driver stay at the upper end.
    """
    values = column.values
    known = values[np.isfinite(values)]
    if not _counts(known) or known.max() < 2.0**15 or (not jumps and is_clock(known)):
        return None
    for bits in (16, 32):
        whole = 2.0**bits
        high, low = known > 0.75 * whole, known < 0.25 * whole
        turns = int((np.abs(np.diff(known)) > 0.5 * whole).sum())
        there = low.any() and high.any() and (high | low).all() and turns > 1 if jumps else high.all()
        if known.max() < whole and there:
            return np.where(values > 0.5 * whole, values - whole, values)
    return None


def _continue_clock(column: Column) -> Array | None:
    """A clock of whole ticks that went over the end of its range, going on; None where it is none.

    A clock passes its end seldom, and loses no more rows there than elsewhere.
    """
    values = column.values
    steps = np.diff(values)
    back = steps < 0.0
    if not back.any() or back.mean() > 0.01 or not _counts(values) or np.median(steps) <= 0.0:
        return None
    for bits in (16, 24, 32):
        mended = steps[back] + 2.0**bits
        if values.max() < 2.0**bits and (mended >= 0.0).all() and mended.max() < 50.0 * np.median(steps):
            whole = np.asarray(values + 2.0**bits * np.concatenate([[0.0], np.cumsum(back)]))
            return whole if is_clock(whole) else None
    return None


def _unwind_angle(column: Column) -> Array | None:
    """An angle that jumps from one end of a turn to the other, going on; None where it is none.

    Of counts a turn is the power of two that they stay below.
    """
    if read_clue(column.name, ()).quantity not in ("", "q", "skip"):
        return None
    known = column.values[np.isfinite(column.values)]
    # No seam is without a step of half a turn, which most channels never make.
    step = float(np.abs(np.diff(known)).max(initial=0.0))
    size = float(np.ptp(known)) if step else 0.0
    counted = 0.0 < size < 2.0**53 and is_whole(known)
    turns = (*_TURNS, *([2.0 ** float(np.ceil(np.log2(size + 1.0)))] if counted else []))
    found = (
        without_seams(column.values, turn, within=turn not in _ANGLES) for turn in turns if step > 0.5 * turn
    )
    return next((whole for whole in found if whole is not None), None)
