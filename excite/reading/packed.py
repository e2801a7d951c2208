"""Single files that are packed (``run.csv.gz``): read through a copy without packing, for as long as it is read."""

from __future__ import annotations

import bz2
import gzip
import lzma
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from excite.errors import InputError
from excite.reading.file import check_file, too_large
from excite.temporary_folder import TemporaryFolder

_OPENED: dict[str, Any] = {".gz": gzip.open, ".xz": lzma.open, ".bz2": bz2.open}
_DAMAGED = (OSError, EOFError, zlib.error, lzma.LZMAError, ValueError)
_BLOCK = 1 << 20


def is_packed(path: Path) -> bool:
    """Whether a file's name says that it is packed, and what is in it."""
    return path.suffix.lower() in _OPENED and bool(path.with_suffix("").suffix)


def plain_name(path: Path) -> Path:
    """The path of a file without the ending of its packing."""
    return path.with_suffix("") if is_packed(path) else path


@contextmanager
def unpack_file(path: Path, *, limit: int, error: type[InputError] = InputError) -> Iterator[Path]:
    """The path; of a packed file that of a copy without packing, which is gone after the block.

    What is raised of the copy within the block names the packed file.

    Args:
        path: of a file.
        limit: most bytes of what is in a packed file.
        error: class of the errors.

    Raises:
        InputError: of the class ``error``: it is damaged, or there is more in it than is read.
    """
    if not is_packed(path):
        yield path
        return
    check_file(path, error=error)
    folder = TemporaryFolder()
    copy = folder.path / plain_name(path).name
    _copy_unpacked(path, copy, limit, error)
    try:
        yield copy
    except InputError as reason:
        _rename_in_error(reason, copy, path)
        raise


def pack_file(plain: Path, path: Path) -> None:
    """Write a packed copy of a file; the same bytes for the same content."""
    opened = _OPENED[path.suffix.lower()]
    with plain.open("rb") as source, path.open("wb") as stream:
        # No name and no time of writing within.
        packed = (
            gzip.GzipFile("", "wb", fileobj=stream, mtime=0) if opened is gzip.open else opened(stream, "wb")
        )
        with packed as target:
            while block := source.read(_BLOCK):
                target.write(block)


def _copy_unpacked(path: Path, copy: Path, limit: int, error: type[InputError]) -> None:
    size = 0
    try:
        with _OPENED[path.suffix.lower()](path, "rb") as source, copy.open("wb") as target:
            while block := source.read(_BLOCK):
                size += len(block)
                if size > limit:
                    raise too_large(path, size, limit, error)
                target.write(block)
    except _DAMAGED as reason:
        text = " ".join(str(reason).split()) or type(reason).__name__
        raise error(
            f"cannot be unpacked ({text[:160]})", source=path, remedy="check that the file is complete"
        ) from reason


def _rename_in_error(reason: InputError, copy: Path, path: Path) -> None:
    """Say the packed file's name where an error says that of its copy."""
    reason.args = tuple(str(text).replace(str(copy), str(path)) for text in reason.args)
    if reason.source is not None and str(reason.source) == str(copy):
        reason.source = path
