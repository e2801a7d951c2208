"""All recordings of what people name: files, and folders of files, in one shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from excite.conversion.recording import Recording, merged_names
from excite.conversion.repairs.drive_state import with_drives_on
from excite.conversion.repairs.wraps import restore_signs
from excite.conversion.shapes.reshape import reshape_recording
from excite.conversion.sources.registry import read_source, recognised, recognised_recording
from excite.conversion.trial_files import joined_by_trial
from excite.errors import LogError, NothingThereError
from excite.finding import list_names

# How far below a folder that is named recordings may have folders of their own: a session's, a trial's.
_DEPTH = 2
# Files of one fault that an error names; of more only the first.
_NAMED = 2


def read_recordings(sources: Sequence[str | Path]) -> list[Recording]:
    """All recordings, files of a folder in the order of their names; every source that is wrong is said at once."""
    found: list[Recording] = []
    apart: list[Recording] = []
    wrong: list[LogError] = []
    for source in map(Path, sources):
        try:
            ours = _read_source(source, _source_files(source))
            found += ours
            apart += [] if ours else _of_folders(source)
        except LogError as error:
            wrong.append(error)
    if len(wrong) == 1:
        raise wrong[0]
    if wrong:
        raise _all_of(wrong)
    whole = [*_join_recordings(found), *apart]
    return [with_drives_on(restore_signs(merged_names(recording))) for recording in whole]


def _read_source(source: Path, files: Sequence[Path]) -> list[Recording]:
    """Recordings of the files that a source stands for; of several, those that hold nothing are named in a note.

    Raises:
        LogError: a file is damaged, or none of them holds anything and no folder below may.
    """
    found: list[Recording] = []
    empty: list[NothingThereError] = []
    for file in files:
        try:
            found += read_source(file)
        except NothingThereError as error:
            empty.append(error)
    if found and empty:
        note = f"nothing was read from {list_names([Path(str(e.source)).name for e in empty])}: they hold no numbers"
        found[0] = replace(found[0], notes=(*found[0].notes, note))
    if not found and empty and not (source.is_dir() and _nested_folders(source, _DEPTH)):
        raise empty[0]
    return found


def _all_of(wrong: Sequence[LogError]) -> LogError:
    """One error of several; what is wrong with many files alike is said once."""
    alike: dict[tuple[str, str | None, str | None], list[str]] = {}
    for error in wrong:
        alike.setdefault((error.what, error.field, error.remedy), []).append(str(error.source))
    if len(alike) == 1:
        ((what, field, remedy), sources) = next(iter(alike.items()))
        return LogError(what, source=_check_few(sources), field=field, remedy=remedy)
    said = [
        LogError(what, source=_check_few(of), field=field, remedy=do)
        for (what, field, do), of in alike.items()
    ]
    return LogError("; ".join(map(str, said)))


def _check_few(sources: Sequence[str]) -> str:
    if len(sources) > _NAMED:
        return f"{sources[0]} and {len(sources) - 1} more"
    return ", ".join(sources)


def _join_recordings(recordings: Sequence[Recording]) -> list[Recording]:
    return joined_by_trial([part for recording in recordings for part in reshape_recording(recording)])


def _source_files(source: Path) -> list[Path]:
    """What a source stands for: itself, or the files in it of a folder that is no recording; none of those below it."""
    if not source.is_dir() or recognised(source) is not None:
        return [source]
    files = [file for file in sorted(source.iterdir()) if recognised_recording(file)]
    # Descriptions beside recordings are JSON, too.
    return [file for file in files if file.suffix.lower() != ".json"] or files


def _of_folders(source: Path) -> list[Recording]:
    """Recordings that have a folder each below one that holds none, called after it; parts in a folder are one."""
    found: list[Recording] = []
    for folder, name in _nested_folders(source, _DEPTH):
        ours = _join_recordings(_read_source(folder, _source_files(folder)))
        alone = len(ours) == 1
        found += [replace(one, name=name if alone else f"{name}_{one.name}") for one in ours]
    if not found:
        raise LogError("holds no recordings", source=source, remedy="name the files")
    return found


def _nested_folders(source: Path, depth: int) -> list[tuple[Path, str]]:
    """The nearest folders below one that hold recordings, and what to call them."""
    found: list[tuple[Path, str]] = []
    for folder in sorted(path for path in source.iterdir() if path.is_dir()) if depth else []:
        if _source_files(folder):
            found.append((folder, folder.name))
        else:
            found += [
                (deeper, f"{folder.name}_{name}") for deeper, name in _nested_folders(folder, depth - 1)
            ]
    return found
