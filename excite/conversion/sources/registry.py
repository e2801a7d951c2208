"""The formats of recordings by name, the more particular first. A new one is one file beside this one and its line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.sources.source import Source
from excite.errors import LogError
from excite.formats.child import in_child
from excite.formats.file import (
    MAX_FILE_BYTES,
    check_file,
    first_bytes,
    is_packed,
    plain_name,
    unpack_file,
    unreadable,
)
from excite.registry import Registry, installed

SOURCES: Registry[Source] = Registry(
    "source",
    installed("readers")
    | {
        "lerobot": "excite.conversion.sources.lerobot:LeRobotSource",
        "bag": "excite.conversion.sources.bag:BagSource",
        "mcap": "excite.conversion.sources.bag:McapSource",
        "log": "excite.conversion.sources.log_folder:LogFolderSource",
        "pace": "excite.conversion.sources.arrays:PaceSource",
        "mat": "excite.conversion.sources.arrays:MatSource",
        "hdf5": "excite.conversion.sources.arrays:Hdf5Source",
        "parquet": "excite.conversion.sources.arrays:ParquetSource",
        "pickle": "excite.conversion.sources.arrays:PickleSource",
        "npz": "excite.conversion.sources.arrays:NpzSource",
        "echo": "excite.conversion.sources.text:EchoSource",
        "xml": "excite.conversion.sources.records:XmlSource",
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
    with unpack_file(path, limit=MAX_FILE_BYTES, error=LogError) as plain:
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
    source = SOURCES.make(name)
    if not path.is_dir():
        check_file(path, limit=source.limit, error=LogError)
    with unreadable(path, LogError, source.what or name):
        found = tuple(recording for recording in source.read(path) if recording.streams)
    if not found:
        raise nothing_there(path)
    return found


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
