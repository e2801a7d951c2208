"""Factors from a recording's numbers to SI, channel by channel."""

from __future__ import annotations

import numpy as np

from excite.conversion.columns.positions import SHARE, of_ranges, positions, whole_turns
from excite.conversion.columns.scaled import named_unit, scaled, values_of
from excite.conversion.columns.units import COUNT_RATES, COUNTS, TO_SI, ratio_unit
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
# Torques beyond a joint's limit by this are in another unit: gears and servos are not exceeded by an order.
_BEYOND_LIMIT = 30.0
# Gravity may keep the torques of one or two joints on one side; not those of three.
_JOINTS_OF_ONE_SIGN = 3


def convert_units(found: Guesses, recording: Recording, machine: Machine, mapping: Map) -> list[Mapped]:
    """The channels with their factors; what cannot be told is added to ``found.questions``."""
    columns = {c.name: c for stream in recording.streams for c in stream.columns}
    done: list[Mapped] = [item for item in found.mapped if item.target == "time"]
    maybe_shares = bool(recording.said.get("maybe_shares"))
    angles = positions(found, columns, machine, mapping, maybe_shares=maybe_shares)
    for channel in ("q", "q_cmd", "v", "a", "tau", "tau_cmd", "i", "base", "wrench", "imu", "contact"):
        items = found.of(channel)
        if not items:
            continue
        stated = str(mapping.units.get(channel, ""))
        named = named_unit(items, columns)
        if stated:
            unit, because = stated, "unit stated in the map"
        elif channel in ("q", "q_cmd"):
            unit, because = angles[channel]
        elif channel in ("v", "a"):
            unit, because = _rates(found, items, columns, recording, angles["q"][0], named, channel)
        elif channel == "tau_cmd" and _of_one_sign(items, columns) and not mapping.columns.get(channel):
            # Feed-forward that is switched off, or a magnitude: nothing needs it.
            found.facts.append((channel, items[0].source, "left out: it is never negative"))
            continue
        elif channel in ("tau", "tau_cmd"):
            _ask_for_sign(found, channel, items, columns, mapping)
            unit, because = _torques(items, columns, machine, named)
        else:
            _ask_for_sign(found, channel, items, columns, mapping)
            unit, because = (
                named or {"i": "A"}.get(channel, "SI"),
                "unit as named" if named else "no unit stated",
            )
        if unit == SHARE:
            done += of_ranges(found, items, mapping, machine)
            continue
        factor = (_VELOCITIES | COUNT_RATES).get(unit, TO_SI.get(unit, 1.0))
        zero = COUNTS[unit][0] if unit in COUNTS else 0.0
        turning = channel in ("q", "q_cmd") and unit in ("rad", "deg") and not mapping.motors
        zeros = whole_turns(items, columns, machine, factor) if turning else [zero] * len(items)
        done += [
            scaled(item, mapping, factor, at, f"{item.because}; {because}{_turned(at) if at != zero else ''}")
            for item, at in zip(items, zeros, strict=True)
        ]
    return done


def _ask_for_sign(
    found: Guesses, channel: str, items: list[Mapped], columns: dict[str, Column], mapping: Map
) -> None:
    """Torques or currents of several joints that are never negative are magnitudes, which no equation holds for."""
    # Flags of contact are 0 and 1.
    if channel == "contact" or len(items) < _JOINTS_OF_ONE_SIGN or channel in mapping.columns:
        return
    if _of_one_sign(items, columns):
        found.ask(
            f"{items[0].source} … are never negative: magnitudes, whose sign was not recorded",
            f'ignore: ["{_beginning(items)}*"] and log: {{torque: none}}',
        )


def _turned(zero: float) -> str:
    return f"; {zero / (2.0 * np.pi):+.0f} turn, which brings the joint into its range"


def _of_one_sign(items: list[Mapped], columns: dict[str, Column]) -> bool:
    """Whether values of several joints are never negative."""
    values = values_of(items, columns)
    several = len(items) >= _JOINTS_OF_ONE_SIGN
    return several and bool(np.nanmin(values) >= 0.0 and (np.nanmax(values, axis=0) > 0.0).all())


def _beginning(items: list[Mapped]) -> str:
    """What the columns' names begin with, all of them; none of it means anything else in a pattern."""
    first, last = (end(item.source for item in items) for end in (min, max))
    same = next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[:same].rstrip("[0123456789") or first[:same]


def _rates(
    found: Guesses,
    items: list[Mapped],
    columns: dict[str, Column],
    recording: Recording,
    angle: str,
    named: str,
    channel: str,
) -> tuple[str, str]:
    """Unit of velocities or accelerations: what makes them the positions' derivative."""
    if channel == "a":
        return (
            (named, "unit as named")
            if named
            else ({"deg": "deg/s2"}.get(angle, "rad/s2"), "as the positions")
        )
    expected = named or {**dict.fromkeys(COUNTS, "rad/s"), "deg": "deg/s", "m": "m/s", "mm": "mm/s"}.get(
        angle, "rad/s"
    )
    ratio = _ratio(found, items, columns, recording, angle)
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
    if named and abs(np.log((_VELOCITIES | COUNT_RATES)[unit] / TO_SI.get(named, 1.0))) < 0.1:
        return named, f"as named; they are the positions' derivative (correlation {agreement:.2f})"
    said = f", though its name says {named}" if named else ""
    return unit, f"{unit}: so they are the positions' derivative (correlation {agreement:.2f}){said}"


def _ratio(
    found: Guesses, items: list[Mapped], columns: dict[str, Column], recording: Recording, angle: str
) -> tuple[str | None, float, float] | None:
    positions = {item.target[2:]: item for item in found.of("q")}
    pairs = [(positions[i.target[2:]], i) for i in items if i.target[2:] in positions]
    stream = next(
        (s for s in recording.streams if pairs and pairs[0][0].source in {c.name for c in s.columns}), None
    )
    if (
        angle not in TO_SI
        or stream is None
        or any(item.source not in {c.name for c in stream.columns} for _, item in pairs)
    ):
        return None
    clock = {item.source: item.factor for item in found.mapped if item.target == "time"}
    time = next((c.values * clock[c.name] for c in stream.columns if c.name in clock), stream.time)
    if time is None:
        return None
    forward = np.diff(time)
    if not (forward > 0.0).any():
        return None
    dt = float(np.median(forward[forward > 0.0]))
    q = values_of([position for position, _ in pairs], columns) * TO_SI[angle]
    v = values_of([item for _, item in pairs], columns)
    whole = np.isfinite(q).all(axis=1) & np.isfinite(v).all(axis=1)
    if whole.sum() < 20:
        return None
    counted = angle in COUNTS and bool((v[whole] == np.round(v[whole])).all())
    return ratio_unit(q[whole], v[whole], dt, COUNT_RATES if counted else _VELOCITIES)


def _torques(
    items: list[Mapped], columns: dict[str, Column], machine: Machine, named: str
) -> tuple[str, str]:
    """Unit of torques: as named, or N·mm where they exceed every limit by orders."""
    places = [machine.joints.index(item.target.partition(".")[2]) for item in items]
    largest = np.nanmax(np.abs(values_of(items, columns)), axis=0)
    limits = machine.torque[places]
    if named:
        return named, "unit as named"
    known = np.isfinite(limits)
    if known.any() and float(np.median(largest[known] / limits[known])) > _BEYOND_LIMIT:
        return (
            "N·mm",
            f"N·mm: as N·m they would exceed the joints' limits by {np.median(largest[known] / limits[known]):.0f}",
        )
    return ("N" if machine.slides[places].all() else "N·m"), "no unit stated, within what the joints can do"
