"""Factors from the numbers of a recording to SI units, channel by channel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.columns.clock import row_seconds
from excite.conversion.columns.units import (
    BEYOND,
    COUNT_RATES,
    COUNTS,
    NEAR,
    WIDE,
    PositionUnit,
    derivative_of,
    position_unit,
    ratio_unit,
    zero_of,
)
from excite.conversion.columns.words import read_clue
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.recording import Column, Machine, Recording
from excite.logs.units import OF_SLIDING, OF_TURNING, QUANTITY_OF_UNIT, TO_SI, unit_named

# Factors from a recording's numbers to SI, channel by channel.

# Units that velocities are told to be in by the positions' derivative.
_VELOCITIES = {unit: TO_SI[unit] for unit in ("rad/s", "deg/s", "rpm", "rev/s", "mrad/s", "in/s")}
_SLIDING = {unit: TO_SI[unit] for unit in ("m/s", "mm/s", "cm/s", "in/s")}
_FACTORS = TO_SI | COUNT_RATES
# Torques beyond a joint's limit by this are in another unit: gears and servos are not exceeded by an order.
_BEYOND_LIMIT = 30.0
# Gravity may keep the torques of one or two joints on one side; not those of three.
_JOINTS_OF_ONE_SIGN = 3


def convert_units(found: Guesses, recording: Recording, machine: Machine, mapping: Map) -> list[Mapped]:
    """The channels with their factors; what cannot be told is added to ``found.questions``."""
    columns = {c.name: c for stream in recording.streams for c in stream.columns}
    done: list[Mapped] = [item for item in found.mapped if item.target == "time"]
    done += of_imu(found.of("imu"), columns, mapping)
    maybe_shares = bool(recording.said.get("maybe_shares"))
    slope = _position_slopes(found, recording)
    fast = _speeds(found, columns, slope)
    angles = position_units(found, columns, machine, mapping, slope, fast, maybe_shares=maybe_shares)
    for channel in ("q", "q_cmd", "v", "a", "tau", "tau_cmd", "i", "base", "wrench", "contact"):
        everything = found.of(channel)
        if not everything or _left_out(found, everything, columns, mapping, machine):
            continue
        for items in group_by_unit(everything, columns, mapping, machine):
            slide, stated = is_slide(items[0], machine), stated_unit(items, mapping, machine)
            named = named_unit(items, columns, slide=slide)
            if not stated:
                ask_for_kind(found, items, named, mapping)
            if channel in ("q", "q_cmd"):
                for unit, why in dict.fromkeys(angles[item.target] for item in items):
                    part = [item for item in items if angles[item.target] == (unit, why)]
                    because = found.stated_because if stated else why
                    done += (
                        of_ranges(found, part, mapping, machine)
                        if unit == SHARE
                        else _scaled_as(part, mapping, unit, because)
                    )
                continue
            if stated:
                unit, because = stated, "unit stated in the map"
            elif channel in ("v", "a"):
                unit, because = _rate_unit(found, items, columns, recording, angles, named, machine)
            elif channel in ("tau", "tau_cmd"):
                unit, because = _torque_unit(items, columns, machine, named)
            else:
                unit = named or {"i": "A"}.get(channel, "SI")
                because = "unit as named" if named else without_unit(channel, items, columns)
            done += [
                replace(item, unit=stated or named) for item in _scaled_as(items, mapping, unit, because)
            ]
    return done


def _scaled_as(items: list[Mapped], mapping: Map, unit: str, because: str) -> list[Mapped]:
    """Columns of one unit with their factors."""
    factor, zero = _FACTORS.get(unit, 1.0), zero_of(unit)
    return [scale_channel(item, mapping, factor, zero, f"{item.because}; {because}") for item in items]


def _left_out(
    found: Guesses, items: list[Mapped], columns: dict[str, Column], mapping: Map, machine: Machine
) -> bool:
    """Whether commanded torques are none; asks for the sign of torques and currents that have none."""
    channel = items[0].channel
    if channel == "tau_cmd" and not mapping.columns.get(channel) and not stated_unit(items, mapping, machine):
        if _of_one_sign(items, columns):
            # Feed-forward that is switched off, or a magnitude: nothing needs it.
            found.facts.append((channel, items[0].source, "left out: it is never negative"))
            return True
    if channel not in MOTION and not stated_unit(items, mapping, machine):
        _ask_for_sign(found, channel, items, columns, mapping)
    return False


def _ask_for_sign(
    found: Guesses, channel: str, items: list[Mapped], columns: dict[str, Column], mapping: Map
) -> None:
    """Torques or currents of several joints that are never negative are magnitudes, which no equation holds for."""
    # Flags of contact are 0 and 1.
    if channel in ("base", "contact") or len(items) < _JOINTS_OF_ONE_SIGN or channel in mapping.columns:
        return
    if _of_one_sign(items, columns):
        found.ask(
            f"{items[0].source} … are never negative: magnitudes, whose sign was not recorded",
            f'ignore: ["{common_beginning(items)}*"] and log: {{torque: none}}',
        )


def _of_one_sign(items: list[Mapped], columns: dict[str, Column]) -> bool:
    """Whether values of several joints are never negative."""
    values = values_of(items, columns)
    several = len(items) >= _JOINTS_OF_ONE_SIGN
    return several and bool(np.nanmin(values) >= 0.0 and (np.nanmax(values, axis=0) > 0.0).all())


def _rate_unit(
    found: Guesses,
    items: list[Mapped],
    columns: dict[str, Column],
    recording: Recording,
    angles: dict[str, tuple[str, str]],
    named: str,
    machine: Machine,
) -> tuple[str, str]:
    """Unit of velocities or accelerations: what makes them the positions' derivative."""
    channel, slides = items[0].channel, is_slide(items[0], machine)
    of_first = angles.get(f"q.{items[0].target.partition('.')[2]}")
    angle = (next(iter(angles.values())) if of_first is None else of_first)[0]
    if channel == "a":
        usual = {"deg": "deg/s2", "mm": "mm/s2"}.get(angle, "m/s2" if slides else "rad/s2")
        return (named, "unit as named") if named else (usual, "as the positions")
    expected = named or {**dict.fromkeys(COUNTS, "rad/s"), "deg": "deg/s", "m": "m/s", "mm": "mm/s"}.get(
        angle, "m/s" if slides else "rad/s"
    )
    sizes = (_SLIDING if slides else _VELOCITIES) | ({named: TO_SI[named]} if named in TO_SI else {})
    ratio = _rate_ratio(found, items, columns, recording, angles, sizes)
    if ratio is None or ratio[0] is None:
        ask_for_rate(found, items, named)
    if ratio is None:
        return (
            expected,
            "unit as named" if named else "as the positions, with which they do not share a clock",
        )
    unit, value, agreement = ratio
    if unit is None and not np.isfinite(value):
        return expected, "they are not the positions' derivative, to which nothing agrees"
    if unit is None:
        return (
            expected,
            f"they differ from the positions' derivative by a factor of {value / TO_SI.get(expected, 1.0):.3g}",
        )
    if named and abs(np.log((sizes | COUNT_RATES)[unit] / TO_SI.get(named, 1.0))) < 0.1:
        return named, f"as named; they are the positions' derivative (correlation {agreement:.2f})"
    said = f", though its name says {named}" if named else ""
    return unit, f"{unit}: so they are the positions' derivative (correlation {agreement:.2f}){said}"


