"""What every format of recordings has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

from excite.conversion.recording import Recording
from excite.errors import LogError

# An hour at 1 kHz of an arm with 55 channels has 1.6 GB as text.
MAX_SOURCE_BYTES = 4_000_000_000
# As many numbers as a log folder's trial may hold.
MAX_NUMBERS = 200_000_000


class Source(ABC):
    """Reads recordings of one format.

    Attributes:
        name: of the format.
        summary: one line for help texts and errors.
        own_process: whether its library is known to crash or hang on damaged files, so that a child process reads.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    own_process: ClassVar[bool] = False

    @abstractmethod
    def recognises(self, path: Path) -> bool:
        """Whether a file or folder looks like this format, by its name and first bytes."""

    @abstractmethod
    def read(self, path: Path) -> tuple[Recording, ...]:
        """All recordings in it, in order.

        Raises:
            LogError: it is no such file, is damaged, or holds more than can be read.
        """


def damaged(path: Path, error: BaseException, what: str) -> LogError:
    """The error for a file that its library cannot read."""
    text = " ".join(str(error).split()) or type(error).__name__
    return LogError(
        f"cannot be read as {what} ({text[:160]})", source=path, remedy="check that the file is complete"
    )
