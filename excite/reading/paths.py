"""Files of which one or several are handed over."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

PathsLike = str | Path | Iterable[str | Path]
"""A file or folder, or several."""


def as_paths(paths: PathsLike) -> list[Path]:
    """The files and folders, where one may stand for a list of one."""
    return [Path(path) for path in ([paths] if isinstance(paths, str | Path) else paths)]
