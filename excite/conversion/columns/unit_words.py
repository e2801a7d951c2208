"""Units as drivers, vendors' loggers and people write them, and what each is a unit of."""

from __future__ import annotations

import re

from excite.conversion.columns.vocabulary import COMMANDED, MEASURED, OF_WORD

# Units by how they are written, lower case; the word after the name or in brackets.
UNITS: dict[str, str] = {
    **dict.fromkeys(("rad", "radian", "radians", "rads"), "rad"),
    **dict.fromkeys(("deg", "degree", "degrees", "°", "grad"), "deg"),
    **dict.fromkeys(("rev", "revs", "turn", "turns", "revolutions", "umdrehungen"), "rev"),
    **dict.fromkeys(("mrad", "milliradian", "milliradians"), "mrad"),
    **dict.fromkeys(("cm", "centimeter", "centimetre"), "cm"),
    **dict.fromkeys(("rev/s", "rps", "turns/s", "revps"), "rev/s"),
    **dict.fromkeys(("mrad/s", "mradps"), "mrad/s"),
    **dict.fromkeys(("rad/s", "radps", "rad_s", "rads-1", "radpersec", "rad_per_s", "rad/sec"), "rad/s"),
    **dict.fromkeys(("deg/s", "degps", "deg_s", "dps", "°/s", "deg/sec", "deg_per_s"), "deg/s"),
    **dict.fromkeys(("rpm", "rev/min", "1/min", "u/min", "r/min", "min^-1"), "rpm"),
    **dict.fromkeys(("rad/s2", "rad/s^2", "radps2", "rad/s²", "rads2"), "rad/s2"),
    **dict.fromkeys(("deg/s2", "deg/s^2", "degps2", "deg/s²"), "deg/s2"),
    **dict.fromkeys(("nm", "n.m", "n·m", "n*m", "newtonmeter", "n-m", "n_m"), "N·m"),
    **dict.fromkeys(("mnm", "nmm", "n.mm", "n·mm", "n*mm", "mn.m"), "N·mm"),
    **dict.fromkeys(("ncm", "n·cm", "n.cm", "n*cm", "n-cm", "cnm"), "N·cm"),
    **dict.fromkeys(("knm", "kn·m", "kn.m", "kn*m", "kn-m"), "kN·m"),
    **dict.fromkeys(
        ("kgcm", "kg·cm", "kg.cm", "kg*cm", "kg-cm", "kgfcm", "kgf·cm", "kgf.cm", "kgf*cm", "kgf-cm"),
        "kgf·cm",
    ),
    **dict.fromkeys(("ozin", "oz·in", "oz.in", "oz*in", "oz-in", "ozfin", "ozf·in"), "ozf·in"),
    **dict.fromkeys(
        ("lbin", "lb·in", "lb.in", "lb*in", "lb-in", "lbfin", "lbf·in", "in-lb", "inlb"), "lbf·in"
    ),
    **dict.fromkeys(
        ("lbft", "lb·ft", "lb.ft", "lb*ft", "lb-ft", "lbfft", "lbf·ft", "ft-lb", "ftlb"), "lbf·ft"
    ),
    **dict.fromkeys(("kn", "kilonewton"), "kN"),
    **dict.fromkeys(("a", "amp", "amps", "ampere"), "A"),
    **dict.fromkeys(("ma", "milliamp"), "mA"),
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "µs", "usec", "usecs", "micros", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanoseconds"), "ns"),
    **dict.fromkeys(("day", "days"), "d"),
    **dict.fromkeys(("m", "meter", "metre", "meters"), "m"),
    **dict.fromkeys(("mm", "millimeter"), "mm"),
    **dict.fromkeys(("m/s", "mps"), "m/s"),
    **dict.fromkeys(("mm/s",), "mm/s"),
    **dict.fromkeys(("n", "newton"), "N"),
    **dict.fromkeys(("lb", "lbf"), "lb"),
    **dict.fromkeys(("kip", "kips"), "kip"),
    **dict.fromkeys(("in", "inch"), "in"),
    **dict.fromkeys(("inps", "in/s", "ips"), "in/s"),
    **dict.fromkeys(("v", "volt", "volts"), "V"),
    **dict.fromkeys(("%", "‰", "percent", "per cent", "% rated", "%rated", "p.u.", "pu"), "%"),
}
QUANTITY_OF_UNIT = {
    "rad": "q", "deg": "q", "m": "q", "mm": "q", "in": "q", "in/s": "v", "lb": "tau", "kip": "tau",
    "rad/s": "v", "deg/s": "v", "rpm": "v", "m/s": "v", "mm/s": "v",
    "rad/s2": "a", "deg/s2": "a",
    "N·m": "tau", "N·mm": "tau", "N": "tau",
    "N·cm": "tau", "kN·m": "tau", "kgf·cm": "tau", "ozf·in": "tau", "lbf·in": "tau", "lbf·ft": "tau", "kN": "tau",
    "rev": "q", "mrad": "q", "cm": "q", "rev/s": "v", "mrad/s": "v",
    "A": "i", "mA": "i", "V": "volt",
    "s": "time", "ms": "time", "us": "time", "ns": "time", "d": "time",
}  # fmt: skip
# Units of how joints move that slide, and that turn.
OF_SLIDING = frozenset({"m", "mm", "cm", "in", "m/s", "mm/s", "in/s", "N", "kN", "lb", "kip"})
OF_TURNING = frozenset(QUANTITY_OF_UNIT) - OF_SLIDING - {"A", "mA", "V", "s", "ms", "us", "ns", "d"}


def without_brackets(name: str) -> tuple[str, str]:
    """A name without the unit in its brackets, and the unit."""
    match = re.search(r"[\[(<{]\s*([^\[\](){}<>]+?)\s*[\])>}]\s*$", name)
    if match and not match[1].strip().isdigit():
        unit = UNITS.get(match[1].strip().lower(), "")
        if unit:
            return name[: match.start()], unit
    match = re.search(r"[/_ ](rad/s\^?2?|deg/s\^?2?|m/s)$|\s*([%‰])\s*$", name)
    if match:
        return name[: match.start()], UNITS.get((match[1] or match[2]).lower(), "")
    return name, ""


def trailing_unit(words: list[str]) -> tuple[list[str], str]:
    """The unit that a name ends with, where another word says the quantity."""
    for count in (2, 1):
        if len(words) > count:
            unit = UNITS.get("_".join(words[-count:]), "")
            others = set(words[:-count]) & (frozenset(OF_WORD) | COMMANDED | MEASURED)
            if unit == "in" and not {OF_WORD.get(word) for word in words[:-count]} & {"q"}:
                # Of anything but a length, ``in`` is an input.
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
