"""Columns that hold the same number in every row: a message's field that nobody fills is no measurement of zero."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.conversion.columns.families import Family
from excite.conversion.guesses import Guesses
from excite.conversion.recording import Recording

# Positions may stand still, and commands too.
_MOVING = ("v", "a", "tau", "i", "volt")


def without_unfilled(found: Guesses, groups: Sequence[Family], recording: Recording) -> list[Family]:
    """The families without those of velocities, torques, currents or voltages that never change at any joint.

    Drivers without torque sensors leave the efforts of a joint state at zero, and servos that do not measure a load
    report a constant. One dead channel among live ones stays: it is a fault, which the doctor names.
    """
    varying, live = live_columns(recording), []
    for family in groups:
        if family.quantity in _MOVING and varying.isdisjoint(family.columns):
            why = "the same number in every row at every joint: the field was not filled, and nothing is made of it"
            name = family.columns[0] if len(family.columns) == 1 else f"{family.columns[0]} …"
            found.facts.append(("nothing", name, why))
        else:
            live.append(family)
    return live


def live_columns(recording: Recording) -> frozenset[str]:
    """Names of the columns whose numbers are not the same in every row."""
    return frozenset(
        column.name
        for stream in recording.streams
        for column in stream.columns
        if len(np.unique(column.values[np.isfinite(column.values)])) > 1
    )
