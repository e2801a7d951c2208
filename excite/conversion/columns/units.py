"""Units of columns: told by names, by ranges of joints and by derivatives of positions."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np

from excite.arrays import Array, is_whole
from excite.conversion.columns.vocabulary import COMMANDED, MEASURED, OF_WORD
from excite.logs.units import TO_SI, UNITS, trailing_compound, unit_named

# Servos count from the end of their range, with zero in its middle: Dynamixel's X and MX, Feetech's STS over a turn;
# Dynamixel's AX, Feetech's SCS over 300 degrees (their control tables). Zeros of counts [rad], and how many there are.
COUNTS = {"counts/1024": (-math.radians(150.0), 1024), "counts/4096": (-math.pi, 4096)}
# Velocities that their control tables have one unit of.
COUNT_RATES = {
    "0.229 rpm": 0.229 * math.pi / 30.0,
    "0.111 rpm": 0.111 * math.pi / 30.0,
    "0.114 rpm": 0.114 * math.pi / 30.0,
    "0.732 rpm": 0.732 * math.pi / 30.0,
    "counts/4096/s": 2.0 * math.pi / 4096.0,
}
# A joint's stated range may be a little off, and people drive beyond it by calibration's errors [rad or m].
BEYOND = 0.2
# A recording whose widest joint moves by less than a degree is none; zeros of joints are off by more [rad or m].
_NO_MOTION = 0.02
# Turns that joints without stated range make: three turns are more than any arm's.
WIDE = 6.0 * math.pi
# A range that is stated too narrow lacks no more than a turn, and joints that move by more than their ranges and two
# turns are motors before their gears [rad].
_TOO_NARROW = 2.0 * math.pi
_MOTORS = 2.0 * _TOO_NARROW
# How near a ratio of velocity and derivative has to be to that of two units, as a factor.
NEAR = 1.15
# What is larger is a damaged number, whose square no float holds.
_LARGEST = 1e30


class Told(NamedTuple):
    """The unit of columns.

    Attributes:
        unit: empty where names and ranges contradict each other.
        why: in words.
        sure: whether nothing else is possible.
        either: whether radians and degrees both are, and nothing else.
    """

    unit: str
    why: str
    sure: bool = False
    either: bool = False


def position_unit(values: Array, lower: Array, upper: Array, slides: Array, stated: str) -> Told:
    """Unit of positions, and how it is known.

    Args:
        values: ``(n, k)`` as they stand in the file, columns of joints that turn or slide.
        lower: ``(k,)`` ends of the joints' ranges, ``upper`` too [rad or m]; infinite where they are not known.
        slides: ``(k,)`` which joints slide.
        stated: what names say; empty for nothing.
    """
    small, large = ("m", "mm") if slides.all() else ("rad", "deg")
    kind = slides if slides.all() else np.logical_not(slides)
    values, lower, upper = values[:, kind], lower[kind], upper[kind]
    low, high, ranges = np.nanmin(values, axis=0), np.nanmax(values, axis=0), upper - lower

    def beyond(unit: str) -> float:
        """By how much joints leave their ranges in a unit."""
        zero = COUNTS[unit][0] if unit in COUNTS else 0.0
        ends = low * TO_SI[unit] + zero, high * TO_SI[unit] + zero
        return float(max(np.max(lower - ends[0]), np.max(ends[1] - upper), 0.0))

    span, outside, outside_large = float(np.max(high - low)), beyond(small), beyond(large)
    least = min(outside, outside_large)
    moves = span * TO_SI[large] >= _NO_MOTION
    if stated in TO_SI:
        first = f"as {stated}, which their names say, joints"
        turned = ((high - low) * TO_SI[stated] - ranges)[np.isfinite(ranges) & np.isfinite(high - low)]
        if stated in (small, large) and beyond(stated) > 20.0 * max(least, BEYOND):
            return Told("", f"{first} leave their ranges by {beyond(stated):.3g}", True)
        if small == "rad" and (most := float(np.max(turned, initial=0.0))) > _MOTORS:
            return Told("", f"{first} turn by {most:.3g} rad more than their ranges", True)
        return Told(stated, f"{stated} by its name", True)
    if outside > BEYOND >= outside_large and moves:
        # Zeros of joints are often elsewhere than the model's, and ranges stated too narrow: then radians fit, too, and
        # move them far more.
        elsewhere = bool((high - low <= ranges).all())
        if small == "rad" and (elsewhere or outside <= _TOO_NARROW):
            why = (
                f"as deg joints move by {span:.2g} degrees at most, as rad they leave their ranges by {outside:.3g}, "
                f"as joints do whose {'zeros' if elsewhere else 'ranges'} are not the model's"
            )
            return Told("", why, True, either=True)
        return Told(large, f"{large}: as {small} joints would leave their ranges by {outside:.3g}", True)
    known = values[np.isfinite(values).all(axis=1)]
    fitting = [
        unit
        for unit in COUNTS
        if small == "rad" and least > BEYOND >= beyond(unit) and _is_count(known, unit)
    ]
    if fitting:
        why = f"{fitting[0]} of a turn: whole numbers, with which the joints keep their ranges"
        return Told(fitting[0], why, True)
    if least > 4.0 * math.pi and np.isfinite(lower).any():
        both = f"by {outside:.3g} in {small} and by {outside_large:.3g} in {large}"
        return Told("", f"joints leave their ranges {both}", True)
    if outside <= BEYOND and (outside_large > BEYOND or not moves):
        return Told(small, f"{small}: within the joints' ranges", True)
    unit = large if span > (WIDE if small == "rad" else 10.0) else small
    return Told(unit, f"{unit}: the columns span {span:.3g}")


def _is_count(known: Array, unit: str) -> bool:
    """Whether numbers are a servo's counts."""
    whole = len(known) > 0 and is_whole(known)
    return whole and bool(known.min() >= 0.0 and known.max() < COUNTS[unit][1])


