"""The formats of recordings by name, the more particular first. A new one is one file beside this one and its line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.sources.source import Source
from excite.data_tables import read_rows
from excite.errors import LogError, raised_as
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
from excite.registry import Registry

_HERE = "excite.conversion.sources"
SOURCES: Registry[Source] = Registry(
    "source",
    {
        "lerobot": f"{_HERE}.arrays:LeRobotSource",
        "bag": f"{_HERE}.bag:BagSource",
        "mcap": f"{_HERE}.bag:McapSource",
        "pace": f"{_HERE}.arrays:PaceSource",
        "mat": f"{_HERE}.arrays:MatSource",
        "hdf5": f"{_HERE}.arrays:Hdf5Source",
        "parquet": f"{_HERE}.arrays:ParquetSource",
        "npz": f"{_HERE}.arrays:NpzSource",
        "json": f"{_HERE}.records:JsonSource",
        "text": f"{_HERE}.text:TextSource",
    },
    axis="readers",
)

# Endings that stand for recordings where a folder of files is given.
RECORDED = frozenset(
    ".csv .tsv .txt .dat .log .parquet .npz .npy .h5 .hdf5 .mat .json .jsonl .bag .db3 .mcap .pt .pth".split()
)  # Files that people put beside recordings.
_BESIDE = frozenset("readme license licence notice changelog requirements".split())


@raised_as(LogError)
def read_source(path: Path) -> tuple[Recording, ...]:
    """Recordings of a file or folder, by the first format that recognises it.

    Raises:
        LogError: nothing is there, no format recognises it, or it is damaged.
    """
    if not path.exists():
        raise LogError("no such file or folder", source=path, remedy="check the name of the source")
    if not path.is_dir():
        # A pipe or device has no beginning to look at, and no end.
        check_file(path)
        # Raise LogError for what people bring that is not opened, and say what to do instead: refused.csv.
        first = first_bytes(path, 16)
        ending = plain_name(path).suffix.lower().split("-")[0]
        for row in read_rows(__file__, "refused.csv"):
            begins = row["beginning"] and first.startswith(bytes.fromhex(row["beginning"]))
            if begins or (ending and ending in row["endings"].split()):
                raise LogError(row["what"], source=path, remedy=row["remedy"])
        if is_packed(path):
            with unpack_file(path, limit=MAX_FILE_BYTES) as plain:
                return tuple(replace(recording, source=str(path)) for recording in read_source(plain))
    name = recognised(path)
    if name is None:
        known = "; ".join(SOURCES[name].summary for name in SOURCES)
        raise LogError("is of no format that is known", source=path, remedy=f"give one of: {known}")
    if not SOURCES[name].own_process:
        return _read(name, path)
    files = path.rglob("*") if path.is_dir() else [path]
    size = sum(file.stat().st_size for file in files if file.is_file())
    # As long as reading may take: starting, then a tenth of what disks do [s, bytes/s].
    found: tuple[Recording, ...] = in_child(
        f"{__name__}:_read", name, path, source=path, seconds=30.0 + size / 2e6, kept=True
    )
    return found


def recognised(path: Path) -> str | None:
    """Name of the first format that recognises a file or folder; None for none."""
    return next((name for name in SOURCES if SOURCES.make(name).recognises(path)), None)


def recognised_recording(path: Path) -> bool:
    """Whether a file or folder among others in a folder is a recording, by its ending or as a bag."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    name = plain_name(path)
    return path.is_file() and name.suffix.lower() in RECORDED and name.stem.lower() not in _BESIDE


def _read(name: str, path: Path) -> tuple[Recording, ...]:
    source = SOURCES.make(name)
    if not path.is_dir():
        check_file(path, limit=source.limit)
    with unreadable(path, source.what or name):
        found = tuple(recording for recording in source.read(path) if recording.streams)
    if not found:
        raise nothing_there(path)
    return found
