"""Units of columns: the words and grammar of units, and units told by names, ranges and derivatives."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.vocabulary import COMMANDED, MEASURED, OF_WORD

# Units as people put them together: ``rad s^-1``, ``deg_per_s``, ``mN·m``, ``kgf cm``, ``ozf-in``, ``mmps2``.

# Powers of angle, length, time, force and current.
Dimension = tuple[int, int, int, int, int]
_ANGLE, _LENGTH, _TIME = (1, 0, 0, 0, 0), (0, 1, 0, 0, 0), (0, 0, 1, 0, 0)
_FORCE, _CURRENT = (0, 0, 0, 1, 0), (0, 0, 0, 0, 1)
_G = 9.80665
_POUND = 0.45359237 * _G


class Parsed(NamedTuple):
    """What a unit is of, and its size.

    Attributes:
        dimension: powers of angle, length, time, force and current.
        factor: to rad, m, s, N and A.
    """

    dimension: Dimension
    factor: float


def _named_dimension(dimension: Dimension, **sizes: tuple[float, str]) -> dict[str, Parsed]:
    return {word: Parsed(dimension, size) for size, words in sizes.values() for word in words.split()}


_WORDS: dict[str, Parsed] = {
    **_named_dimension(
        _ANGLE,
        rad=(1.0, "rad rads radian radians"),
        mrad=(1e-3, "mrad milliradian milliradians"),
        deg=(math.pi / 180.0, "deg degs degree degrees ° grad"),
        mdeg=(math.pi / 180e3, "mdeg millideg millidegree millidegrees"),
        minute=(math.pi / 10_800.0, "arcmin arcmins arcminute arcminutes"),
        second=(math.pi / 648e3, "arcsec arcsecs arcsecond arcseconds"),
        turn=(2.0 * math.pi, "rev revs turn turns revolution revolutions umdrehungen cycle cycles u r"),
    ),
    **_named_dimension(
        _LENGTH,
        m=(1.0, "m meter meters metre metres"),
        cm=(1e-2, "cm centimeter centimeters centimetre centimetres"),
        mm=(1e-3, "mm millimeter millimeters millimetre millimetres"),
        um=(1e-6, "um µm micron microns micrometer micrometers micrometre micrometres"),
        inch=(0.0254, "in inch inches"),
        ft=(0.3048, "ft foot feet"),
    ),
    **_named_dimension(
        _TIME,
        s=(1.0, "s sec secs second seconds"),
        ms=(1e-3, "ms msec millisecond milliseconds"),
        minute=(60.0, "min minute minutes"),
    ),
    **_named_dimension(
        _FORCE,
        n=(1.0, "n newton newtons"),
        kn=(1e3, "kn kilonewton kilonewtons"),
        cn=(1e-2, "cn"),
        mn=(1e-3, "mn millinewton millinewtons"),
        un=(1e-6, "un µn micronewton micronewtons"),
        kgf=(_G, "kgf kg kp"),
        gf=(1e-3 * _G, "gf g"),
        lbf=(_POUND, "lbf lb lbs"),
        ozf=(_POUND / 16.0, "ozf oz"),
    ),
    **_named_dimension(
        _CURRENT,
        a=(1.0, "a amp amps ampere amperes arms"),
        ma=(1e-3, "ma milliamp milliamps milliampere milliamperes mamp mamps"),
        ua=(1e-6, "ua µa microamp microamps"),
    ),
}
# Written without anything between numerator and denominator; a minute's is that of turns.
_RATES = {"rpm": "rev/min", "rps": "rev/s", "dps": "deg/s", "ips": "in/s"}
_POWERS = str.maketrans(
    {"⁻": "-", "¹": "1", "²": "2", "³": "3", "−": "-", "·": "*", "⋅": "*", "•": "*", "×": "*"}
)
_POWERS |= {ord("μ"): "µ"}
_TERM = re.compile(r"([a-zµ°]+)(?:\^?([+-]?\d)(?![\d.]))?")
_NUMBER = re.compile(r"(.*?)((?:[_ .\[(]+\d+[\])]*)?\s*)$", re.DOTALL)
_EDGES = " _./:,-"
# Words that names use for other things.
_OTHERWISE = frozenset("u r in g a cycle cycles second seconds turn".split())
_BETWEEN = re.compile(r"\s*(/|\*|\.|_per_|\bper\b|[-_ ])\s*")
# What a unit of a joint's motion or load can be of.
KINDS: dict[Dimension, str] = {
    _ANGLE: "q",
    _LENGTH: "q",
    (1, 0, -1, 0, 0): "v",
    (0, 1, -1, 0, 0): "v",
    (1, 0, -2, 0, 0): "a",
    (0, 1, -2, 0, 0): "a",
    (0, 1, 0, 1, 0): "tau",
    _FORCE: "tau",
    _CURRENT: "i",
}


def parse_unit(text: str) -> Parsed | None:
    """A unit put together of others that is one of a joint's motion or load; None for anything else.

    What stands between two parts as in names of columns, a blank or an underscore, multiplies them (``N_m``) where that
    is such a unit, and else divides them (``deg_s``).
    """
    text = re.sub(r"(?<=[a-z])\s*\*\*\s*(?=[+-]?\d)", "^", text.strip().lower().translate(_POWERS))
    parts = _split_unit(text)
    for loose in (1, -1):
        whole = _combine_parts(parts, loose) if parts else None
        if whole is not None and whole.dimension in KINDS:
            return whole
    return None


def trailing_compound(text: str) -> tuple[str, str]:
    """A name without the unit of several parts at its end, and that unit; the joint's number may stand behind it.

    What is parted by blanks, dots and underscores is one only where no part has another meaning in names: ``r_s`` may
    be the right side's, ``in`` an input.
    """
    body, number = _NUMBER.match(text).groups()  # type: ignore[union-attr]
    body = body.rstrip(_EDGES)
    for at in (match.end() for match in re.finditer(r"(?<=.)[_ ./:,-]+", body)):
        unit = body[at:]
        parsed = parse_unit(unit)
        if parsed is not None and sum(x != 0 for x in parsed.dimension) > 1 and _is_plain(unit):
            return body[:at].rstrip(_EDGES) + number, unit
    return text, ""


def _is_plain(unit: str) -> bool:
    parts = _split_unit(unit.strip().lower().translate(_POWERS))
    written = "/" in unit or "per" in unit.lower() or "^" in unit
    words = {word for _, word, _ in parts}
    alone = words & _OTHERWISE and not (words & {"in"} and words & {"oz", "ozf", "lb", "lbf"})
    return written or not alone


def _split_unit(text: str) -> list[tuple[str, str, int]]:
    """What stands before each word, the word, and its power; empty for what is no such row."""
    found: list[tuple[str, str, int]] = []
    between, at = "", 0
    while at < len(text):
        term = _TERM.match(text, at)
        if term is None:
            return []
        found.append((between, term[1], int(term[2] or 1)))
        at = term.end()
        if at < len(text):
            joint = _BETWEEN.match(text, at)
            if joint is None or joint.end() == len(text):
                return []
            between, at = joint[1].strip("_ ") or "_", joint.end()
    return found


def _combine_parts(parts: list[tuple[str, str, int]], loose: int) -> Parsed | None:
    dimension, factor = [0] * 5, 1.0
    for between, word, power in parts:
        one = _parse_word(word, power)
        if one is None:
            return None
        # A power that is written as negative divides already.
        sign = -1 if between in ("/", "per") or (between in ("_", "-") and loose < 0 and power > 0) else 1
        dimension = [a + sign * b for a, b in zip(dimension, one.dimension, strict=True)]
        factor *= one.factor**sign
    a, b, c, d, e = dimension
    return Parsed((a, b, c, d, e), factor)


def _parse_word(word: str, power: int) -> Parsed | None:
    """A word with its power: a unit, a rate (``radps``, with the power of its time) or a torque (``mnm``)."""
    if power != 1 and word in ("rads", "degs"):
        # rads2, rads-1: a second that is written on to the angle.
        return Parsed((1, 0, -abs(power), 0, 0), _WORDS[word].factor)
    if word in _WORDS:
        one = _WORDS[word]
        return Parsed(_multiply_dimension(one.dimension, power), one.factor**power)
    if word[-3:] in _RATES and word[:-3] in ("", "k") and power == 1:
        rate = parse_unit(_RATES[word[-3:]])
        return None if rate is None else Parsed(rate.dimension, rate.factor * (1e3 if word[:-3] else 1.0))
    for mark in ("per", "p"):
        above, found, below = word.rpartition(mark)
        if found and above in _WORDS and below in _WORDS and _WORDS[below].dimension == _TIME and power > 0:
            one, time = _WORDS[above], _WORDS[below]
            powers = zip(one.dimension, _multiply_dimension(time.dimension, power), strict=True)
            a, b, c, d, e = (x - y for x, y in powers)
            return Parsed((a, b, c, d, e), one.factor / time.factor**power)
    for at in range(1, len(word)):
        first, second = _WORDS.get(word[:at]), _WORDS.get(word[at:])
        if first and second and {first.dimension, second.dimension} == {_FORCE, _LENGTH} and power == 1:
            return Parsed((0, 1, 0, 1, 0), first.factor * second.factor)
    return None


def _multiply_dimension(dimension: Dimension, power: int) -> Dimension:
    a, b, c, d, e = (power * x for x in dimension)
    return a, b, c, d, e


# Units of positions, velocities and torques: by their names, by ranges, by the derivative of the positions.

TO_SI = {
    "rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi, "m": 1.0, "mm": 1e-3,
    "rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.pi / 30.0, "m/s": 1.0, "mm/s": 1e-3,
    "rad/s2": 1.0, "deg/s2": math.pi / 180.0,
    "N·m": 1.0, "N·mm": 1e-3, "N": 1.0, "A": 1.0, "mA": 1e-3,
    "N·cm": 0.01, "kN·m": 1e3, "kN": 1e3, "kgf·cm": 0.0980665, "ozf·in": 0.0070615518, "lbf·in": 0.11298483,
    "lbf·ft": 1.3558179, "mrad": 1e-3, "cm": 0.01, "rev/s": 2.0 * math.pi, "mrad/s": 1e-3,
    "lb": 4.4482216, "kip": 4448.2216, "in": 0.0254, "in/s": 0.0254,
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "d": 86_400.0,
    "counts/4096": 2.0 * math.pi / 4096.0, "counts/1024": math.radians(300.0) / 1024.0,
    "mdeg": math.pi / 180e3, "arcmin": math.pi / 10_800.0, "arcsec": math.pi / 648e3, "µm": 1e-6, "ft": 0.3048,
    "µA": 1e-6, "kgf": 9.80665, "ozf": 0.27801385,
}  # fmt: skip
COMPOUND: dict[tuple[Dimension, float], str] = {}
"""Units that are put together, by what they are of and the logarithm of their size."""


def _put_together() -> None:
    """Name every rate, torque and acceleration of the units above that has no name yet."""
    angles, lengths = (
        ("rad", "deg", "rev", "mrad", "mdeg", "arcmin", "arcsec"),
        ("m", "mm", "cm", "in", "µm", "ft"),
    )
    rates = [f"{unit}/{time}" for time in ("s", "s2") for unit in (*angles, *lengths)]
    torques = [
        f"{force}·{arm}" for force in ("N", "kN", "mN", "µN", "kgf", "gf", "lbf", "ozf") for arm in lengths
    ]
    for name in (*tuple(TO_SI), *rates, "rpm/s", "krpm", "µN·m", *torques):
        parsed = parse_unit(name)
        if parsed is not None and sum(power != 0 for power in parsed.dimension) > 1:
            key = parsed.dimension, round(math.log(parsed.factor), 3)
            if key not in COMPOUND:
                TO_SI.setdefault(name, parsed.factor)
                COMPOUND[key] = name


_put_together()
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


class PositionUnit(NamedTuple):
    """Unit of positions.

    Attributes:
        unit: empty where names and ranges contradict each other.
        why: in words.
        sure: whether nothing else is possible.
        either: whether radians and degrees both are, and nothing else.
    """

    unit: str
    why: str
    sure: bool
    either: bool = False


def zero_of(unit: str) -> float:
    """What a position is at its unit's number zero [rad]: the beginning of the range where servos count."""
    return COUNTS[unit][0] if unit in COUNTS else 0.0