def derivative_of(q: Array, v: Array, dt: float) -> tuple[float, float]:
    """Slope of ``dq/dt`` over ``v`` and their correlation, both smoothed alike; zeros where one stands still."""
    if max(np.abs(q).max(), np.abs(v).max()) > _LARGEST:
        return 0.0, 0.0
    window = max(3, int(0.05 / dt)) if dt < 0.05 else 3
    kernel = np.ones(window) / window
    rate = np.gradient(np.convolve(q, kernel, mode="valid"), dt)
    other = np.convolve(v, kernel, mode="valid")
    rate, other = rate - rate.mean(), other - other.mean()
    power, cross = float(other @ other), float(rate @ other)
    if power <= 0.0 or float(rate @ rate) <= 0.0:
        return 0.0, 0.0
    return cross / power, abs(cross) / math.sqrt(power * float(rate @ rate))


# Units in names: in brackets, at the end, of several parts.


def without_brackets(name: str) -> tuple[str, str]:
    """A name without the unit in its brackets, and the unit."""
    match = re.search(r"[\[(<{]\s*([^\[\](){}<>]+?)\s*[\])>}]\s*$", name)
    if match and not match[1].strip().isdigit():
        unit = unit_named(match[1])
        if unit:
            return name[: match.start()], unit
    match = re.search(r"\s*([%‰])\s*$", name)
    if match:
        return name[: match.start()], UNITS[match[1]]
    return name, ""


def without_compound(name: str) -> tuple[str, str]:
    """A name without the unit of several parts at its end, ``torque_N_mm`` or ``speed rad s^-1``, and the unit."""
    rest, written = trailing_compound(name)
    unit = unit_named(written)
    return (rest, unit) if unit else (name, "")


def trailing_unit(words: list[str]) -> tuple[list[str], str]:
    """The unit that a name ends with, where another word says the quantity."""
    for count in (2, 1):
        if len(words) > count:
            unit = UNITS.get("_".join(words[-count:]), "")
            others = set(words[:-count]) & (frozenset(OF_WORD) | COMMANDED | MEASURED)
            if unit in ("in", "counts") and not {OF_WORD.get(word) for word in words[:-count]} & {"q"}:
                # Of anything but a length, ``in`` is an input; ticks may be a clock's.
                continue
            if unit and (others or count == 2 or len(words[-1]) > 1):
                return words[:-count], unit
    return words, ""
