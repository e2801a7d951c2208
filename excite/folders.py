"""Folders to write into: made where they are missing, removed where nothing came, and the error where none can be."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from excite.errors import InputError

# What the system says where a disk is full.
DISK_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def make_folder(path: Path) -> Path:
    """Make a folder and those above it where they are not there; raises InputError where that cannot be done."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise unwritable_error(path, error) from error
    return path


def missing_folders(folder: Path) -> tuple[Path, ...]:
    """A folder and those above it that are not there, the deepest first."""
    return tuple(path for path in (folder, *folder.parents) if not os.path.exists(path))


def remove_empty(folders: Iterable[Path]) -> None:
    """Remove folders that are empty, the deepest first; others stay."""
    for folder in folders:
        # Not empty, or taken by somebody else meanwhile.
        with suppress(OSError):
            folder.rmdir()


def unwritable_error(path: Path, error: Exception) -> InputError:
    """The error for a place that the system does not let anyone write to."""
    code = error.errno if isinstance(error, OSError) else None
    said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    remedy = "choose a folder that may be written to"
    if code in DISK_FULL:
        remedy = "make room on the disk, or choose another folder; what was there before is as it was"
    return InputError(f"cannot be written ({said})", source=str(path).replace("\0", "\\0"), remedy=remedy)
