"""The bytes of a file that somebody named: a regular file, of a size that a reader can hold."""

from __future__ import annotations

import bz2
import errno
import gzip
import lzma
import os
import pickle
import stat
import struct
import tokenize
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

from excite.errors import InputError, in_one_line
from excite.temporary_folder import TemporaryFolder

# What a person writes by hand: the largest robot.yaml and log.yaml known here have 30 kB.
MAX_DESCRIPTION_BYTES = 8 * 1024 * 1024

# Of recordings: an hour at 1 kHz of an arm with 55 channels has 1.6 GB as numbers, 2 GB as text, and fits into a usual
# memory twice. A humanoid with hands has 500 columns, an array of tactile sensors some thousand.
MAX_FILE_BYTES, MAX_NUMBERS, MAX_COLUMNS = 4_000_000_000, 200_000_000, 20_000

# Of what is held in memory at once, as text or as objects, up to five times its size: ten minutes of sixty markers at
# 200 Hz have 250 MB in TRC and 170 MB as arrays, the largest document written here 6 MB, the largest mesh known
# 29 MB.
MAX_TEXT_BYTES = 256 * 1024 * 1024
# Structs within structs; Simulink's logs have four.
DEEPEST = 8

# How the pointer begins that Git LFS leaves where it did not fetch a file (specification 1), and how long one may be.
_POINTER, _POINTER_BYTES = b"version https://git-lfs.github.com/spec/", 1024

_KINDS = (
    (stat.S_ISDIR, "is a folder"),
    (stat.S_ISFIFO, "is a pipe"),
    (stat.S_ISCHR, "is a device"),
    (stat.S_ISBLK, "is a device"),
    (stat.S_ISSOCK, "is a socket"),
)
# What writes a file that a folder lacks.
_MADE_BY = {
    "log.yaml": "excite convert makes a log folder of recordings, excite simulate one of motions, and excite init-log "
    "a log.yaml beside trial files",
    "plan.json": "excite plan ROBOT --out DIR writes it",
    "robot.yaml": "excite init-robot FILE --out DIR writes it",
}


def check_file(path: str | Path, *, limit: int | None = None) -> Path:
    """The path of a regular file that may be read, else an error in one line.

    Args:
        limit: largest size [bytes]; None for any.

    Raises:
        InputError: no such file, a folder, pipe, device or socket, a name that no file can
            have, a file that may not be read, one above the limit, or a pointer of Git LFS in a file's place.
    """
    path = Path(path)
    try:
        found = path.stat()
    except (OSError, ValueError) as reason:
        raise unreadable_file(path, reason) from reason
    for is_kind, what in _KINDS:
        if is_kind(found.st_mode):
            raise InputError(f"{what}, not a file", source=path, remedy="give a file")
    if not os.access(path, os.R_OK):
        raise InputError("may not be read", source=path, remedy="change its permissions")
    if limit is not None and found.st_size > limit:
        raise too_large(path, found.st_size, limit)
    if found.st_size <= _POINTER_BYTES and _begins_with(path, _POINTER):
        raise InputError(
            "is the pointer that Git LFS left in place of the file",
            source=path,
            remedy="fetch the file itself: git lfs pull",
        )
    return path


# What libraries raise of files that are damaged or lie.
DAMAGED: tuple[type[Exception], ...] = (
    *(OSError, ValueError, LookupError, TypeError, AttributeError, EOFError, ArithmeticError, MemoryError),
    *(
        RuntimeError,
        AssertionError,
        SyntaxError,
        tokenize.TokenError,
        struct.error,
        zlib.error,
        lzma.LZMAError,
        BadZipFile,
    ),
    *(pickle.UnpicklingError, ImportError, BadZipFile),
)


# Libraries whose own errors are children of no class of Python's; this module loads none of them.
_LIBRARIES = frozenset({"pyarrow", "rosbags", "mcap", "apsw", "scipy", "h5py", "yaml"})


def is_damage(reason: BaseException) -> bool:
    """Whether an error is what a library says of a file that is damaged or of another kind."""
    return isinstance(reason, DAMAGED) or type(reason).__module__.partition(".")[0] in _LIBRARIES


@contextmanager
def unreadable(
    path: Path,
    what: str = "",
    remedy: str = "check that the file is complete",
) -> Iterator[None]:
    """Errors of a library within the block, as an InputError in one line; ``what`` the file should be."""
    try:
        yield
    except Exception as reason:
        if not is_damage(reason):
            raise
        as_what = f" as {what}" if what else ""
        raise InputError(
            f"cannot be read{as_what} ({in_one_line(reason)[:160]})", source=path, remedy=remedy
        ) from reason


def check_unique(names: Sequence[str], path: Path) -> None:
    """Refuse columns of the same name; raises InputError that names the first."""
    twice = next((name for name, count in Counter(names).items() if count > 1), None)
    if twice is not None:
        raise InputError("stands twice", source=path, field=twice[:60], remedy="keep one of the columns")


def check_size(numbers: int, columns: int, path: Path) -> None:
    """Refuse a file by what it says that it holds, before any of it is read; raises InputError."""
    for found, most, what, remedy in (
        (columns, MAX_COLUMNS, "columns", "leave out what is no channel of the robot"),
        (numbers, MAX_NUMBERS, "numbers", "split the recording"),
    ):
        if found > most:
            text = f"holds {found} {what}, more than the {most} that are read"
            raise InputError(text, source=path, remedy=remedy)


