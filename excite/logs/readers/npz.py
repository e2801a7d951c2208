"""Trials in numpy archives."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.logs.readers.reader import TrialReader, unreadable
from excite.robot.robot import Array


class NpzReader(TrialReader):
    """A numpy archive, one array a channel."""

    name: ClassVar[str] = "npz"
    suffixes: ClassVar[tuple[str, ...]] = (".npz",)

    def read(self, path: Path) -> dict[str, Array]:
        """See :meth:`TrialReader.read`."""
        try:
            with np.load(path, allow_pickle=False) as archive:
                return {name: archive[name] for name in archive.files}
        except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile) as error:
            raise unreadable(path, error) from error

    def write(self, columns: Mapping[str, Array], path: Path) -> None:
        """See :meth:`TrialReader.write`."""
        np.savez_compressed(path, allow_pickle=False, **columns)
