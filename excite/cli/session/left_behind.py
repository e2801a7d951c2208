"""What a run that ends early leaves behind."""

from __future__ import annotations

from pathlib import Path

from excite.atomic import completed_files
from excite.temporary_folder import in_temporary_folder

_NAMED_FILES = 3


def kept_files() -> tuple[Path, ...]:
    """Files and folders that this process has completed and that stay, in order."""
    return tuple(path for path in completed_files() if path.exists() and not in_temporary_folder(path))


def left_behind() -> str:
    """What this process has completed by now, in words."""
    files = kept_files()
    if not files:
        return "nothing was written by then"
    rest = len(files) - _NAMED_FILES
    named = ", ".join(map(str, files[-_NAMED_FILES:]))
    return f"complete by then: {named}" + (f" and {rest} more" if rest > 0 else "")
