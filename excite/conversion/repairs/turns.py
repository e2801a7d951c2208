"""Whole turns by which an encoder that counts on, or one that counts from 0 to 360 degrees, differs from its joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from excite.conversion.assemble import Table
from excite.conversion.columns.units import BEYOND
from excite.conversion.machine import Machine

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
