"""Units as drivers, vendors' loggers and people write them, and what each is a unit of."""

from __future__ import annotations

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
