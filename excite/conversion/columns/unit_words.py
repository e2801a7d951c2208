"""Units as drivers, vendors' loggers and people write them, and what each is a unit of."""

from __future__ import annotations

import math
import re

from excite.conversion.columns.naming.unit_grammar import KINDS, parse_unit, trailing_compound
from excite.conversion.columns.units import COMPOUND
from excite.conversion.columns.vocabulary import COMMANDED, MEASURED, OF_WORD

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
