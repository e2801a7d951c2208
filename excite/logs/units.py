"""Units of recordings: one table of them, the words that they are written in, and the grammar of compound ones."""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

# Powers of angle, length, time, force and current.
Dimension = tuple[int, int, int, int, int]
_ANGLE, _LENGTH, _TIME = (1, 0, 0, 0, 0), (0, 1, 0, 0, 0), (0, 0, 1, 0, 0)
_FORCE, _CURRENT = (0, 0, 0, 1, 0), (0, 0, 0, 0, 1)
_NONE = (0, 0, 0, 0, 0)
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


class Unit(NamedTuple):
    """A row of the table of units.

    Attributes:
        name: in this package's spelling; empty for what stands in compound units alone.
        dimension: what it is of.
        size: in rad, m, s, N or A; nan where no name says it.
        words: lower case, by which it is written alone and in compound units.
        alone: words of it alone.
        inside: words of it in compound units alone.
    """

    name: str
    dimension: Dimension
    size: float
    words: str = ""
    alone: str = ""
    inside: str = ""


TABLE = (
    Unit("rad", _ANGLE, 1.0, "rad radian radians rads"),
    Unit("deg", _ANGLE, math.pi / 180.0, "deg degs degree degrees ° grad"),
    Unit("rev", _ANGLE, math.tau, "rev revs turn turns revolution revolutions umdrehungen cycles", "", "u r cycle"),
    Unit("mrad", _ANGLE, 1e-3, "mrad milliradian milliradians"),
    Unit("mdeg", _ANGLE, math.pi / 180e3, "mdeg millideg millidegree millidegrees"),
    Unit("arcmin", _ANGLE, math.pi / 10_800.0, "arcmin arcminutes", "", "arcmins arcminute"),
    Unit("arcsec", _ANGLE, math.pi / 648e3, "arcsec arcseconds", "", "arcsecs arcsecond"),
    Unit("m", _LENGTH, 1.0, "m meter metre meters", "", "metres"),
    Unit("cm", _LENGTH, 1e-2, "cm centimeter centimetre", "", "centimeters centimetres"),
    Unit("mm", _LENGTH, 1e-3, "mm millimeter", "", "millimeters millimetre millimetres"),
    Unit("µm", _LENGTH, 1e-6, "um µm micron microns micrometer", "", "micrometers micrometre micrometres"),
    Unit("in", _LENGTH, 0.0254, "in inch", "", "inches"),
    Unit("ft", _LENGTH, 0.3048, "", "", "ft foot feet"),
    Unit("s", _TIME, 1.0, "s sec secs second seconds"),
    Unit("ms", _TIME, 1e-3, "ms msec milliseconds", "msecs millis", "millisecond"),
    Unit("us", _TIME, 1e-6, "", "us µs usec usecs micros microseconds"),
    Unit("ns", _TIME, 1e-9, "", "ns nsec nsecs nanos nanoseconds"),
    Unit("d", _TIME, 86_400.0, "", "day days"),
    Unit("", _TIME, 60.0, "", "", "min minute minutes"),
    Unit("N", _FORCE, 1.0, "n newton", "", "newtons"),
    Unit("kN", _FORCE, 1e3, "kn kilonewton", "", "kilonewtons"),
    Unit("", _FORCE, 1e-2, "", "", "cn"),
    Unit("", _FORCE, 1e-3, "", "", "mn millinewton millinewtons"),
    Unit("", _FORCE, 1e-6, "", "", "un µn micronewton micronewtons"),
    Unit("kgf", _FORCE, _G, "", "", "kgf kg kp"),
    Unit("", _FORCE, 1e-3 * _G, "", "", "gf g"),
    Unit("lb", _FORCE, _POUND, "lb lbf", "", "lbs"),
    Unit("kip", _FORCE, 1e3 * _POUND, "", "kip kips"),
    Unit("ozf", _FORCE, _POUND / 16.0, "", "", "ozf oz"),
    Unit("A", _CURRENT, 1.0, "a amp amps ampere amperes arms"),
    Unit("mA", _CURRENT, 1e-3, "ma milliamp milliamps milliampere milliamperes mamp", "", "mamps"),
    Unit("µA", _CURRENT, 1e-6, "ua µa microamp microamps"),
    # How many are a turn, no name says; nor what is rated.
    Unit("counts", _ANGLE, math.nan, "", "counts count cnt ticks enccounts"),
    Unit("V", _NONE, math.nan, "", "v volt volts"),
    Unit("%", _NONE, math.nan, "", "% ‰ percent %rated p.u. pu"),
)  # fmt: skip
# Compound units, which are read by their parts, and words of them that names are cut into. Where two are of one size,
# as N·mm and mN·m, the first one's name is taken.
_COMPOUND_WORDS = {
    "rad/s": "rad/s radps rad_s radpersec", "deg/s": "deg/s degps deg_s dps", "rpm": "rpm 1/min min^-1 min-1",
    "m/s": "mps", "mm/s": "mmps", "rad/s2": "rad/s2 radps2", "deg/s2": "deg/s2 degps2",
    "N·m": "nm n_m newtonmeter", "N·mm": "mnm nmm", "N·cm": "ncm cnm", "kN·m": "knm", "kgf·cm": "kgcm kgfcm",
    "ozf·in": "ozin ozfin", "lbf·in": "lbin lbfin inlb inlbf", "lbf·ft": "lbft lbfft ftlb ftlbf",
    "rev/s": "rps revps", "mrad/s": "mradps", "in/s": "inps ips", "µN·m": "unm µnm", "kgf·m": "kgm kgfm",
    "gf·cm": "gcm gfcm",
}  # fmt: skip
_PARTS = {
    word: Parsed(unit.dimension, unit.size)
    for unit in TABLE
    for word in f"{unit.words} {unit.inside}".split()
}
UNITS: dict[str, str] = {
    **{word: unit.name for unit in TABLE for word in f"{unit.words} {unit.alone}".split()},
    **dict.fromkeys(("per cent", "% rated"), "%"),
    **{word: name for name, words in _COMPOUND_WORDS.items() for word in words.split()},
}
"""Units by how they are written, lower case; the word after the name or in brackets."""
# Written without anything between numerator and denominator; a minute's is that of turns.
_RATES = {"rpm": "rev/min", "rps": "rev/s", "dps": "deg/s", "ips": "in/s"}
_POWERS = str.maketrans(
    {"⁻": "-", "¹": "1", "²": "2", "³": "3", "−": "-", "·": "*", "⋅": "*", "•": "*", "×": "*"}
)
_POWERS |= {ord("μ"): "µ"}
_TERM = re.compile(r"([a-zµ°]+)(?:\^?([+-]?\d)(?![\d.]))?")
_NUMBER = re.compile(r"(.*?)((?:[_ .\[(]+\d+[\])]*)?\s*)$", re.DOTALL)
_COUNTS = re.compile(r"counts/([1-9]\d{1,9})")
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
        return Parsed((1, 0, -abs(power), 0, 0), _PARTS[word].factor)
    if word in _PARTS:
        one = _PARTS[word]
        return Parsed(_multiply_dimension(one.dimension, power), one.factor**power)
    if word[-3:] in _RATES and word[:-3] in ("", "k") and power == 1:
        rate = parse_unit(_RATES[word[-3:]])
        return None if rate is None else Parsed(rate.dimension, rate.factor * (1e3 if word[:-3] else 1.0))
    for mark in ("per", "p"):
        above, found, below = word.rpartition(mark)
        if found and above in _PARTS and below in _PARTS and _PARTS[below].dimension == _TIME and power > 0:
            one, time = _PARTS[above], _PARTS[below]
            powers = zip(one.dimension, _multiply_dimension(time.dimension, power), strict=True)
            a, b, c, d, e = (x - y for x, y in powers)
            return Parsed((a, b, c, d, e), one.factor / time.factor**power)
    for at in range(1, len(word)):
        first, second = _PARTS.get(word[:at]), _PARTS.get(word[at:])
        if first and second and {first.dimension, second.dimension} == {_FORCE, _LENGTH} and power == 1:
            return Parsed((0, 1, 0, 1, 0), first.factor * second.factor)
    return None


