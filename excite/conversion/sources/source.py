"""What every format of recordings has in common."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.conversion.recording import Recording
from excite.errors import LogError
from excite.reading.child import in_child
from excite.reading.file import check_file, first_bytes, is_packed, plain_name, unpack_file
from excite.registry import Registry

# An hour at 1 kHz of an arm with 55 channels has 1.6 GB as text.
MAX_SOURCE_BYTES = 4_000_000_000
# As many numbers as a log folder's trial may hold.
MAX_NUMBERS = 200_000_000


class Source(ABC):
    """Reads recordings of one format.

    Attributes:
        name: of the format.
        summary: one line for help texts and errors.
        own_process: whether its library is known to crash or hang on damaged files, so that a child process reads.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    own_process: ClassVar[bool] = False

    @abstractmethod
    def recognises(self, path: Path) -> bool:
        """Whether a file or folder looks like this format, by its name and first bytes."""

    @abstractmethod
    def read(self, path: Path) -> tuple[Recording, ...]:
        """All recordings in it, in order.

        Raises:
            LogError: it is no such file, is damaged, or holds more than can be read.
        """


def damaged(path: Path, error: BaseException, what: str) -> LogError:
    """The error for a file that its library cannot read."""
    text = " ".join(str(error).split()) or type(error).__name__
    return LogError(
        f"cannot be read as {what} ({text[:160]})", source=path, remedy="check that the file is complete"
    )


# The formats of recordings by name, the more particular first. A new one is one file beside this one and its
# line.

SOURCES: Registry[Source] = Registry(
    "source",
    {
        "lerobot": "excite.conversion.sources.lerobot:LeRobotSource",
        "bag": "excite.conversion.sources.bag:BagSource",
        "mcap": "excite.conversion.sources.mcap:McapSource",
        "log": "excite.conversion.sources.log_folder:LogFolderSource",
        "pace": "excite.conversion.sources.pickles:PaceSource",
        "mat": "excite.conversion.sources.matlab:MatSource",
        "hdf5": "excite.conversion.sources.hdf5:Hdf5Source",
        "parquet": "excite.conversion.sources.parquet:ParquetSource",
        "pickle": "excite.conversion.sources.pickles:PickleSource",
        "npz": "excite.conversion.sources.npz:NpzSource",
        "echo": "excite.conversion.sources.text:EchoSource",
        "xml": "excite.conversion.sources.records:XmlSource",
        "printed": "excite.conversion.sources.text:PrintedSource",
        "json": "excite.conversion.sources.records:JsonSource",
        "text": "excite.conversion.sources.text:TextSource",
    },
)

# Endings that stand for recordings where a folder of files is given.
RECORDED = frozenset(
    ".csv .tsv .txt .dat .log .xml .parquet .feather .arrow .npz .npy .h5 .hdf5 .mat .json .jsonl .bag .db3 .mcap .pt "
    ".pth .pkl .pickle".split()
)
# What people bring that is not opened, and what to do instead.
_PICKLED = (
    "is packed by joblib, and may run any program when it is opened",
    "write its arrays with numpy.savez, or its table with to_csv or to_parquet",
)
_CAPTURED = (
    "is of motion capture or OpenSim, where people move, and no log of a robot",
    "people are measured by excite human; save a robot's joints as CSV, with one column a joint",
)
_REFUSED = {
    ".joblib": _PICKLED,
    **dict.fromkeys(
        (".xlsx", ".xls", ".ods"), ("is a workbook of a spreadsheet", "save its sheet as CSV and give that")
    ),
    **dict.fromkeys((".zip", ".gz", ".7z", ".tar", ".tgz", ".zst"), ("is packed", "unpack it first")),
    **dict.fromkeys((".c3d", ".trc", ".mot", ".sto"), _CAPTURED),
    ".mdf": ("is a measurement file of a vehicle's bus", "export its channels as CSV or .mat"),
    ".mf4": ("is a measurement file of a vehicle's bus", "export its channels as CSV or .mat"),
    ".tfrecord": (
        "is a record of TensorFlow, as RLDS data sets have them",
        "save the joints of its steps with numpy.savez, or as Parquet",
    ),
    ".tdms": ("is a measurement file of LabVIEW", "export its channels as CSV or .mat"),
}
# Files of other tools by what they begin with, whatever they are called.
_BEGINNINGS = {
    b"ULog\x01\x12\x35": ("is a log of PX4", "turn it into tables with ulog2csv of pyulog"),
    b"RRF": ("is a recording of rerun", "read it with rerun's dataframe API and save the table as Parquet"),
    b"\xed\xa1\xda\x01": (
        "is a log of LCM, whose messages no file but their .lcm definitions explains",
        "decode it with lcm.EventLog and those definitions, and save q, qd, tau and utime with numpy.savez",
    ),
}
# As long as reading may take: starting, then a tenth of what disks do [s, bytes/s].
_STARTING_S, _BYTES_PER_S = 30.0, 2e6