def read_bytes(path: str | Path, *, limit: int = MAX_DESCRIPTION_BYTES) -> bytes:
    """The content of a file, at most ``limit`` bytes of it; errors as for :func:`check_file`."""
    path = check_file(path, limit=limit)
    try:
        # One byte more than allowed, for a file that grows while it is read.
        content = _read_beginning(path, limit + 1)
    except OSError as reason:
        raise unreadable_file(path, reason) from reason
    if len(content) > limit:
        raise too_large(path, len(content), limit)
    return content


def first_bytes(path: str | Path, count: int = 512) -> bytes:
    """At most ``count`` bytes from the beginning of a regular file; none of what is no such file or cannot be read."""
    try:
        return _read_beginning(check_file(path), count)
    except (InputError, OSError):
        return b""


def _begins_with(path: Path, with_bytes: bytes) -> bool:
    try:
        return _read_beginning(path, len(with_bytes)) == with_bytes
    except OSError:
        return False


def _read_beginning(path: Path, count: int) -> bytes:
    # Not blocking, for what became a pipe meanwhile and for files of the system's own that wait for news.
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as stream:
        return stream.read(count) or b""


def read_text(path: str | Path, *, limit: int = MAX_DESCRIPTION_BYTES) -> str:
    """The text of a UTF-8 file, with or without a byte order mark; errors as for :func:`check_file`."""
    content = read_bytes(path, limit=limit)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        raise InputError(
            f"is no UTF-8 text (byte {reason.start} is 0x{content[reason.start]:02x})",
            source=path,
            remedy="save it as UTF-8",
        ) from reason


def unreadable_file(path: Path, reason: Exception) -> InputError:
    """The error for a file that the system does not give."""
    if isinstance(reason, ValueError):
        return InputError("has a name that no file can have", source=repr(str(path)), remedy="check the path")
    code = reason.errno if isinstance(reason, OSError) else None
    if code in {errno.ENOENT, errno.ENOTDIR}:
        made = _MADE_BY.get(path.name, "") if path.parent.is_dir() else ""
        return InputError("no such file", source=path, remedy=made or "check the path")
    if code == errno.ENAMETOOLONG:
        return InputError("has a name too long for a file", source=f"{str(path)[:60]}…", remedy="shorten it")
    if code in {errno.EACCES, errno.EPERM}:
        return InputError("may not be read", source=path, remedy="change its permissions")
    said = reason.strerror if isinstance(reason, OSError) and reason.strerror else type(reason).__name__
    return InputError(f"cannot be read ({said})", source=path, remedy="check the disk that it is on")


def too_large(path: Path, size: int, limit: int) -> InputError:
    """The error for a file above a limit."""
    return InputError(
        f"has {size} bytes, more than the {limit} that are read",
        source=path,
        remedy="check that it is the right file",
    )


# Single files that are packed (``run.csv.gz``): read through a copy without packing, for as long as it is
# read.

_OPENED: dict[str, Any] = {".gz": gzip.open, ".xz": lzma.open, ".bz2": bz2.open}
BLOCK = 1 << 20


def is_packed(path: Path) -> bool:
    """Whether a file's name says that it is packed, and what is in it."""
    return path.suffix.lower() in _OPENED and bool(path.with_suffix("").suffix)


def plain_name(path: Path) -> Path:
    """The path of a file without the ending of its packing."""
    return path.with_suffix("") if is_packed(path) else path


@contextmanager
def unpack_file(path: Path, *, limit: int) -> Iterator[Path]:
    """The path; of a packed file that of a copy without packing, which is gone after the block.

    What is raised of the copy within the block names the packed file.

    Args:
        limit: most bytes of what is in a packed file.

    Raises:
        InputError: it is damaged, or there is more in it than is read.
    """
    if not is_packed(path):
        yield path
        return
    check_file(path)
    folder = TemporaryFolder()
    copy = folder.path / plain_name(path).name
    size = 0
    try:
        with _OPENED[path.suffix.lower()](path, "rb") as source, copy.open("wb") as target:
            while block := source.read(BLOCK):
                size += len(block)
                if size > limit:
                    raise too_large(path, size, limit)
                target.write(block)
    except (OSError, EOFError, zlib.error, lzma.LZMAError, ValueError) as reason:
        raise InputError(
            f"cannot be unpacked ({in_one_line(reason)[:160]})",
            source=path,
            remedy="check that the file is complete",
        ) from reason
    try:
        yield copy
    except InputError as reason:
        # The packed file's name, where the error says that of its copy.
        reason.args = tuple(str(text).replace(str(copy), str(path)) for text in reason.args)
        if reason.source is not None and str(reason.source) == str(copy):
            reason.source = path
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
            while block := source.read(BLOCK):
                target.write(block)


# Files of which one or several are handed over.

PathsLike = str | Path | Iterable[str | Path]
"""A file or folder, or several."""


def as_paths(paths: PathsLike) -> list[Path]:
    """The files and folders, where one may stand for a list of one."""
    return [Path(path) for path in ([paths] if isinstance(paths, str | Path) else paths)]