def _rate_ratio(
    found: Guesses,
    items: list[Mapped],
    columns: dict[str, Column],
    recording: Recording,
    angles: dict[str, tuple[str, str]],
    usual: dict[str, float],
) -> tuple[str | None, float, float] | None:
    positions = {item.target[2:]: item for item in found.of("q")}
    pairs = [(positions[i.target[2:]], i) for i in items if i.target[2:] in positions]
    units = [angles[position.target][0] for position, _ in pairs]
    dt = _row_seconds(found, recording, [item.source for pair in pairs for item in pair])
    if dt is None or any(unit not in TO_SI for unit in units):
        return None
    q = values_of([position for position, _ in pairs], columns) * np.array([TO_SI[unit] for unit in units])
    v = values_of([item for _, item in pairs], columns)
    whole = np.isfinite(q).all(axis=1) & np.isfinite(v).all(axis=1)
    if whole.sum() < 20:
        return None
    counted = units[0] in COUNTS and bool((v[whole] == np.round(v[whole])).all())
    return ratio_unit(q[whole], v[whole], dt, COUNT_RATES if counted else usual)


def _row_seconds(found: Guesses, recording: Recording, names: list[str]) -> float | None:
    """Time from row to row of the stream that holds all columns [s]; None where none does, or time stands still."""
    stream = next((s for s in recording.streams if names and set(names) <= {c.name for c in s.columns}), None)
    if stream is None:
        return None
    time = found.times(stream)
    return None if time is None else row_seconds(time)


