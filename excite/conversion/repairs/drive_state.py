"""Rows in which a drive was off: what moves then follows no command, and a brake may hold it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.conversion.recording import Column, Recording

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