def position_unit(values: Array, lower: Array, upper: Array, slides: Array, stated: str) -> PositionUnit:
    """Unit of positions, and how it is known.

    Args:
        values: ``(n, k)`` as they stand in the file, columns of joints that turn or slide.
        lower: ``(k,)`` ends of the joints' ranges, ``upper`` too [rad or m]; infinite where they are not known.
        slides: ``(k,)`` which joints slide.
        stated: what names say; empty for nothing.
    """
    small, large = ("m", "mm") if slides.all() else ("rad", "deg")
    turning = np.logical_not(slides) if not slides.all() else slides
    low, high = (np.nanmin(values[:, turning], axis=0), np.nanmax(values[:, turning], axis=0))
    factor = TO_SI[large]
    outside = _share_outside(low, high, lower[turning], upper[turning])
    outside_large = _share_outside(low * factor, high * factor, lower[turning], upper[turning])
    span = float(np.max(high - low))
    if stated in TO_SI:
        turned = (
            0.0 if slides.all() else _turns_beyond((high - low) * TO_SI[stated], (upper - lower)[turning])
        )
        beyond = {small: outside, large: outside_large}
        return _as_stated(stated, beyond.get(stated, 0.0), min(beyond.values()), turned)
    if outside > BEYOND and outside_large <= BEYOND and span * factor >= _NO_MOTION:
        # Zeros of joints are often elsewhere than the model's, and ranges stated too narrow: then radians fit, too, and
        # move them far more.
        elsewhere = bool(((high - low) <= (upper - lower)[turning]).all())
        if small == "rad" and (elsewhere or outside <= _TOO_NARROW):
            return PositionUnit(
                "",
                f"as deg joints move by {span:.2g} degrees at most, as rad they leave their ranges by {outside:.3g}, "
                f"as joints do whose {'zeros' if elsewhere else 'ranges'} are not the model's",
                True,
                either=True,
            )
        return PositionUnit(
            large, f"{large}: as {small} joints would leave their ranges by {outside:.3g}", True
        )
    counted = _servo_counts(values[:, turning], lower[turning], upper[turning]) if small == "rad" else ""
    if counted and min(outside, outside_large) > BEYOND:
        why = f"{counted} of a turn: whole numbers, with which the joints keep their ranges"
        return PositionUnit(counted, why, True)
    if min(outside, outside_large) > 4.0 * math.pi and np.isfinite(lower[turning]).any():
        return PositionUnit(
            "",
            f"joints leave their ranges by {outside:.3g} in {small} and by {outside_large:.3g} in {large}",
            True,
        )
    if outside <= BEYOND and (outside_large > BEYOND or span * factor < _NO_MOTION):
        return PositionUnit(small, f"{small}: within the joints' ranges", True)
    if span > (WIDE if small == "rad" else 10.0):
        return PositionUnit(large, f"{large}: the columns span {span:.3g}", False)
    return PositionUnit(small, f"{small}: the columns span {span:.3g}", False)