def _multiply_dimension(dimension: Dimension, power: int) -> Dimension:
    a, b, c, d, e = (power * x for x in dimension)
    return a, b, c, d, e


class _Sizes(dict[str, float]):
    """Sizes by unit; counts of any number a turn, ``counts/16384``, are one."""

    def __missing__(self, unit: str) -> float:
        found = _COUNTS.fullmatch(unit)
        if found is None:
            raise KeyError(unit)
        return math.tau / int(found[1])

    def __contains__(self, unit: object) -> bool:
        return super().__contains__(unit) or bool(isinstance(unit, str) and _COUNTS.fullmatch(unit))

    def get(self, unit: str, default: Any = None) -> Any:
        return self[unit] if unit in self else default


# Servos count parts of a turn, or of 300 degrees.
TO_SI = _Sizes(
    {unit.name: unit.size for unit in TABLE if unit.name and not math.isnan(unit.size)}
    | {"counts/1024": math.radians(300.0) / 1024.0}
)
"""Size of every unit that has a name [rad, m, s, N, A, and what is made of them]."""
COMPOUND: dict[tuple[Dimension, float], str] = {}
"""Units that are put together, by what they are of and the logarithm of their size."""


def _name_compounds() -> None:
    """Name every rate, torque and acceleration of the table's units."""
    moves = [unit.name for unit in TABLE if unit.dimension in (_ANGLE, _LENGTH) and unit.name in TO_SI]
    lengths = [unit.name for unit in TABLE if unit.dimension == _LENGTH]
    rates = [f"{unit}/{time}" for time in ("s", "s2") for unit in moves]
    forces = ("N", "kN", "mN", "µN", "kgf", "gf", "lbf", "ozf")
    torques = [f"{force}·{arm}" for force in forces for arm in lengths]
    for name in (*_COMPOUND_WORDS, *rates, "rpm/s", "krpm", *torques):
        parsed = parse_unit(name)
        if parsed is not None:
            key = parsed.dimension, round(math.log(parsed.factor), 3)
            if key not in COMPOUND:
                TO_SI[name] = parsed.factor
                COMPOUND[key] = name


