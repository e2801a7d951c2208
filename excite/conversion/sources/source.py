"""What every format of recordings has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar

from excite.conversion.recording import Recording
from excite.formats.file import MAX_FILE_BYTES, is_damage


class Source(ABC):
    """Reads recordings of one format.

    Attributes:
        name: of the format.
        summary: one line for help texts and errors.
        what: a file of it, for errors; the name where left out.
        limit: most bytes of a file.
        own_process: whether its library is known to crash or hang on damaged files, so that a child process reads.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    what: ClassVar[str] = ""
    limit: ClassVar[int] = MAX_FILE_BYTES
    own_process: ClassVar[bool] = False

    @abstractmethod
    def recognises(self, path: Path) -> bool:
        """Whether a file or folder looks like this format, by its name and first bytes."""

    @abstractmethod
    def read(self, path: Path) -> tuple[Recording, ...]:
        """All recordings in it, in order; those without streams are passed over.

        What its library raises of damaged files becomes one line where it is called, and so does an empty tuple.
        """

    @staticmethod
    def is_of_file(method: str, error: Exception) -> bool:
        """Whether an error of a method is said of the file that is read, and not of its reader."""
        return method == "read" and is_damage(error)

    def mistake_in(self, method: str, result: Any, *_: Any) -> str:
        """What is wrong with what a derived class's method returns; empty for nothing."""
        for stream in (stream for one in (result if method == "read" else ()) for stream in one.streams):
            sizes = {column.name: column.values.shape for column in stream.columns}
            sizes |= {} if stream.time is None else {"time": stream.time.shape}
            if len(set(sizes.values())) > 1 or any(len(size) != 1 for size in sizes.values()):
                said = ", ".join(f"{name} {size}" for name, size in sizes.items())
                return f"holds columns of {said} where all are (n,)"
        return ""