def read_source(path: Path) -> tuple[Recording, ...]:
    """Recordings of a file or folder, by the first format that recognises it.

    Raises:
        LogError: nothing is there, no format recognises it, or it is damaged.
    """
    if not path.exists():
        raise LogError("no such file or folder", source=path, remedy="check the name of the source")
    if not path.is_dir():
        # A pipe or device has no beginning to look at, and no end.
        check_file(path, error=LogError)
        if is_packed(path):
            return _read_packed(path)
    name = recognised(path)
    if name is not None:
        return _in_own_process(name, path) if SOURCES[name].own_process else _read(name, path)
    if (why := _REFUSED.get(path.suffix.lower().split("-")[0]) or _by_beginning(path)) is not None:
        raise LogError(why[0], source=path, remedy=why[1])
    known = "; ".join(SOURCES[name].summary for name in SOURCES)
    raise LogError("is of no format that is known", source=path, remedy=f"give one of: {known}")


def _by_beginning(path: Path) -> tuple[str, str] | None:
    """What a file is by its first bytes, and what to do with it; None for nothing that is known."""
    first = b"" if path.is_dir() else first_bytes(path, 16)
    return next((why for start, why in _BEGINNINGS.items() if first.startswith(start)), None)


def _read_packed(path: Path) -> tuple[Recording, ...]:
    if (why := _REFUSED.get(plain_name(path).suffix.lower())) is not None:
        raise LogError(why[0], source=path, remedy=why[1])
    with unpack_file(path, limit=MAX_SOURCE_BYTES, error=LogError) as plain:
        return tuple(replace(recording, source=str(path)) for recording in read_source(plain))


def recognised(path: Path) -> str | None:
    """Name of the first format that recognises a file or folder; None for none."""
    return next((name for name in SOURCES if SOURCES.make(name).recognises(path)), None)


def recognised_recording(path: Path) -> bool:
    """Whether a file or folder among others in a folder is a recording, by its ending or as a bag."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    return path.is_file() and plain_name(path).suffix.lower() in RECORDED


def _read(name: str, path: Path) -> tuple[Recording, ...]:
    return SOURCES.make(name).read(path)


def _in_own_process(name: str, path: Path) -> tuple[Recording, ...]:
    size = (
        sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
        if path.is_dir()
        else path.stat().st_size
    )
    found: tuple[Recording, ...] = in_child(
        f"{__name__}:_read",
        name,
        path,
        source=path,
        error=LogError,
        seconds=_STARTING_S + size / _BYTES_PER_S,
    )
    return found


# Dates and times of day in text, as seconds.

_DAY_S = 86_400.0
# 2026-03-01T12:00:00.123456Z, 2026/03/01 12:00:00,123; 01.03.2026 12:00:00.123; 12:00:00.123: the fraction after a
# point or a comma, a zone that is the same in every row.
_CLOCK = r"(?P<h>\d{1,2}):(?P<m>\d{2}):(?P<s>\d{2})(?:[.,:](?P<f>\d{1,9}))?"
_ZONE = r"\s*(?:Z|UTC|[+-]\d{2}:?\d{2})?"
_FORMS = (
    re.compile(rf"(?P<Y>\d{{4}})[-/.](?P<M>\d{{1,2}})[-/.](?P<D>\d{{1,2}})[T\s_]+{_CLOCK}{_ZONE}"),
    re.compile(rf"(?P<D>\d{{1,2}})[.](?P<M>\d{{1,2}})[.](?P<Y>\d{{4}})[T\s,]+{_CLOCK}{_ZONE}"),
    # As America writes dates, which half of the day behind: 3/4/2024 11:59:50.004 AM.
    re.compile(
        rf"(?P<M>\d{{1,2}})/(?P<D>\d{{1,2}})/(?P<Y>\d{{4}})[,\s]+{_CLOCK}\s*(?P<half>[AaPp])\.?[Mm]\.?"
    ),
    re.compile(_CLOCK),
    # 01:23.456: minutes and seconds of a stop watch, which always has a fraction.
    re.compile(r"(?P<m>\d{1,3}):(?P<s>\d{2})[.,](?P<f>\d{1,9})"),
)


def is_stamp(cell: str) -> bool:
    """Whether a cell is a date with a time, or a time of day."""
    return any(form.fullmatch(cell.strip()) for form in _FORMS)


def seconds(cells: Sequence[str]) -> Array | None:
    """Seconds of stamps of one form, ``(n,)``, not a number where a cell is none; None where most are none.

    Times of day that pass midnight go on.
    """
    form = next((form for form in _FORMS if any(form.fullmatch(str(c).strip()) for c in cells[:20])), None)
    if form is None:
        return None
    found = np.array([_seconds(form.fullmatch(str(cell).strip())) for cell in cells])
    if np.isfinite(found).mean() <= 0.5:
        return None
    if "Y" not in form.groupindex and "h" in form.groupindex:
        steps = np.diff(found, prepend=found[:1])
        found = found + _DAY_S * np.cumsum(np.nan_to_num(steps) < -0.5 * _DAY_S)
    return found


def _seconds(match: re.Match[str] | None) -> float:
    if match is None:
        return float("nan")
    part = match.groupdict()
    day = 0.0
    if part.get("Y"):
        try:
            date = np.datetime64(f"{part['Y']}-{int(part['M']):02d}-{int(part['D']):02d}")
        except ValueError:
            return float("nan")
        day = _DAY_S * float(date.astype("datetime64[D]").astype(np.int64))
    fraction = part.get("f")
    hours = int(part.get("h") or 0)
    if part.get("half"):
        hours = hours % 12 + (12 if part["half"].lower() == "p" else 0)
    clock = 3600.0 * hours + 60.0 * int(part["m"]) + int(part["s"])
    return day + clock + (float(f"0.{fraction}") if fraction else 0.0)
