"""Which files belong together: markers with their forces, and standing recordings apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from excite.errors import LogError
from excite.human.readers.registry import read_recording
from excite.human.recording import Recording

_STANDING = ("static", "stand", "cal")


def paired_recordings(
    trials: Sequence[Path], static: Sequence[Path] = ()
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Read files and join markers with forces.

    Forces belong to the markers' file of the same name but for its ending; where names differ, they are paired in
    the order given. A file of markers without forces is a standing recording if its name says so (``static``).

    Args:
        trials: files with markers, forces, or both.
        static: standing recordings.

    Returns:
        Trials with markers and forces; standing recordings.

    Raises:
        LogError: markers without forces or forces without markers.
    """
    read = [read_recording(path) for path in trials]
    whole = [r for r in read if r.markers and r.plates]
    bare = [r for r in read if r.markers and not r.plates]
    forces = [r for r in read if not r.markers]
    standing = [read_recording(path) for path in static]
    for recording in standing:
        if not recording.markers:
            raise LogError("has no markers", source=recording.source, remedy="give a recording of standing")
    named = {force.source.stem: force for force in forces}
    joined, left = [], []
    for recording in bare:
        force = named.pop(recording.source.stem, None)
        if force is None:
            left.append(recording)
        else:
            joined.append(_join_recordings(recording, force))
    rest = list(named.values())
    moving = [r for r in left if not _is_standing(r)]
    if len(rest) != len(moving) and len(rest) == len(left):
        moving = left
    standing += [r for r in left if r not in moving]
    if len(rest) < len(moving):
        raise LogError(
            "has no force plates",
            source=moving[len(rest)].source,
            remedy="give the file with its forces (MOT, STO) of the same name, or pass it with --static",
        )
    if len(rest) > len(moving):
        raise LogError(
            "has forces only", source=rest[len(moving)].source, remedy="give the file with its markers too"
        )
    joined += [_join_recordings(markers, force) for markers, force in zip(moving, rest, strict=True)]
    order = {path: i for i, path in enumerate(trials)}
    found = sorted((*whole, *joined), key=lambda r: order[r.source])
    if not found:
        raise LogError(
            "no trial with markers and forces", remedy="give C3D files, or TRC and MOT files together"
        )
    return tuple(found), tuple(standing)


def _join_recordings(markers: Recording, forces: Recording) -> Recording:
    return replace(markers, plates=forces.plates)


def _is_standing(recording: Recording) -> bool:
    stem = recording.source.stem.lower()
    return any(word in stem for word in _STANDING)
