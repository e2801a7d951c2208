"""Units of recordings: one table of them, the words that they are written in, and the grammar of compound ones."""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

from excite.data_tables import read_rows

# Powers of angle, length, time, force and current.
Dimension = tuple[int, ...]
_DIMENSIONS = {
    name: tuple(int(k == j) for j in range(5))
    for k, name in enumerate(("angle", "length", "time", "force", "current", ""))
}
_ANGLE, _LENGTH, _TIME, _FORCE, _CURRENT, _ = _DIMENSIONS.values()


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
        inside: words by which it is written in compound units, lower case.
    """

    name: str
    dimension: Dimension
    size: float
    inside: str


_ROWS = read_rows(__file__, "units.csv")
TABLE = [
    Unit(row["name"], _DIMENSIONS[row["of"]], float(row["size"] or "nan"), f"{row['words']} {row['inside']}")
    for row in _ROWS
    if row["of"] != "compound"
]
_PARTS = {word: Parsed(unit.dimension, unit.size) for unit in TABLE for word in unit.inside.split()}
UNITS: dict[str, str] = {
    **{word: row["name"] for row in _ROWS for word in f"{row['words']} {row['alone']}".split()},
    **dict.fromkeys(("per cent", "% rated"), "%"),
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
    **{(*moves, -order, 0, 0): kind for order, kind in enumerate("qva") for moves in ((1, 0), (0, 1))},
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
    return tuple(power * x for x in dimension)


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
    for name in (
        *(row["name"] for row in _ROWS if row["of"] == "compound"),
        *rates,
        "rpm/s",
        "krpm",
        *torques,
    ):
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
