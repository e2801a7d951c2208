"""Columns' numbers, the unit that their names state, and their factors with what a map says on top."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.unit_words import unit_named
from excite.conversion.columns.units import TO_SI
from excite.conversion.columns.words import read_clue
from excite.conversion.guesses import Mapped
from excite.conversion.mapping import Map
from excite.conversion.recording import Column

# An accelerometer at rest reads gravity: 9.81 m/s², 1 g or 1000 mg. A robot that stands departs from it by less.
_GRAVITY = 9.80665
_NEAR = 1.25


def scale_channel(item: Mapped, mapping: Map, factor: float, zero: float, because: str) -> Mapped:
    """A channel with its factor and zero (SI), scaled and moved as the map says."""
    scale = mapping.scale.get(item.channel, 1.0) * mapping.scale.get(item.target, 1.0)
    offset = mapping.offset.get(item.target, mapping.offset.get(item.channel, zero))
    return replace(item, factor=factor * scale, because=because, offset=offset)


def named_unit(items: list[Mapped], columns: dict[str, Column], *, slide: bool = False) -> str:
    """The unit that names or format state of all columns of a channel; empty for none, or several.

    Args:
        items: the columns.
        columns: by name.
        slide: whether they are the motion of joints that slide, whose unit a name may state beside the others'.
    """
    units = set()
    for item in items:
        said = read_clue(columns[item.source].said_as, [item.target.partition(".")[2]])
        of_name = said.sliding if slide and said.sliding else said.unit
        units.add(unit_named(columns[item.source].unit) or of_name)
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


def of_imu(items: list[Mapped], columns: dict[str, Column], mapping: Map) -> list[Mapped]:
    """Readings of an IMU: in the unit that names state, else rad/s and what makes gravity of accelerations."""
    read = [item for item in items if item.target in ("imu.ax", "imu.ay", "imu.az")]
    weighed = _gravity_unit(values_of(read, columns)) if len(read) == 3 else (1.0, "no unit stated")
    done = []
    for item in items:
        named = str(mapping.units.get(item.channel, "")) or named_unit([item], columns)
        scale_stated = bool({item.channel, item.target} & set(mapping.scale))
        factor, why = weighed if item in read and not scale_stated else (1.0, "no unit stated")
        if named in TO_SI:
            factor, why = TO_SI[named], "unit as named"
        done.append(scale_channel(item, mapping, factor, 0.0, f"{item.because}; {why}"))
    return done


def _gravity_unit(accelerations: Array) -> tuple[float, str]:
    """The factor to m/s² of an accelerometer, and why: what it reads where a robot stands is gravity.

    Args:
        accelerations: ``(n, 3)`` as they stand in the file.
    """
    level = float(np.nanmedian(np.linalg.norm(accelerations, axis=1)))
    for unit, factor in (("g", _GRAVITY), ("mg", 1e-3 * _GRAVITY)):
        if _GRAVITY / _NEAR < level * factor < _GRAVITY * _NEAR:
            return factor, f"{unit}: it reads {level:.4g} where the robot hardly moves"
    return 1.0, "m/s²: no other unit makes gravity of it"
