"""One run at a time writes to a folder of results."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from excite.atomic import sweep_hidden_folders
from excite.errors import InputError
from excite.folders import make_folder, missing_folders, remove_empty, unwritable_error

# Folders that this process has claimed, by their device and number: a run may claim its own folder again.
_CLAIMED: set[tuple[int, int]] = set()


@contextmanager
def claim_folder(folder: Path) -> Iterator[Path]:
    """Keep a folder of results for this process while the block runs; make it where it is not there.

    The folder itself is locked, so that nothing has to be tidied up: the lock goes with the process. A folder that was
    made here and stayed empty is removed again. Where the file system locks no folders, nothing is kept.

    Args:
        folder: where results go.

    Raises:
        InputError: another process writes there, or nobody may.
    """
    made = missing_folders(folder)
    make_folder(folder)
    try:
        lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise unwritable_error(folder, error) from error
    found = os.fstat(lock)
    key = (found.st_dev, found.st_ino)
    mine = key in _CLAIMED
    try:
        if not mine:
            _take_lock(lock, folder)
            _CLAIMED.add(key)
            sweep_hidden_folders(folder)
        yield folder
    finally:
        if not mine:
            _CLAIMED.discard(key)
        remove_empty(made)
        os.close(lock)


def _take_lock(lock: int, folder: Path) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(
            "is being written to by another run",
            source=folder,
            remedy="wait until that has ended, or give another --out",
        ) from error
    except OSError:
        # No locks on this file system.
        return