_name_compounds()
QUANTITY_OF_UNIT = {
    **{name: KINDS[dimension] for (dimension, _), name in COMPOUND.items()},
    **{unit.name: KINDS[unit.dimension] for unit in TABLE if unit.name and unit.dimension in KINDS},
    **{unit.name: "time" for unit in TABLE if unit.name and unit.dimension == _TIME},
    "V": "volt",
}
"""``q``, ``v``, ``a``, ``tau``, ``i``, ``volt`` or ``time``."""
# Units of how joints move that slide, and that turn.
OF_SLIDING = frozenset(
    {
        *(unit.name for unit in TABLE if unit.name and unit.dimension in (_LENGTH, _FORCE)),
        *(name for (dimension, _), name in COMPOUND.items() if not dimension[0] and not dimension[3]),
    }
)
OF_TURNING = (
    frozenset(n for n, of in QUANTITY_OF_UNIT.items() if of in ("q", "v", "a", "tau"))
    - OF_SLIDING
    - {"counts"}
)
TICKS = {unit.name: unit.size for unit in TABLE if unit.name and unit.dimension == _TIME}
"""Units of clocks [s]."""


def unit_named(text: str) -> str:
    """The unit that a text is, in this package's spelling; empty where it is none."""
    bare = text.strip().lower()
    parsed = None if bare in UNITS else parse_unit(text)
    if parsed is None or sum(power != 0 for power in parsed.dimension) < 2:
        return UNITS.get(bare, "")
    return COMPOUND.get((parsed.dimension, round(math.log(parsed.factor), 3)), "")


def size_of(unit: str) -> float:
    """Size of a unit of a length, a force or what is made of them, however it is written [SI].

    Raises:
        ValueError: no such unit.
    """
    parsed = parse_unit(unit)
    if parsed is None:
        raise ValueError(f"{unit} is no unit")
    return parsed.factor
