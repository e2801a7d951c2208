"""Factors from a recording's numbers to SI, channel by channel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from excite.conversion.columns.clock import row_seconds
from excite.conversion.columns.mixed_units import MOTION, group_by_unit, is_slide, stated_unit
from excite.conversion.columns.naming.wrong_kind import ask_for_kind, ask_for_rate, common_beginning
from excite.conversion.columns.positions import SHARE, of_ranges, position_units, whole_turns
from excite.conversion.columns.scaled import named_unit, of_imu, scale_channel, values_of, without_unit
from excite.conversion.columns.units import (
    COUNT_RATES,
    COUNTS,
    NEAR,
    TO_SI,
    derivative_of,
    ratio_unit,
    zero_of,
)
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.machine import Machine
from excite.conversion.mapping import Map
from excite.conversion.recording import Column, Recording

_VELOCITIES = {
    "rad/s": 1.0,
    "deg/s": TO_SI["deg/s"],
    "rpm": TO_SI["rpm"],
    "rev/s": 2.0 * np.pi,
    "mrad/s": 1e-3,
    "in/s": 0.0254,
}
_SLIDING = {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 0.01, "in/s": 0.0254}
_FACTORS = {"m/s2": 1.0, "mm/s2": 1e-3} | TO_SI | _VELOCITIES | _SLIDING | COUNT_RATES
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
                    done += _of_positions(found, part, columns, machine, mapping, unit, because)
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


def _of_positions(
    found: Guesses,
    items: list[Mapped],
    columns: dict[str, Column],
    machine: Machine,
    mapping: Map,
    unit: str,
    because: str,
) -> list[Mapped]:
    """Positions of one unit, with whole turns that bring them into their ranges."""
    if unit == SHARE:
        return of_ranges(found, items, mapping, machine)
    factor, zero = _FACTORS.get(unit, 1.0), zero_of(unit)
    turning = unit in ("rad", "deg") and not mapping.motors
    zeros = whole_turns(items, columns, machine, factor) if turning else [zero] * len(items)
    return [
        scale_channel(
            item, mapping, factor, at, f"{item.because}; {because}{_describe_turn(at) if at != zero else ''}"
        )
        for item, at in zip(items, zeros, strict=True)
    ]


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


def _describe_turn(zero: float) -> str:
    return f"; {zero / (2.0 * np.pi):+.0f} turn, which brings the joint into its range"


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
