"""Temporary folders that go with their owner, and at the latest with the next run where the owner was killed."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import socket
import tempfile
import weakref
from contextlib import suppress
from pathlib import Path

_LOCK = "owner.lock"


class TemporaryFolder:
    """A folder of ``TMPDIR`` that goes away with the last of those that refer to it, or with the process.

    Its owner keeps a file in it locked. A process that is killed leaves its folders there with their locks free: the
    next one on the same machine that makes a folder removes them.

    Attributes:
        path: where it is.
    """

    def __init__(self) -> None:
        place = Path(tempfile.gettempdir())
        _sweep(place)
        # Under its name only when it is locked, so that nobody takes it for one whose owner is gone. The machine's
        # name is part of it: locks of other machines cannot be seen on every shared file system.
        hidden = Path(tempfile.mkdtemp(prefix=f".{_prefix()}", dir=place))
        lock = os.open(hidden / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        # A file system without locks: its folders are never swept.
        with suppress(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self.path = hidden.rename(place / hidden.name.removeprefix("."))
        weakref.finalize(self, _remove, self.path, lock, os.getpid())


def in_temporary_folder(path: Path) -> bool:
    """Whether a file goes away with a :class:`TemporaryFolder`."""
    return any(part.startswith(_prefix()) for part in path.parts)


def _remove(path: Path, lock: int, owner: int) -> None:
    # A fork of the owner does not own the folder.
    if os.getpid() == owner:
        shutil.rmtree(path, ignore_errors=True)
        os.close(lock)


def _sweep(place: Path) -> None:
    """Remove this user's folders whose owners are gone."""
    for path in place.glob(f"{_prefix()}*"):
        with suppress(OSError):
            if not path.is_symlink() and path.stat().st_uid == os.geteuid():
                _remove_if_left(path)


def _remove_if_left(path: Path) -> None:
    # Without a lock file it is not one of ours, whatever its name.
    lock = os.open(path / _LOCK, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(path, ignore_errors=True)
    finally:
        os.close(lock)


def _prefix() -> str:
    return "excite_" + re.sub(r"[^A-Za-z0-9-]", "-", socket.gethostname()) + "_"
