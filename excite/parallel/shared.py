"""What all tasks need: written to a file once, read once by each process that works."""

from __future__ import annotations

import hashlib
import pickle
import socket
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Generic, TypeVar

from excite.errors import InputError
from excite.temporary_folder import TemporaryFolder

T = TypeVar("T")
# A worker serves one plan after the other: its robot, and the same robot with what runs its motions.
_KEPT = 4


@dataclass(frozen=True)
class SharedFile:
    """Where a shared value is; two files of the same content are the same.

    Attributes:
        path: in a temporary folder, which for several machines has to be on a file system that they share.
        digest: SHA-256 of the file, in hexadecimal digits.
    """

    path: Path = field(compare=False)
    digest: str


class Shared(Generic[T]):
    """A value that several rounds of tasks need; its file is written when the first of them leaves this process.

    Attributes:
        value: the value.
    """

    def __init__(self, value: T) -> None:
        self.value = value
        self._written: tuple[TemporaryFolder, SharedFile] | None = None

    def file(self) -> SharedFile:
        """The file, which is there for as long as this object.

        Raises:
            InputError: it cannot be written.
        """
        if self._written is None:
            from joblib.externals.loky.backend import reduction

            content = bytes(reduction.dumps(self.value))
            folder = TemporaryFolder()
            path = folder.path / "shared.pickle"
            try:
                path.write_bytes(content)
            except OSError as error:
                raise InputError(
                    f"cannot be written ({error.strerror})",
                    source=path,
                    remedy="set TMPDIR to a folder with room",
                ) from error
            self._written = folder, SharedFile(path, hashlib.sha256(content).hexdigest())
        return self._written[1]


@lru_cache(maxsize=_KEPT)
def load_shared(file: SharedFile) -> Any:
    """The value of a shared file; the same object at each call with the same content.

    Raises:
        InputError: this machine does not see the file, or another content.
    """
    remedy = "set TMPDIR to a folder that all machines share"
    try:
        content = file.path.read_bytes()
    except OSError as error:
        raise InputError(
            f"cannot be read on {socket.gethostname()} ({error.strerror})", source=file.path, remedy=remedy
        ) from error
    if hashlib.sha256(content).hexdigest() != file.digest:
        raise InputError(f"has another content on {socket.gethostname()}", source=file.path, remedy=remedy)
    return pickle.loads(content)  # noqa: S301  (of the digest that came with the task)
