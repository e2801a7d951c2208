"""Recordings of people that no command may take: C3D, TRC, MOT, CSV, mapping files, and files that do not fit."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from excite.human.markers.marker_set import read_marker_set
from tests.corpus.case import Case
from tests.corpus.practice import c3d, person

_BLOCK = 512


def _c3d(change: Callable[[bytearray], bytes | bytearray | None]) -> Callable[[Path], list[str]]:
    """A sound C3D file with some bytes changed."""

    def build(folder: Path) -> list[str]:
        path = c3d(folder)
        data = bytearray(path.read_bytes())
        path.write_bytes(change(data) or data)
        return person(path)

    return build


def _word(place: int, value: int) -> Callable[[bytearray], None]:
    return lambda data: struct.pack_into("<H", data, place, value)


def _byte(place: int, value: int) -> Callable[[bytearray], None]:
    return lambda data: struct.pack_into("B", data, place, value)


def _real(place: int, value: float) -> Callable[[bytearray], None]:
    return lambda data: struct.pack_into("<f", data, place, value)


def _parameter(name: bytes, offset: int, value: int, kind: str = "<H") -> Callable[[bytearray], None]:
    """Change what stands some bytes behind the name of a parameter."""

    def change(data: bytearray) -> None:
        struct.pack_into(kind, data, data.index(name, _BLOCK) + len(name) + offset, value)

    return change


def _text(name: str, text: str | bytes) -> Callable[[Path], list[str]]:
    def build(folder: Path) -> list[str]:
        path = folder / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return person(path)

    return build


def _trc(
    rows: int = 30,
    unit: str = "mm",
    labels: str = "C7\t\t\tRHEEL",
    row: Callable[[int], str] | None = None,
    time: Callable[[int], float] = lambda i: 0.01 * i,
) -> str:
    """A TRC file, y up."""
    lines = [
        "PathFileType\t4\t(X/Y/Z)\twalk.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"100\t100\t{rows}\t2\t{unit}\t100\t1\t{rows}",
        f"Frame#\tTime\t{labels}\t\t",
        "\t\tX1\tY1\tZ1\tX2\tY2\tZ2",
    ]
    said = row or (lambda i: "1\t1400\t2\t3\t100\t4")
    return "\n".join([*lines, *(f"{i + 1}\t{time(i)!r}\t{said(i)}" for i in range(rows))]) + "\n"


def _unseen() -> str:
    """A TRC file with the labels of a known marker set and no position."""
    labels = list(read_marker_set("jovic").sites)
    frames = [f"{i + 1}\t{0.01 * i!r}" + "\t" * 3 * len(labels) for i in range(30)]
    text = _trc(rows=30, labels="\t\t\t".join(labels)).splitlines()
    text[2] = text[2].replace("\t2\t", f"\t{len(labels)}\t")
    return "\n".join([*text[:5], *frames]) + "\n"


_WRENCH = "\t".join(["time", *(f"R_ground_force_{kind}{axis}" for kind in "vp" for axis in "xyz")])


def _mot(rows: str = "0\t0\t700\t0\t0\t0\t0\n0.01\t0\t700\t0\t0\t0\t0\n", names: str = _WRENCH) -> str:
    return f"forces\nversion=1\nendheader\n{names}\n{rows}"


_PLATE = ",".join(f"plate.p.{axis}" for axis in ("fx", "fy", "fz", "tx", "ty", "tz"))


def _csv(
    value: Callable[[int], str] = lambda i: "0.1,0.2,1.4",
    plate: Callable[[int], str] = lambda i: "0,0,700,0,0,0",
    time: Callable[[int], float] = lambda i: 0.01 * i,
    names: str = "time,C7.x,C7.y,C7.z",
    rows: int = 30,
) -> str:
    lines = [f"{time(i)!r},{value(i)},{plate(i)}" for i in range(rows)]
    return "\n".join([f"{names},{_PLATE}", *lines]) + "\n"


def _mapping(text: str | bytes | None) -> Callable[[Path], list[str]]:
    """A mapping file that is wrong; none of it where it is None."""

    def build(folder: Path) -> list[str]:
        path = folder / "markers.yaml"
        if text is not None:
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return [*person(c3d(folder)), "--markers", str(path)]

    return build


def _special(make: Callable[[Path], object], name: str = "walk.c3d") -> Callable[[Path], list[str]]:
    def build(folder: Path) -> list[str]:
        make(folder / name)
        return person(folder / name)

    return build


def _pair(first: tuple[str, str], second: tuple[str, str]) -> Callable[[Path], list[str]]:
    def build(folder: Path) -> list[str]:
        for name, text in (first, second):
            (folder / name).write_text(text)
        return person(folder / first[0], folder / second[0])

    return build


_MAP = "schema: excite.markers/1\nmarkers:\n"
_NANS = ",".join(["nan"] * 3)

_C3D = (
    ("empty", _c3d(lambda d: b" "), "is no C3D file"),
    ("other bytes", _c3d(lambda d: b"nothing" * 400), "is no C3D file"),
    ("first block only", _c3d(lambda d: d[:_BLOCK]), "is no C3D file"),
    ("cut in the parameters", _c3d(lambda d: d[: 2 * _BLOCK]), "there is room for 0"),
    ("cut in the data", _c3d(lambda d: d[: len(d) - 4 * _BLOCK]), "there is room for"),
    ("parameters beyond the file", _c3d(_byte(0, 255)), "processor"),
    ("parameters in block 0", _c3d(_byte(0, 0)), "processor|parameter block"),
    ("unknown processor", _c3d(_byte(_BLOCK + 3, 99)), "processor: is 99"),
    ("points without end", _c3d(_word(2, 65535)), "number of points|there is room for"),
    ("two more points", _c3d(_word(2, 5)), "there is room for|POINT:USED"),
    ("one point less", _c3d(_word(2, 2)), "POINT:USED"),
    ("analog without end", _c3d(_word(4, 60000)), "there is room for"),
    ("frames without end", _c3d(_word(8, 65000)), "there is room for"),
    ("last frame before the first", _c3d(_word(6, 5000)), "frames"),
    ("data beyond the file", _c3d(_word(16, 60000)), "data block"),
    ("data in block 0", _c3d(_word(16, 0)), "data block"),
    ("rate zero", _c3d(_real(20, 0.0)), "frame rate"),
    ("rate negative", _c3d(_real(20, -100.0)), "frame rate"),
    ("rate nan", _c3d(_real(20, float("nan"))), "frame rate"),
    ("rate of GHz", _c3d(_real(20, 1e9)), "frame rate"),
)
_PARAMETERS = (
    ("record beyond the file", _c3d(_parameter(b"UNITS", 0, 65000)), "cannot be read .*; export it again"),
    ("type that is none", _c3d(_parameter(b"UNITS", 2, 77, "B")), "cannot be read .Parameter type"),
    ("dimensions without end", _c3d(_parameter(b"CORNERS", 3, 200, "B")), "reader fail.*; it is damaged"),
    ("dimension too large", _c3d(_parameter(b"LABELS", 4, 255, "B")), "cannot be read .*; export it again"),
    ("other count of points", _c3d(_parameter(b"USED", 5, 999)), "POINT:USED: is 999"),
    ("unit that is none", _c3d(lambda d: d.replace(b"mm", b"xx", 1)), "units"),
    ("marker twice", _c3d(lambda d: d.replace(b"LHEEL", b"RHEEL")), "RHEEL: stands twice"),
)
_POINTS = (("far away", _c3d(lambda d: _filled(d, 1e30)), "away|reaches"),)


def _filled(data: bytearray, value: float) -> bytearray:
    """All numbers of the data the same."""
    start = (struct.unpack("<H", data[16:18])[0] - 1) * _BLOCK
    count = (len(data) - start) // 4
    data[start:] = np.full(count, value, "<f4").tobytes()
    return data


_TRC = (
    ("empty", _text("walk.trc", ""), "is no TRC file"),
    ("other text", _text("walk.trc", "a\nb\n" * 10), "is no TRC file"),
    ("no text", _text("walk.trc", b"PathFileType\xff\xfe\x00"), "is no UTF-8 text"),
    ("no unit", _text("walk.trc", _trc().replace("Units", "Onits")), "Units: is missing"),
    ("unknown unit", _text("walk.trc", _trc(unit="furlong")), "units: is 'furlong'"),
    ("no frames", _text("walk.trc", _trc(rows=0)), "holds no frames|is no TRC"),
    ("one frame", _text("walk.trc", _trc(rows=1)), "time: has 1 rows"),
    ("no labels", _text("walk.trc", _trc(labels="")), "names no markers"),
    ("marker twice", _text("walk.trc", _trc(labels="C7\t\t\tC7")), "C7: stands twice"),
    ("words", _text("walk.trc", _trc(row=lambda i: "1\tx\t3\t4\t5\t6")), "line 6 is not numeric"),
    ("too many fields", _text("walk.trc", _trc(row=lambda i: "1\t2\t3\t4\t5\t6\t7\t8\t9")), "line 6 has 11 fields"),
    ("time stands", _text("walk.trc", _trc(time=lambda i: 1.0)), "time: does not rise"),
    ("time falls", _text("walk.trc", _trc(time=lambda i: -0.01 * i)), "time: does not rise"),
    ("time in milliseconds", _text("walk.trc", _trc(time=lambda i: 10.0 * i)), "frames come every 10 s"),
    ("gap of 11 days", _text("walk.trc", _trc(time=lambda i: 0.01 * i + 950400 * (i > 9))), "leaps by"),
    ("marker at 1e300", _text("walk.trc", _trc(row=lambda i: "1\t1e300\t3\t4\t5\t6")), "C7: lies"),
    ("marker at infinity", _text("walk.trc", _trc(row=lambda i: "1\tinf\t3\t4\t5\t6")), "C7: lies"),
)  # fmt: skip
_MOT = (
    ("empty", _text("force.mot", ""), "has no endheader"),
    ("no end of the header", _text("force.mot", "forces\n" * 200), "has no endheader"),
    ("no rows", _text("force.mot", _mot("")), "endheader and rows|has no column time"),
    ("no time", _text("force.mot", _mot(names=_WRENCH.replace("time", "thyme"))), "has no column time"),
    ("no forces", _text("force.mot", _mot("0\t1\n1\t1\n", "time\tknee")), "ground reaction force"),
    ("ragged", _text("force.mot", _mot("0\t0\n")), "line 5 has 2 fields for 7"),
    ("words", _text("force.mot", _mot("0\ta\t0\t0\t0\t0\t0\n")), "line 5 is not numeric"),
    ("nan", _text("force.mot", _mot("0\tnan\t0\t0\t0\t0\t0\n1\t0\t0\t0\t0\t0\t0\n")), "not finite"),
    ("force of 1e300", _text("force.mot", _mot("0\t1e300\t0\t0\t0\t0\t0\n.01\t0\t0\t0\t0\t0\t0\n")), "reaches 1e"),
    ("column twice", _text("force.mot", _mot(names=_WRENCH.replace("vy", "vx"))), "stands twice"),
    ("column missing", _text("force.mot", _mot(names=_WRENCH.replace("vy", "vq"))), "column is missing"),
    ("forces without markers", _text("force.mot", _mot()), "has forces only"),
)  # fmt: skip
_CSV = (
    ("empty", _text("walk.csv", ""), "has no column time|is empty"),
    ("names only", _text("walk.csv", _csv(rows=0)), "has 0 rows"),
    ("ragged", _text("walk.csv", _csv(value=lambda i: "1")), "line 2 has 8 fields for 10"),
    ("words", _text("walk.csv", _csv(value=lambda i: "a,b,c")), "line 2 is not numeric"),
    ("column twice", _text("walk.csv", _csv(names="time,C7.x,C7.x,C7.z")), "C7.x: stands twice"),
    ("axis missing", _text("walk.csv", _csv(names="time,C7.x,C7.y,C8.z")), "C7.z: column is missing"),
    ("time nan", _text("walk.csv", _csv(time=lambda i: float("nan"))), "time: does not rise"),
    ("time of 1e300", _text("walk.csv", _csv(time=lambda i: 1e300 * i)), "frames come every 1e"),
    ("force nan", _text("walk.csv", _csv(plate=lambda i: f"{_NANS},0,0,0")), "p, force: is not finite"),
    ("force of 1e300", _text("walk.csv", _csv(plate=lambda i: "0,0,1e300,0,0,0")), "p, force: reaches"),
    ("markers never seen", _text("walk.csv", _csv(value=lambda i: ",,")), "fit no known marker set"),
    ("strangers", _text("walk.csv", _csv()), "fit no known marker set"),
)
_FILES = (
    ("not there", lambda folder: person(folder / "missing.c3d"), "no such file"),
    ("unknown format", _text("walk.xyz", "1"), "no reader for '.xyz'"),
    ("a pipe", _special(os.mkfifo), "is a pipe"),
    ("a folder", _special(os.mkdir, "walk.trc"), "is a folder"),
    ("a device", _special(lambda path: path.symlink_to("/dev/zero")), "is a device"),
    (
        "no marker ever seen",
        _pair(("walk.trc", _unseen()), ("walk.mot", _mot())),
        "no marker is seen in any frame",
    ),
    ("markers alone", _text("walk.trc", _trc()), "has no force plates"),
    ("forces twice", _pair(("a.mot", _mot()), ("b.mot", _mot())), "has forces only"),
    ("name of a kilobyte", lambda folder: person(folder / ("x" * 1000 + ".c3d")), "too long"),
)
_MARKERS = (
    ("not there", _mapping(None), "unknown marker set"),
    ("empty", _mapping(""), "is not a mapping"),
    ("no YAML", _mapping("{"), "is not valid YAML"),
    ("other schema", _mapping("schema: other\n"), "schema"),
    ("no markers", _mapping(_MAP), "lists no markers"),
    ("list of markers", _mapping(_MAP + "  - a\n"), "lists no markers"),
    ("landmark that is none", _mapping(_MAP + "  A: {landmark: tail}\n"), "no landmark 'tail'"),
    ("landmark that is a list", _mapping(_MAP + "  A: {landmark: [c7]}\n"), "no landmark"),
    ("segment that is none", _mapping(_MAP + "  A: {segment: tail}\n"), "no segment 'tail'"),
    ("segment that is a mapping", _mapping(_MAP + "  A: {segment: {a: b}}\n"), "no segment"),
    ("marker twice", _mapping(_MAP + "  A: {landmark: c7}\n  A: {landmark: t10}\n"), "stands twice"),
    ("unknown field", _mapping(_MAP + "  A: {place: c7}\n"), "markers.A"),
    ("a number", _mapping(_MAP + "  A: 3\n"), "markers.A"),
    ("no text", _mapping(b"\xff\xfe\x00"), "is no UTF-8 text"),
)

CASES: tuple[Case, ...] = tuple(
    Case(f"recording: {family}", name, build, line)
    for family, cases in (
        ("c3d header", _C3D),
        ("c3d parameters", _PARAMETERS),
        ("c3d data", _POINTS),
        ("trc", _TRC),
        ("mot", _MOT),
        ("csv", _CSV),
        ("files", _FILES),
        ("markers", _MARKERS),
    )
    for name, build, line in cases
)
