"""Columns of one channel that are not all in one unit: by names, by a map, or by how far joints can turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.columns.scaled import named_unit
from excite.conversion.columns.unit_words import OF_TURNING, QUANTITY_OF_UNIT
from excite.conversion.columns.units import BEYOND, TO_SI, WIDE
from excite.conversion.guesses import Mapped
from excite.conversion.machine import Machine
from excite.conversion.mapping import Map
from excite.conversion.recording import Column

# Channels of how joints move, and units that a channel may have of joints that turn alone.
MOTION = ("q", "q_cmd", "v", "a")
ANGLES = frozenset(u for u in OF_TURNING if QUANTITY_OF_UNIT[u] != "tau" and TO_SI[u] != 1.0)
# A joint that is held is in the others' unit, and what it is called matters little. In degrees 16 of the 17 joints that
# are held in real recordings here stay within this number (0.054 at the most, the other 0.13); in radians 95 % of the
# 1421 joints that move in the library's motions of eleven robots go further. What is between is asked about.
_HELD = 0.06
# No joint of those motions, and 3 of 204 in the recordings, turn further in radians; in degrees it would be 6.3.
_TURN = 2.0 * np.pi
# Slopes over velocities of one recording in one unit differ from joint to joint by 1.05 at the most in seven real
# recordings, by 1.5 and 2.3 in two whose velocities are filtered; of degrees and radians by 57. The line is half way
# between one and that, as a ratio.
_APART = np.sqrt(180.0 / np.pi)


def group_by_unit(
    items: Sequence[Mapped], columns: dict[str, Column], mapping: Map, machine: Machine
) -> list[list[Mapped]]:
    """Columns of a channel by the unit that the map or their names state; one group where all say the same.

    Where joints are and how fast they move is no angle of joints that slide: they are a group of their own.
    """
    groups: dict[tuple[str, str, bool], list[Mapped]] = {}
    for item in items:
        slide = is_slide(item, machine)
        key = (stated_unit([item], mapping, machine), named_unit([item], columns, slide=slide), slide)
        groups.setdefault(key, []).append(item)
    return list(groups.values())


def is_slide(item: Mapped, machine: Machine) -> bool:
    """Whether a column is the motion of a joint that slides."""
    joint = item.target.partition(".")[2]
    return (
        item.channel in MOTION
        and joint in machine.joints
        and bool(machine.slides[machine.joints.index(joint)])
    )


def stated_unit(items: Sequence[Mapped], mapping: Map, machine: Machine) -> str:
    """The unit that a map states of a joint's column, or of its channel; empty for none.

    A part of a turn that is stated of a channel is that of its joints that turn.
    """
    own, common = mapping.units.get(items[0].target), mapping.units.get(items[0].channel)
    return str(own or ("" if is_slide(items[0], machine) and common in ANGLES else common) or "")


def in_degrees(
    values: Array, lower: Array, upper: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
    """Which columns are degrees, which beside them look like radians, by their ranges; None where none contradict.

    Args:
        values: ``(n, k)`` positions of joints that turn, as they stand in the file.
        lower: ``(k,)`` ends of the joints' ranges [rad], ``upper`` too; infinite where they are not known.
    """
    low, high = np.nanmin(values, axis=0), np.nanmax(values, axis=0)
    factor, span = TO_SI["deg"], high - low
    beyond = np.maximum(lower - low, high - upper)
    beyond_in_degrees = np.maximum(lower - low * factor, high * factor - upper)
    # Wherever a joint's zero is, it does not turn further than its range is wide.
    wide = np.where(np.isfinite(upper - lower), upper - lower, WIDE)
    degrees = (span > wide) & (beyond > BEYOND) & (beyond_in_degrees <= BEYOND)
    degrees |= ~np.isfinite(beyond) & (span > wide)
    radians = (beyond <= BEYOND) & (span > _HELD) & (span < _TURN)
    if not (degrees.any() and radians.any()):
        return None
    # Those that hardly move go with most.
    still = ~(degrees | radians)
    most = degrees.sum() > radians.sum()
    return degrees | (still & most), radians | (still & ~most)


def units_differ(
    slope: Callable[[int], float | None], degrees: NDArray[np.bool_], radians: NDArray[np.bool_]
) -> bool:
    """Whether logged velocities say that both are in the units that they look like.

    Args:
        slope: by column, the slope of its numbers over the logged velocity, None where it has none.
        degrees: ``(k,)`` columns that can only be degrees, ``radians`` those that look like the other unit.
    """
    large, small = (
        [value for k in np.flatnonzero(which) if (value := slope(int(k))) is not None]
        for which in (degrees, radians)
    )
    return bool(large and small) and min(large) > _APART * max(small)
