"""Units as people put them together: ``rad s^-1``, ``deg_per_s``, ``mN·m``, ``kgf cm``, ``ozf-in``, ``mmps2``."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

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
