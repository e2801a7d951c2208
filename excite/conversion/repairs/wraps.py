"""Numbers at the ends of their range: signed ones written without their sign, clocks that began anew, whole turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.clock import is_clock
from excite.conversion.columns.units import TO_SI
from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Column, Recording
from excite.logs.signals.seams import without_seams

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
    if not len(known):
        return None
    found = (without_seams(values, turn, within=turn not in _ANGLES) for turn in _turns(known))
    return next((whole for whole in found if whole is not None), None)


def _turns(known: Array) -> tuple[float, ...]:
    """What a turn may be in the unit of some numbers: of counts the power of two that they stay below."""
    size = float(np.ptp(known))
    counted = (known == np.round(known)).all() and 0.0 < size < 2.0**53
    return (*_TURNS, *([2.0 ** float(np.ceil(np.log2(size + 1.0)))] if counted else []))


def _has_jumps(values: np.ndarray, whole: float) -> bool:
    """Whether it goes from one end to the other more than once, as a counter that overflows does not so fast."""
    return int((np.abs(np.diff(values)) > 0.5 * whole).sum()) >= 2