def _share_outside(low: Array, high: Array, lower: Array, upper: Array) -> float:
    return float(max(np.max(lower - low), np.max(high - upper), 0.0))


def _turns_beyond(spans: Array, ranges: Array) -> float:
    """By how much joints turn farther than their ranges, where these are known [rad]."""
    known = np.isfinite(ranges) & np.isfinite(spans)
    return float(np.max((spans - ranges)[known], initial=0.0))


def _as_stated(stated: str, outside: float, least: float, turned: float) -> PositionUnit:
    """The unit that names say; none where joints would be where they cannot.

    Args:
        stated: what names say.
        outside: by how much joints leave their ranges in that unit.
        least: and in the better one of the two usual units.
        turned: by how much they turn farther than their ranges are wide [rad].
    """
    if outside > 20.0 * max(least, BEYOND):
        why = f"as {stated}, which their names say, joints leave their ranges by {outside:.3g}"
        return PositionUnit("", why, True)
    if turned > _MOTORS:
        why = f"as {stated}, which their names say, joints turn by {turned:.3g} rad more than their ranges"
        return PositionUnit("", why, True)
    return PositionUnit(stated, f"{stated} by its name", True)


def _servo_counts(values: Array, lower: Array, upper: Array) -> str:
    """The servo's counts that whole numbers are, with which joints keep their ranges; empty for none."""
    known = values[np.isfinite(values).all(axis=1)]
    if not len(known) or (known != np.round(known)).any() or known.min() < 0.0:
        return ""
    for unit, (zero, count) in COUNTS.items():
        low, high = (end * TO_SI[unit] + zero for end in (known.min(axis=0), known.max(axis=0)))
        if known.max() < count and _share_outside(low, high, lower, upper) <= BEYOND:
            return unit
    return ""


