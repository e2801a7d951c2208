"""Units of positions, measured and commanded: by names, by ranges, or asked for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.columns.mixed_units import (
    group_by_unit,
    in_degrees,
    is_slide,
    stated_unit,
    units_differ,
)
from excite.conversion.columns.scaled import named_unit, scale_channel, values_of
from excite.conversion.columns.unit_words import OF_SLIDING, OF_TURNING
from excite.conversion.columns.units import BEYOND, COUNTS, TO_SI, PositionUnit, position_unit
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.machine import Machine
from excite.conversion.mapping import Map
from excite.conversion.recording import Column

# Joints may be faster than they are said to be, but not as much as degrees are larger than radians.
_FASTER = 3.0
# Columns that are named in one reason.
MOST_NAMED = 4
# LeRobot's servos report the share of the range that they were calibrated in, unless told to report degrees: from
# -100 to 100, grippers from 0 (its ``MotorNormMode``).
SHARE = "±100"


def position_units(
    found: Guesses,
    columns: dict[str, Column],
    machine: Machine,
    mapping: Map,
    slope: Callable[[Mapped], float | None],
    fast: Callable[[Mapped], float | None],
    *,
    maybe_shares: bool,
) -> dict[str, tuple[str, str]]:
    """Unit and reason of each measured and commanded position, by its target.

    Args:
        found: what is known of the columns; questions are added.
        columns: by name.
        machine: the robot.
        mapping: what a person said.
        slope: of a column's numbers over its joint's logged velocity; None where there is none.
        fast: how fast a column's numbers are by a logged velocity in the same unit; None where there is none.
        maybe_shares: whether the format may hold shares of ranges.
    """
    result: dict[str, tuple[str, str]] = {}
    for items in group_by_unit(found.of("q"), columns, mapping, machine):
        for part, why in _by_unit(found, items, columns, machine, mapping, slope):
            units = ("rad", "asked about")
            if why is not None:
                units = _shared_unit(
                    found, part, columns, machine, mapping, fast=fast, maybe_shares=maybe_shares
                )
                units = (units[0], why or units[1])
            result |= {item.target: units for item in part}
    measured = {item.target: item for item in found.of("q")}
    several = len({result[target][0] for target, item in measured.items() if not is_slide(item, machine)}) > 1
    for items in group_by_unit(found.of("q_cmd"), columns, mapping, machine):
        named = stated_unit(items, mapping, machine) or named_unit(items, columns)
        if several and not named and not is_slide(items[0], machine):
            for item in items:
                twin = measured.get(f"q.{item.target.partition('.')[2]}")
                unit = "rad" if twin is None else _nearer_unit(item, twin, result[twin.target][0], columns)
                result[item.target] = (unit, "as near the measured positions as can be")
            continue
        units = _shared_unit(
            found, items, columns, machine, mapping, like=result.get(items[0].target.replace("q_cmd.", "q."))
        )
        result |= {item.target: units for item in items}
    return result


def _by_unit(
    found: Guesses,
    items: list[Mapped],
    columns: dict[str, Column],
    machine: Machine,
    mapping: Map,
    slope: Callable[[Mapped], float | None],
) -> list[tuple[list[Mapped], str | None]]:
    """Columns in one part, or in two where some are in degrees among others in radians, and why; None: it is asked."""
    stated = stated_unit(items, mapping, machine) or named_unit(items, columns)
    if mapping.motors or stated or "q" in mapping.scale:
        return [(items, "")]
    turning = [item for item in items if not is_slide(item, machine)]
    if len(turning) < 2:
        return [(items, "")]
    places = [_joint_place(item, machine) for item in turning]
    found_two = in_degrees(values_of(turning, columns), machine.lower[places], machine.upper[places])
    if found_two is None:
        return [(items, "")]
    degrees, radians = found_two
    names = [
        [item.source for item, is_so in zip(turning, which, strict=True) if is_so] for which in found_two
    ]
    if units_differ(lambda k: slope(turning[k]), degrees, radians):
        small = [item for item in items if item.source in names[1]]
        rest = [item for item in items if item.source not in names[1]]
        of = f"unlike {', '.join(names[1][:MOST_NAMED])}, by their ranges and velocities"
        return [(rest, f"deg {of}"), (small, "rad: within the range, and so their velocities have it")]
    one = next(item.target for item, is_so in zip(turning, radians, strict=True) if is_so)
    by_joint = ", ".join(f"{target}: {unit}" for target, unit in _units_of(turning, degrees).items())
    found.ask(
        f"{', '.join(names[0][:MOST_NAMED])} can only be degrees, {', '.join(names[1][:MOST_NAMED])} may be radians: "
        f"as degrees {one.partition('.')[2]} … would turn by less than 6.3",
        f"units: {{q: deg}} (all are degrees), or units: {{{by_joint}}}",
        units=({"q": "rad"}, {"q": "deg"}, _units_of(turning, degrees)),
    )
    return [(items, None)]


def _units_of(items: list[Mapped], degrees: NDArray[np.bool_]) -> dict[str, str]:
    return {item.target: "deg" if is_so else "rad" for item, is_so in zip(items, degrees, strict=True)}


def _joint_place(item: Mapped, machine: Machine) -> int:
    return machine.joints.index(item.target.partition(".")[2])


def _nearer_unit(item: Mapped, twin: Mapped, unit: str, columns: dict[str, Column]) -> str:
    """Of radians and degrees the unit with which a command is nearer to what was measured."""
    command, value = columns[item.source].values, columns[twin.source].values * TO_SI.get(unit, 1.0)
    rows = min(len(command), len(value))
    miss = {u: float(np.nanmean((command[:rows] * TO_SI[u] - value[:rows]) ** 2)) for u in ("rad", "deg")}
    return min(miss, key=lambda u: miss[u])


def _shared_unit(
    found: Guesses,
    items: list[Mapped],
    columns: dict[str, Column],
    machine: Machine,
    mapping: Map,
    *,
    like: tuple[str, str] | None = None,
    fast: Callable[[Mapped], float | None] | None = None,
    maybe_shares: bool = False,
) -> tuple[str, str]:
    """The unit of columns that share one, and why; asked for where it cannot be told."""
    channel, slide = items[0].channel, is_slide(items[0], machine)
    named = named_unit(items, columns, slide=slide)
    unit, why, sure, either = _by_numbers(items, columns, machine, named, fast)
    stated = stated_unit(items, mapping, machine)
    if named == "counts" and unit not in COUNTS:
        unit, why, sure = "", "counts, by its name, and how many are a turn is not said", True
    if not sure and like is not None:
        unit, why = like[0], "as the measured positions"
    if mapping.motors:
        # Motors turn beyond what joints do.
        unit, why = named or "rad", "motors' positions"
    elif stated:
        unit = stated
    elif TO_SI.get(named, 1.0) != 1.0 and named in (OF_TURNING if slide else OF_SLIDING):
        does, is_of, other = ("slide", "an angle", "mm") if slide else ("turn", "a length", "deg")
        written = ", ".join(f"{item.target}: {other}" for item in items)
        found.ask(
            f"{items[0].source} … say {named}, {is_of}, and their joints {does}",
            f"units: {{{written}}}",
        )
    elif not unit and (channel in mapping.scale or all(item.target in mapping.scale for item in items)):
        unit, why = "rad", "scaled by the map"
    elif maybe_shares and unit == "deg" and not named:
        _ask_for_shares(found, items, values_of(items, columns))
    if not unit:
        values = values_of(items, columns)
        if (values == np.round(values)).all():
            why += "; whole numbers: an encoder's counts, whose number a turn the maker states for each joint"
        found.ask(
            f"the unit of {items[0].source} … cannot be told: {why}",
            f"units: {{{channel}: deg}} (or rev, counts/4096), or motors: [[RATIO, 0 …], …] where they are "
            f"motors' positions, or scale: {{{channel}: FACTOR}}, {{{items[0].target}: FACTOR, …}} where joints differ",
            units=({channel: "rad"}, {channel: "deg"}) if channel == "q" and either else (),
        )
        unit = "rad"
    return unit, why


def _by_numbers(
    items: list[Mapped],
    columns: dict[str, Column],
    machine: Machine,
    named: str,
    fast: Callable[[Mapped], float | None] | None,
) -> PositionUnit:
    """The unit by ranges, where velocities do not let it open."""
    places = [_joint_place(item, machine) for item in items]
    lower, upper, slide = machine.lower[places], machine.upper[places], machine.slides[places]
    found = position_unit(values_of(items, columns), lower, upper, slide, named)
    if found.unit != "deg" or named or not _may_turn_over(items, machine, fast):
        return found
    why = "as rad they turn over, no faster than they may by their velocities, which go with either"
    return PositionUnit("", f"{found.why}; {why}", found.sure, either=True)


def _may_turn_over(
    items: list[Mapped], machine: Machine, fast: Callable[[Mapped], float | None] | None
) -> bool:
    """Whether joints far beyond their ranges are, taken for radians, no faster than they may be."""
    if fast is None:
        return False
    speeds = [(fast(item), machine.speed[_joint_place(item, machine)]) for item in items]
    return all(speed is not None and speed < _FASTER * most for speed, most in speeds)


def of_ranges(found: Guesses, items: list[Mapped], mapping: Map, machine: Machine) -> list[Mapped]:
    """Positions that are shares of the joints' ranges, which the model states."""
    done = []
    for item in items:
        joint = item.target.partition(".")[2]
        at = machine.joints.index(joint)
        low, high = float(machine.lower[at]), float(machine.upper[at])
        if not np.isfinite(high - low):
            found.ask(
                f"{joint} has no range that {item.source} could be a share of",
                f"units: {{{item.channel}: deg}}",
            )
            continue
        # A gripper is counted from its lower end.
        zero, share = (low, 0.01) if "gripper" in joint.lower() else (0.5 * (low + high), 0.005)
        because = f"{item.because}; shares of the model's ranges, which calibration may have had otherwise"
        done.append(scale_channel(item, mapping, share * (high - low), zero, because))
    return done


