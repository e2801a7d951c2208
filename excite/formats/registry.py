"""The formats of columns by name. A new one is one file beside this one and its line here; every user then reads it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from excite.errors import InputError
from excite.formats.child import in_child
from excite.formats.file import MAX_FILE_BYTES, check_file, is_packed, pack_file, plain_name, unpack_file
from excite.formats.format import ColumnFormat, Content
from excite.registry import Registry
from excite.temporary_folder import TemporaryFolder

FORMATS: Registry[ColumnFormat] = Registry(
    "format",
    {
        "parquet": "excite.formats.arrow:ParquetFormat",
        "csv": "excite.formats.tables:CsvFormat",
        "npz": "excite.formats.arrays:NpzFormat",
        "hdf5": "excite.formats.hdf5:Hdf5Format",
    },
)


def find_format(path: Path) -> ColumnFormat | None:
    """The format of a file by its suffix, below that of its packing; None for none."""
    suffix = plain_name(path).suffix.lower()
    return next((FORMATS.make(name) for name in FORMATS if suffix in FORMATS[name].suffixes), None)


def format_of(path: Path) -> ColumnFormat:
    """The format of a file by its suffix; raises InputError where there is none."""
    found = find_format(path)
    if found is None:
        known = ", ".join(column_suffixes())
        raise InputError(f"unknown format {path.suffix[:60]!r}", source=path, remedy=f"use one of {known}")
    return found


def column_suffixes() -> tuple[str, ...]:
    """Endings of files that hold columns."""
    return tuple(suffix for kind in FORMATS.values() for suffix in kind.suffixes)


def read_content(path: Path) -> Content:
    """What one file holds; see :func:`read_contents`."""
    return next(read_contents([path]))


def read_contents(paths: Sequence[Path]) -> Iterator[Content]:
    """What files hold by their suffixes, one file after the other.

    Files of libraries that may crash are read in one process for all of them: starting it takes longer than reading.

    Raises:
        InputError: no format has a suffix; a file is missing, is no such file, or holds more than is read.
    """
    formats = [format_of(path) for path in paths]
    own = [path for path, form in zip(paths, formats, strict=True) if form.own_process]
    packed = next((path for path in own if is_packed(path)), None)
    if packed is not None:
        raise InputError("is packed", source=packed, remedy="unpack it first")
    found = dict(zip(own, _read_in_own_process(own), strict=True)) if own else {}
    for path, form in zip(paths, formats, strict=True):
        if path in found:
            yield found.pop(path)
            continue
        with unpack_file(path, limit=MAX_FILE_BYTES) as plain:
            yield form.read(plain)


def write_columns(columns: Mapping[str, NDArray[Any]], path: Path) -> None:
    """Write columns, ``(n,)`` each, in the format of the file's suffix, packed where that says so."""
    form = format_of(path)
    if not is_packed(path):
        form.write(columns, path)
        return
    # Not beside it: another file may have the plain name.
    folder = TemporaryFolder()
    plain = folder.path / plain_name(path).name
    form.write(columns, plain)
    pack_file(plain, path)


def read_here(paths: list[Path]) -> list[Content]:
    """What files hold, read in this process."""
    return [format_of(path).read(path) for path in paths]


def _read_in_own_process(paths: list[Path]) -> list[Content]:
    size = sum(check_file(path).stat().st_size for path in paths)
    # A process starts in less than a second; the rest is for the file, at a tenth of what disks and gzip do [s,
    # bytes/s].
    seconds = 20.0 + size / 5e6
    try:
        found: list[Content] = in_child(f"{__name__}:read_here", paths, source=paths[0], seconds=seconds)
    except InputError:
        if len(paths) == 1:
            raise
        # One by one, to name the file that it was.
        return [_read_in_own_process([path])[0] for path in paths]
    return found
