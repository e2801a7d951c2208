"""All recordings of what people name: files, and folders of files, in one shape."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from excite.conversion.parts import joined_parts
from excite.conversion.recording import Recording, merged_names
from excite.conversion.repairs.drive_state import with_drives_on
from excite.conversion.repairs.wraps import signed
from excite.conversion.shapes.reshape import reshaped
from excite.conversion.sources.registry import read_source, recognised, recognised_recording
from excite.errors import LogError


def read_recordings(sources: Sequence[str | Path]) -> list[Recording]:
    """All recordings, files of a folder in the order of their names; every source that is wrong is said at once."""
    found: list[Recording] = []
    wrong: list[LogError] = []
    for source in sources:
        try:
            found += _read(Path(source))
        except LogError as error:
            wrong.append(error)
    if len(wrong) == 1:
        raise wrong[0]
    if wrong:
        raise LogError("; ".join(str(error) for error in wrong), remedy=wrong[0].remedy)
    shaped = [part for recording in found for part in reshaped(recording)]
    return [with_drives_on(signed(merged_names(recording))) for recording in joined_parts(shaped)]


def _read(source: Path) -> list[Recording]:
    """Recordings of a source; a folder that is no recording itself stands for the files in it that are."""
    if not source.is_dir() or recognised(source) is not None:
        return list(read_source(source))
    files = [file for file in sorted(source.iterdir()) if recognised_recording(file)]
    # Descriptions beside recordings are JSON, too.
    tables = [file for file in files if file.suffix.lower() != ".json"]
    if not files:
        raise LogError("holds no recordings", source=source, remedy="name the files")
    return [recording for file in tables or files for recording in read_source(file)]
