"""Values that wait in files of a temporary folder, so that memory does not grow with their number."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar, overload

from excite.errors import InputError
from excite.temporary_folder import TemporaryFolder

T = TypeVar("T")


def write_value(value: object, path: Path) -> Path:
    """Write a value, bit for bit.

    Raises:
        InputError: the disk is full, or the folder is gone.
    """
    try:
        with path.open("wb") as file:
            pickle.dump(value, file, protocol=pickle.HIGHEST_PROTOCOL)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror})",
            source=path,
            remedy="set TMPDIR to a folder with room: a candidate takes up to 5 MB",
        ) from error
    return path


def read_value(path: Path) -> Any:
    """A value from :func:`write_value`.

    Raises:
        InputError: this machine does not see the file.
    """
    try:
        with path.open("rb") as file:
            return pickle.load(file)  # noqa: S301  (written by this run, in a folder of its own)
    except OSError as error:
        raise InputError(
            f"cannot be read ({error.strerror})",
            source=path,
            remedy="leave the temporary folder alone; with several machines, set TMPDIR to one that they share",
        ) from error


@dataclass(frozen=True, eq=False)
class OnDisk(Sequence[T], Generic[T]):
    """A sequence whose values are read anew at each access.

    Attributes:
        files: one a value, from :func:`write_value`.
        folder: what keeps them there.
    """

    files: tuple[Path, ...]
    folder: TemporaryFolder

    def __len__(self) -> int:
        """Number of values."""
        return len(self.files)

    @overload
    def __getitem__(self, index: int) -> T: ...

    @overload
    def __getitem__(self, index: slice) -> OnDisk[T]: ...

    def __getitem__(self, index: int | slice) -> T | OnDisk[T]:
        """One value; of a slice, the sequence of its values."""
        if isinstance(index, slice):
            return OnDisk(self.files[index], self.folder)
        value: T = read_value(self.files[index])
        return value

    def only(self, indices: Iterable[int]) -> OnDisk[T]:
        """Those at some places, still on disk."""
        return OnDisk(tuple(self.files[i] for i in indices), self.folder)
