"""Files and folders that appear under their name only when they are complete.

What is being written lies in a hidden folder beside it, which its writer keeps locked. A writer that was killed leaves
its lock free: the next one in the same place removes what it left. One run at a time writes to a folder of results.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from excite.errors import InputError
from excite.folders import DISK_FULL, make_folder, missing_folders, remove_empty, unwritable_error

HIDDEN = ".excite-"
"""How the names of hidden folders begin."""


@dataclass(frozen=True)
class _Hidden:
    """A hidden folder, in which something is being written, or is complete and waits for others.

    Attributes:
        folder: the hidden folder.
        path: what it is for; the same name in the hidden folder is what is written.
        lock: open descriptor that keeps the folder locked.
        made: folders that were made for it, the deepest first.
    """

    folder: Path
    path: Path
    lock: int
    made: tuple[Path, ...]

    @property
    def temporary(self) -> Path:
        """What is written."""
        return self.folder / self.path.name


@dataclass
class _Written:
    """What this process has written, and what it is writing.

    Attributes:
        complete: files and folders that appeared under their names, in order.
        hidden: hidden folders in use.
        swept: folders from which others' leftovers were removed.
        waiting: what is complete and is renamed together later; None where each is at once.
    """

    complete: list[Path] = field(default_factory=list)
    hidden: set[Path] = field(default_factory=set)
    swept: set[Path] = field(default_factory=set)
    waiting: list[_Hidden] | None = None


_WRITTEN = _Written()


def completed_files() -> tuple[Path, ...]:
    """Files and folders that this process has completed, in order."""
    return tuple(_WRITTEN.complete)


def is_written(path: Path) -> bool:
    """Whether a file or folder is there, or will be once what is written with it is complete."""
    return path.exists() or any(item.path == path for item in _WRITTEN.waiting or ())


def discard_unfinished() -> None:
    """Remove what is being written, for a process that is about to end without unwinding."""
    for folder in tuple(_WRITTEN.hidden):
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Give a temporary path of the same name; on success sync it and rename it to ``path``.

    Nothing is left behind when the block raises. What may not be written is an InputError.
    """
    path = Path(path)
    with _hidden_folder(path) as temporary:
        yield temporary
        _sync_file(temporary)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Give a path for a folder (not yet there, same name); on success it replaces ``path`` whole.

    Nothing is left behind when the block raises, and an older ``path`` then stays as it was.
    """
    path = Path(path)
    with _hidden_folder(path) as temporary:
        yield temporary
        for file in sorted(temporary.rglob("*")):
            if file.is_file():
                _sync_file(file)


@contextmanager
def all_or_nothing() -> Iterator[None]:
    """Let everything that is written in the block appear together at its end, or nothing of it if it raises.

    Files are not to be read again inside the block. A block inside another one is part of that.
    """
    if _WRITTEN.waiting is not None:
        yield
        return
    waiting = _WRITTEN.waiting = []
    try:
        yield
        _WRITTEN.waiting = None
        for item in waiting:
            _rename_into_place(item.temporary, item.path)
    finally:
        _WRITTEN.waiting = None
        for item in waiting:
            _remove_hidden(item)


def write_text(path: Path, text: str) -> Path:
    """Write a text file atomically, UTF-8; what no UTF-8 can hold, as names of files may, is escaped."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")
    return Path(path)


def write_bytes(path: Path, content: bytes) -> Path:
    """Write a file atomically."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)
    return Path(path)


def sweep_hidden_folders(folder: Path) -> None:
    """Remove hidden folders whose writers were killed; once a process and place."""
    if folder in _WRITTEN.swept:
        return
    _WRITTEN.swept.add(folder)
    for hidden in folder.glob(f"{HIDDEN}*"):
        with suppress(OSError):
            lock = os.open(hidden, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(hidden, ignore_errors=True)
            finally:
                os.close(lock)


@contextmanager
def _hidden_folder(path: Path) -> Iterator[Path]:
    """A place of the same name in a locked hidden folder beside ``path``; what is there at the end appears there."""
    if "\0" in str(path):
        raise unwritable_error(path, ValueError("no name holds a zero byte"))
    made = missing_folders(path.parent)
    make_folder(path.parent)
    hidden = _locked_folder(path, made)
    _WRITTEN.hidden.add(hidden.folder)
    waits = False
    try:
        yield hidden.temporary
        if _WRITTEN.waiting is None:
            _rename_into_place(hidden.temporary, path)
        else:
            _WRITTEN.waiting.append(hidden)
            waits = True
    except OSError as error:
        ours = error.filename is not None and str(error.filename).startswith(str(hidden.folder))
        if ours or error.errno in DISK_FULL or isinstance(error, PermissionError):
            raise unwritable_error(path, error) from error
        raise
    finally:
        if not waits:
            _remove_hidden(hidden)


def _locked_folder(path: Path, made: tuple[Path, ...]) -> _Hidden:
    try:
        sweep_hidden_folders(path.parent)
        while True:
            hidden = path.parent / f"{HIDDEN}{secrets.token_hex(8)}"
            hidden.mkdir()
            lock = os.open(hidden, os.O_RDONLY | os.O_DIRECTORY)
            # Some network file systems do not lock folders; theirs are then left to whoever finds them.
            with suppress(OSError):
                fcntl.flock(lock, fcntl.LOCK_EX)
            if hidden.exists():
                return _Hidden(hidden, path, lock, made)
            # Another process took it for a leftover before it was locked.
            os.close(lock)
    except (OSError, ValueError) as error:
        raise unwritable_error(path, error) from error


def _rename_into_place(temporary: Path, path: Path) -> None:
    try:
        if temporary.is_dir() and path.exists():
            path.replace(temporary.parent / "replaced by this")
        temporary.replace(path)
    except OSError as error:
        raise unwritable_error(path, error) from error
    _WRITTEN.complete.append(path)


def _remove_hidden(hidden: _Hidden) -> None:
    """Remove a hidden folder, and the folders that were made for it and in which nothing appeared."""
    shutil.rmtree(hidden.folder, ignore_errors=True)
    _WRITTEN.hidden.discard(hidden.folder)
    os.close(hidden.lock)
    remove_empty(hidden.made)


def _sync_file(file: Path) -> None:
    with file.open("rb") as stream:
        os.fsync(stream.fileno())


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
