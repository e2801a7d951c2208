"""Columns' numbers, the unit that their names state, and their factors with what a map says on top."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.unit_words import UNITS
from excite.conversion.columns.words import clue
from excite.conversion.guesses import Mapped
from excite.conversion.mapping import Map
from excite.conversion.recording import Column


def scaled(item: Mapped, mapping: Map, factor: float, zero: float, because: str) -> Mapped:
    """A channel with its factor and zero (SI), scaled and moved as the map says."""
    scale = mapping.scale.get(item.channel, 1.0) * mapping.scale.get(item.target, 1.0)
    offset = mapping.offset.get(item.target, mapping.offset.get(item.channel, zero))
    return replace(item, factor=factor * scale, because=because, offset=offset)


def named_unit(items: list[Mapped], columns: dict[str, Column]) -> str:
    """The unit that names or format state of all columns of a channel; empty for none, or several."""
    units = set()
    for item in items:
        column = columns[item.source]
        unit = (
            UNITS.get(column.unit.strip().lower(), "")
            or clue(item.source, [item.target.partition(".")[2]]).unit
        )
        units.add(unit)
    return units.pop() if len(units) == 1 else ""


def values_of(items: list[Mapped], columns: dict[str, Column]) -> Array:
    """Numbers of several columns as they stand in the file, ``(n, k)``."""
    rows = min(len(columns[item.source].values) for item in items)
    return np.column_stack([columns[item.source].values[:rows] for item in items])


def without_unit(channel: str, items: list[Mapped], columns: dict[str, Column]) -> str:
    """What is said of columns whose unit nothing states: servos report currents in counts of a few milliamperes."""
    if channel == "i":
        values = values_of(items, columns)
        known = values[np.isfinite(values)]
        if len(known) and (known == np.round(known)).all():
            return "no unit stated; whole numbers, so counts of a drive or mA: torque constants are per one of them"
    return "no unit stated"