def _position_slopes(found: Guesses, recording: Recording) -> Callable[[Mapped], float | None]:
    """Slopes of positions, in the numbers of the file, over their joints' logged velocities."""
    columns = {c.name: c.values for stream in recording.streams for c in stream.columns}
    speeds = {item.target.partition(".")[2]: item for item in found.of("v")}

    def slope(item: Mapped) -> float | None:
        speed = speeds.get(item.target.partition(".")[2])
        dt = None if speed is None else _row_seconds(found, recording, [item.source, speed.source])
        if speed is None or dt is None:
            return None
        q, v = columns[item.source], columns[speed.source]
        whole = np.isfinite(q) & np.isfinite(v)
        if whole.sum() < 20:
            return None
        value, agreement = derivative_of(q[whole], v[whole], dt)
        return abs(value) if agreement > 0.5 else None

    return slope


def _speeds(
    found: Guesses, columns: dict[str, Column], slope: Callable[[Mapped], float | None]
) -> Callable[[Mapped], float | None]:
    """How fast joints are by logged velocities of no stated unit, where these are in that of the positions' numbers."""
    speeds = {item.target.partition(".")[2]: item for item in found.of("v")}

    def fast(item: Mapped) -> float | None:
        value, speed = slope(item), speeds.get(item.target.partition(".")[2])
        if value is None or speed is None or not 1.0 / NEAR < value < NEAR or named_unit([speed], columns):
            return None
        return float(np.nanmax(np.abs(columns[speed.source].values)))

    return fast


def _torque_unit(
    items: list[Mapped], columns: dict[str, Column], machine: Machine, named: str
) -> tuple[str, str]:
    """Unit of torques: as named, or N·mm where they exceed every limit by orders."""
    places = [machine.joints.index(item.target.partition(".")[2]) for item in items]
    largest = np.nanmax(np.abs(values_of(items, columns)), axis=0)
    limits = machine.torque[places]
    if named:
        return named, "unit as named"
    known = np.isfinite(limits)
    beyond = float(np.median(largest[known] / limits[known])) if known.any() else 0.0
    if beyond > _BEYOND_LIMIT:
        return "N·mm", f"N·mm: as N·m they would exceed the joints' limits by {beyond:.0f}"
    return ("N" if machine.slides[places].all() else "N·m"), "no unit stated, within what the joints can do"


# Columns of one channel that are not all in one unit: by names, by a map, or by how far joints can turn.

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


# Columns' numbers, the unit that their names state, and their factors with what a map says on top.

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


# Columns whose names say one quantity and state a unit of another, as ``knee_vel_Nm``: they are asked about.

_CALLED = {
    "q": "positions",
    "v": "velocities",
    "a": "accelerations",
    "tau": "torques or forces",
    "i": "currents",
    "volt": "voltages",
}
_USUAL = {"q": "rad", "v": "rad/s", "a": "rad/s2", "tau": "N·m", "i": "A"}


def ask_for_kind(found: Guesses, items: list[Mapped], named: str, mapping: Map) -> None:
    """Ask what columns of one channel are that state a unit of another quantity.

    An angle's unit of velocities may be short for its rate, which the positions' derivative tells.

    Args:
        found: what is known of the columns; a question is added.
        items: the columns.
        named: the unit that their names state; empty for none.
        mapping: what it scales is in a unit that a person has thought of.
    """
    channel, is_of = items[0].channel, QUANTITY_OF_UNIT.get(named, "")
    own = channel.partition("_")[0]
    if own not in _USUAL or is_of in ("", "time", own) or (own, is_of) == ("v", "q"):
        return
    if {channel, *(item.target for item in items)} & set(mapping.scale):
        return
    found.ask(
        f"{items[0].source} … are {_CALLED[own]} by their names and state {named}, a unit of {_CALLED[is_of]}",
        f"units: {{{channel}: {_USUAL[own]}}} or what they are in, scale: {{{channel}: FACTOR}} to {_USUAL[own]}, or "
        f'ignore: ["{common_beginning(items)}*"]',
    )


def ask_for_rate(found: Guesses, items: list[Mapped], named: str) -> None:
    """Ask for the unit of velocities that state one of positions, where nothing else tells it."""
    if QUANTITY_OF_UNIT.get(named) == "q":
        found.ask(
            f"{items[0].source} … are velocities by their names and state {named}, a unit of positions",
            f"units: {{{items[0].channel}: {named}/s}}",
        )


def common_beginning(items: list[Mapped]) -> str:
    """What the columns' names begin with, all of them; none of it means anything else in a pattern."""
    first, last = (end(item.source for item in items) for end in (min, max))
    same = next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[:same].rstrip("[0123456789") or first[:same]


# Units of positions, measured and commanded: by names, by ranges, or asked for.

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