def _ask_for_shares(found: Guesses, items: list[Mapped], values: Array) -> None:
    """Numbers within ±100 may be degrees or shares of calibrated ranges, and nothing in a data set says which."""
    if np.nanmax(np.abs(values)) <= 100.0:
        found.ask(
            f"{items[0].source} … may be degrees or shares of the joints' calibrated ranges: none is beyond 100",
            'units: {q: deg, q_cmd: deg}, or units: {q: "±100", q_cmd: "±100"} for shares of the ranges in the model '
            "(other ones by scale and offset of each joint)",
        )


def whole_turns(
    items: list[Mapped], columns: dict[str, Column], machine: Machine, factor: float
) -> list[float]:
    """By column, whole turns that bring a joint into its range, where nothing else does [rad]; zero for none.

    Drivers that count angles from 0 to 360 degrees report a joint at -10 as 350.

    Args:
        items: columns of positions.
        columns: by name.
        machine: the robot.
        factor: from the columns' numbers to radians.
    """
    found = []
    for item in items:
        at = machine.joints.index(item.target.partition(".")[2])
        lower, upper = float(machine.lower[at]), float(machine.upper[at])
        values = columns[item.source].values * factor
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        turns = 0.0
        # Damaged numbers may be so large that no sum of two is a number.
        known = np.isfinite([upper - lower, high - low, high + low]).all() and not machine.slides[at]
        if known and max(lower - low, high - upper) > BEYOND:
            turns = 2.0 * np.pi * round((0.5 * (lower + upper) - 0.5 * (low + high)) / (2.0 * np.pi))
            if max(lower - low - turns, high + turns - upper) > BEYOND:
                turns = 0.0
        found.append(float(turns))
    return found
