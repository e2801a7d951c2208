"""Units of positions, measured and commanded: by names, by ranges, or asked for."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.scaled import named_unit, scaled, values_of
from excite.conversion.columns.units import BEYOND, position_unit
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.machine import Machine
from excite.conversion.mapping import Map
from excite.conversion.recording import Column

# LeRobot's servos report the share of the range that they were calibrated in, unless told to report degrees: from
# -100 to 100, grippers from 0 (its ``MotorNormMode``).
SHARE = "±100"


def positions(
    found: Guesses, columns: dict[str, Column], machine: Machine, mapping: Map, *, maybe_shares: bool
) -> dict[str, tuple[str, str]]:
    """Unit and reason for measured and commanded positions."""
    result: dict[str, tuple[str, str]] = {}
    for channel in ("q", "q_cmd"):
        items = found.of(channel)
        if not items:
            continue
        places = [machine.joints.index(item.target.partition(".")[2]) for item in items]
        unit, why, sure = position_unit(
            values_of(items, columns),
            machine.lower[places],
            machine.upper[places],
            machine.slides[places],
            named_unit(items, columns),
        )
        if not sure and channel == "q_cmd" and "q" in result:
            unit, why = result["q"][0], "as the measured positions"
        if mapping.motors:
            # Motors turn beyond what joints do.
            unit, why = named_unit(items, columns) or "rad", "motors' positions"
        elif channel in mapping.units:
            unit = mapping.units[channel]
        elif not unit and channel in mapping.scale:
            unit, why = "rad", "scaled by the map"
        elif channel == "q" and unit == "deg" and maybe_shares and not named_unit(items, columns):
            _ask_for_shares(found, items, values_of(items, columns))
        if not unit:
            found.ask(
                f"the unit of {items[0].source} … cannot be told: {why}",
                f"units: {{{channel}: deg}} (or rev, counts/4096), or motors: [[RATIO, 0 …], …] where they are "
                f"motors' positions, or scale: {{{channel}: FACTOR}}",
            )
            unit = "rad"
        result[channel] = (unit, why)
    return result


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
        done.append(scaled(item, mapping, share * (high - low), zero, because))
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