class RatioUnit(NamedTuple):
    """Unit of a column by the derivative of another one.

    Attributes:
        unit: None for none.
        ratio: of derivative to column, median over joints.
        correlation: the least of both.
    """

    unit: str | None
    ratio: float
    correlation: float


def ratio_unit(q: Array, v: Array, dt: float, units: dict[str, float]) -> RatioUnit:
    """The unit in which a column is the derivative of a position.

    Args:
        q: ``(n, k)`` positions [rad or m]; ``v`` the columns as they stand in the file.
        dt: between rows [s].
        units: candidates, factor to SI by name.
    """
    ratios, agreements = [], []
    for k in range(q.shape[1]):
        slope, agreement = derivative_of(q[:, k], v[:, k], dt)
        if agreement > 0.5:
            ratios.append(slope)
            agreements.append(agreement)
    if not ratios:
        return RatioUnit(None, float("nan"), 0.0)
    ratio = float(np.median(np.abs(ratios)))
    near = min(units, key=lambda unit: abs(math.log(ratio / units[unit])))
    found = near if abs(math.log(ratio / units[near])) < math.log(NEAR) else None
    return RatioUnit(found, ratio, float(np.min(agreements)))


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


# Units as drivers, vendors' loggers and people write them, and what each is a unit of.

# Units by how they are written, lower case; the word after the name or in brackets.
UNITS: dict[str, str] = {
    **dict.fromkeys(("rad", "radian", "radians", "rads"), "rad"),
    **dict.fromkeys(("deg", "degs", "degree", "degrees", "°", "grad"), "deg"),
    **dict.fromkeys(
        ("rev", "revs", "turn", "turns", "revolution", "revolutions", "umdrehungen", "cycles"), "rev"
    ),
    **dict.fromkeys(("mdeg", "millideg", "millidegree", "millidegrees"), "mdeg"),
    **dict.fromkeys(("arcmin", "arcminutes"), "arcmin"),
    **dict.fromkeys(("arcsec", "arcseconds"), "arcsec"),
    **dict.fromkeys(("um", "µm", "micron", "microns", "micrometer"), "µm"),
    # How many are a turn, no name says.
    **dict.fromkeys(("counts", "count", "cnt", "ticks", "enccounts"), "counts"),
    **dict.fromkeys(("mrad", "milliradian", "milliradians"), "mrad"),
    **dict.fromkeys(("cm", "centimeter", "centimetre"), "cm"),
    # What is put together of several is read by its parts; here are words of it that names are cut into.
    **dict.fromkeys(("rps", "revps"), "rev/s"),
    "mradps": "mrad/s",
    **dict.fromkeys(("rad/s", "radps", "rad_s", "radpersec"), "rad/s"),
    **dict.fromkeys(("deg/s", "degps", "deg_s", "dps"), "deg/s"),
    **dict.fromkeys(("rpm", "1/min", "min^-1", "min-1"), "rpm"),
    **dict.fromkeys(("rad/s2", "radps2"), "rad/s2"),
    **dict.fromkeys(("deg/s2", "degps2"), "deg/s2"),
    **dict.fromkeys(("nm", "n_m", "newtonmeter"), "N·m"),
    **dict.fromkeys(("mnm", "nmm"), "N·mm"),
    **dict.fromkeys(("ncm", "cnm"), "N·cm"),
    "knm": "kN·m",
    **dict.fromkeys(("unm", "µnm"), "µN·m"),
    **dict.fromkeys(("kgcm", "kgfcm"), "kgf·cm"),
    **dict.fromkeys(("kgm", "kgfm"), "kgf·m"),
    **dict.fromkeys(("gcm", "gfcm"), "gf·cm"),
    **dict.fromkeys(("ozin", "ozfin"), "ozf·in"),
    **dict.fromkeys(("lbin", "lbfin", "inlb", "inlbf"), "lbf·in"),
    **dict.fromkeys(("lbft", "lbfft", "ftlb", "ftlbf"), "lbf·ft"),
    **dict.fromkeys(("kn", "kilonewton"), "kN"),
    **dict.fromkeys(("a", "amp", "amps", "ampere", "amperes", "arms"), "A"),
    **dict.fromkeys(("ma", "milliamp", "milliamps", "milliampere", "milliamperes", "mamp"), "mA"),
    **dict.fromkeys(("ua", "µa", "microamp", "microamps"), "µA"),
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "µs", "usec", "usecs", "micros", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanoseconds"), "ns"),
    **dict.fromkeys(("day", "days"), "d"),
    **dict.fromkeys(("m", "meter", "metre", "meters"), "m"),
    **dict.fromkeys(("mm", "millimeter"), "mm"),
    "mps": "m/s",
    "mmps": "mm/s",
    **dict.fromkeys(("n", "newton"), "N"),
    **dict.fromkeys(("lb", "lbf"), "lb"),
    **dict.fromkeys(("kip", "kips"), "kip"),
    **dict.fromkeys(("in", "inch"), "in"),
    **dict.fromkeys(("inps", "ips"), "in/s"),
    **dict.fromkeys(("v", "volt", "volts"), "V"),
    **dict.fromkeys(("%", "‰", "percent", "per cent", "% rated", "%rated", "p.u.", "pu"), "%"),
}
QUANTITY_OF_UNIT = {
    **{name: KINDS[dimension] for (dimension, _), name in COMPOUND.items()},
    **dict.fromkeys(
        ("rad", "deg", "rev", "mrad", "mdeg", "arcmin", "arcsec", "m", "mm", "cm", "µm", "in", "ft"), "q"
    ),
    **dict.fromkeys(("N", "kN", "lb", "kip", "kgf", "ozf"), "tau"),
    **dict.fromkeys(("A", "mA", "µA"), "i"),
    "counts": "q",
    "V": "volt",
    **dict.fromkeys(("s", "ms", "us", "ns", "d"), "time"),
}
# Units of how joints move that slide, and that turn.
OF_SLIDING = frozenset(
    {
        *("m", "mm", "cm", "µm", "in", "ft", "N", "kN", "lb", "kip", "kgf", "ozf"),
        *(name for (dimension, _), name in COMPOUND.items() if not dimension[0] and not dimension[3]),
    }
)
OF_TURNING = (
    frozenset(n for n, of in QUANTITY_OF_UNIT.items() if of in ("q", "v", "a", "tau"))
    - OF_SLIDING
    - {"counts"}
)


def unit_named(text: str) -> str:
    """The unit that a text is, in this package's spelling; empty where it is none."""
    bare = text.strip().lower()
    parsed = None if bare in UNITS else parse_unit(text)
    if parsed is None or sum(power != 0 for power in parsed.dimension) < 2:
        return UNITS.get(bare, "")
    return COMPOUND.get((parsed.dimension, round(math.log(parsed.factor), 3)), "")


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


def of_both(words: list[str], unit: str) -> tuple[list[str], str, str]:
    """A unit of joints that turn and one of those that slide, where a name ends with both: ``pos_deg_mm``."""
    others, before = trailing_unit(words)
    for turning, sliding in ((before, unit), (unit, before)):
        if (
            turning in OF_TURNING
            and QUANTITY_OF_UNIT[turning] == QUANTITY_OF_UNIT.get(sliding)
            and sliding in OF_SLIDING
        ):
            return others, turning, sliding
    return words, unit, ""
