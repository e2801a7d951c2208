"""What every format of columns offers: named arrays, and what the file says of itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from numpy.typing import NDArray

from excite.formats.file import MAX_FILE_BYTES, check_file, unreadable


@dataclass(frozen=True, eq=False)
class Content:
    """What a file holds.

    Attributes:
        columns: ``(n,)`` or ``(n, k)`` each, by name; what holds no numbers is of another type, or empty.
        written: the columns under the names and in the units that the file gives them, where it may give others.
        statement: text that the writer kept beside them, JSON where excite wrote it; empty where there is none.
    """

    columns: dict[str, NDArray[Any]] = field(default_factory=dict)
    statement: str = ""
    written: dict[str, NDArray[Any]] = field(default_factory=dict)

    def of_joints(self, joints: Iterable[str]) -> dict[str, NDArray[Any]]:
        """The columns in SI; as written where a joint's own name ends in brackets, which then hold no unit."""
        as_written = self.written and any(joint.endswith((")", "]")) for joint in joints)
        return self.written if as_written else self.columns


class ColumnFormat(ABC):
    """A format of named columns.

    Attributes:
        name: of the format.
        suffixes: file name endings, lower case, with the dot.
        own_process: whether damaged files make its library crash or hang, so that a child process reads them.
    """

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]
    own_process: ClassVar[bool] = False

    def read(self, path: Path) -> Content:
        """All columns of a file.

        Raises:
            InputError: the file is missing, is no such file, or holds more than is read.
        """
        path = check_file(path, limit=MAX_FILE_BYTES)
        with unreadable(path):
            return self._read(path)

    @abstractmethod
    def _read(self, path: Path) -> Content:
        """What :meth:`read` returns of a regular file of bounded size; may raise whatever its library raises."""

    @abstractmethod
    def write(self, columns: Mapping[str, NDArray[Any]], path: Path, statement: str = "") -> None:
        """Write columns, ``(n,)`` each, and a statement of one line where there is one."""
