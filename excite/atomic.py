"""Files and folders that appear under their name only when they are complete."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from excite.errors import InputError


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Give a temporary path in the same folder; on success sync it and rename it to ``path``.

    Nothing is left behind when the block raises. What may not be written is an InputError.
    """
    path = Path(path)
    make_folder(path.parent)
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")
    try:
        yield temporary
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError as error:
        if isinstance(error, PermissionError) or error.filename == str(temporary):
            raise _unwritable(path, error) from error
        raise
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Give a path for a folder (not yet there, same name); on success it replaces ``path`` whole.

    The temporary one keeps the final name, inside a hidden parent, for writers that name files after
    their folder. Nothing is left behind when the block raises, and an older ``path`` then stays as it was.
    """
    path = Path(path)
    make_folder(path.parent)
    hidden = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    make_folder(hidden)
    try:
        yield hidden / path.name
        for file in sorted((hidden / path.name).rglob("*")):
            if file.is_file():
                with file.open("rb") as stream:
                    os.fsync(stream.fileno())
        if path.exists():
            path.replace(hidden / "replaced")
        (hidden / path.name).replace(path)
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


def make_folder(path: Path) -> Path:
    """Make a folder and those above it where they are not there; raises InputError where that cannot be done."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritable(path, error) from error
    return path


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(
        f"cannot be written ({error.strerror or error})",
        source=path,
        remedy="choose a folder that may be written to",
    )


def write_text(path: Path, text: str) -> Path:
    """Write a text file atomically, UTF-8."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)
