"""Log folders on disk, schema ``excite.log/1``: ``log.yaml``, the nominal model and one file a trial."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from pathlib import Path

import yaml

from excite.atomic import HIDDEN, atomic_folder
from excite.errors import LogError, raised_as
from excite.formats.documents import MAX_XML_BYTES
from excite.formats.file import read_text
from excite.formats.registry import read_contents, write_columns
from excite.logs.columns import check_columns, check_measured, read_columns, trial_columns
from excite.logs.header import check_header, header_path, read_header
from excite.logs.log import Log, LogHeader
from excite.logs.sampling import check_log_clock
from excite.robot.catalogue import bundled_robots
from excite.robot.load import RobotLike, as_robot
from excite.robot.robot import Robot
from excite.robot.urdf.reading import parse_urdf
from excite.robot.urdf.tree import MOVING

# The first line of a log.yaml that may be replaced: recordings beside one that a person wrote may be the only ones.
_WRITTEN = "# Written by excite, which replaces this log when told to write here again.\n"


@raised_as(LogError)
def load_log(path: str | Path, robot: RobotLike | None = None) -> Log:
    """Read a log folder, check it, repair its rows.

    Repeated and swapped rows are repaired and counted, missing rows, clipping and quantisation counted
    (:class:`~excite.logs.log.Cleaning`, one per trial); everything else that is wrong is an error.

    Args:
        path: the folder, or its ``log.yaml``.
        robot: the robot that the log should be of, or its name or file; its joints and base are then checked, and
            the model file that ``log.yaml`` names need not be there.

    Returns:
        The log; every array finite, time strictly increasing.

    Raises:
        LogError: a file, field or column is missing, unknown, not numeric, not finite or contradictory.
        RobotError: the nominal model's file is malformed.
    """
    path = header_path(path)
    header = read_header(path)
    robot_text = _read_robot(header, path, None if robot is None else as_robot(robot))
    files = [path.parent / entry.file for entry in header.trials]
    trials = tuple(
        read_columns(content.of_joints(header.joints), entry, header, file)
        for content, entry, file in zip(read_contents(files), header.trials, files, strict=True)
    )
    check_log_clock(trials, header, path)
    check_measured(trials, header, path)
    return Log(header=header, trials=trials, folder=path.parent, robot_text=robot_text)


def save_log(log: Log, folder: str | Path) -> Path:
    """Write a log folder; it appears under its name only when it is complete.

    A log that excite wrote there before is replaced; what else lies in the folder is kept.

    Args:
        log: the log; the format of each trial follows its file's suffix in ``log.header.trials``.
        folder: where to.

    Returns:
        The folder.

    Raises:
        LogError: the header and the trials contradict each other, the nominal model's text is missing, or
            ``folder`` holds something that is no log, or a log that somebody else wrote.
    """
    folder = Path(folder)
    header = log.header
    check_header(header, folder / "log.yaml")
    if log.robot_text is None:
        raise LogError(
            "has no text of the nominal model", source=folder, field="robot", remedy="set Log.robot_text"
        )
    names = [header.robot, *(entry.file for entry in header.trials)]
    for name in names:
        if Path(name).name != name or names.count(name) > 1:
            raise LogError(
                f"{name!r} is no plain, unique file name",
                source=folder,
                remedy="keep all files in the folder",
            )
    if len(log.trials) != len(header.trials):
        raise LogError(
            f"has {len(log.trials)} trials, and its header {len(header.trials)}",
            source=folder,
            field="trials",
        )
    check_replaceable(folder)
    with atomic_folder(folder) as temporary:
        temporary.mkdir()
        (temporary / "log.yaml").write_text(header_text(header), encoding="utf-8")
        (temporary / header.robot).write_text(log.robot_text, encoding="utf-8")
        for entry, trial in zip(header.trials, log.trials, strict=True):
            columns = trial_columns(trial, header)
            check_columns(columns, header, folder / entry.file)
            write_columns(columns, temporary / entry.file)
        keep_others(folder, temporary)
    return folder


def header_text(header: LogHeader) -> str:
    """Text of a ``log.yaml``, which says that it may be replaced."""
    content = header.model_dump(mode="json", by_alias=True, exclude_none=True)
    text: str = yaml.safe_dump(content, sort_keys=False)
    return _WRITTEN + text


def check_replaceable(folder: Path) -> None:
    """Raise LogError where a log would replace what excite did not write; an empty folder or nothing may be there."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    header = folder / "log.yaml"
    if not header.is_file():
        raise LogError("exists and is no log", source=folder, remedy="choose another folder")
    with header.open(encoding="utf-8", errors="replace") as file:
        if file.readline() != _WRITTEN:
            raise LogError(
                "holds a log that excite did not write, or somebody changed since",
                source=folder,
                remedy="choose another folder, or move that one away",
            )


def keep_others(folder: Path, temporary: Path, written: Iterable[str] = ()) -> None:
    """Take over what lies in a folder beside the log that is replaced, as notes and maps.

    Args:
        folder: of the log that is replaced; nothing is kept where there is none.
        temporary: what replaces it.
        written: names of other files that were written with the old log, and go with it.
    """
    if not folder.is_dir():
        return
    try:
        header = read_header(folder / "log.yaml")
        old = {header.robot, *(entry.file for entry in header.trials)}
    except LogError:  # what it named cannot be told: all is kept
        old = set()
    for item in sorted(folder.iterdir()):
        there = temporary / item.name
        if item.name in {*old, *written} or there.exists() or item.name.startswith(HIDDEN):
            continue
        if item.is_dir() and not item.is_symlink():
            shutil.copytree(item, there, symlinks=True, copy_function=_link_or_copy)
        else:
            _link_or_copy(item, there)


def _link_or_copy(source: str | Path, there: str | Path) -> None:
    """The same file under another name; a copy where the file system has no such thing."""
    try:
        os.link(source, there, follow_symlinks=False)
    except OSError:
        shutil.copy2(source, there, follow_symlinks=False)


def _read_robot(header: LogHeader, path: Path, robot: Robot | None) -> str | None:
    """Text of the nominal model, its joints checked against the header's."""
    if robot is not None:
        _check_joints(header.joints, robot.joint_names, path)
        if robot.floating != header.free_base:
            raise LogError(
                f"is {header.base}, unlike that of robot {robot.name!r}",
                source=path,
                field="base",
                remedy=f"its base is {'floating' if robot.floating else 'fixed'}: check the robot",
            )
    file = path.parent / header.robot
    if not file.is_file():
        if robot is not None or header.robot in bundled_robots():
            return None
        raise LogError(
            f"no such file {header.robot!r}",
            source=path,
            field="robot",
            remedy="put the nominal model beside log.yaml, or name a bundled robot",
        )
    if file.suffix in {".yaml", ".yml"}:
        return read_text(file)
    if robot is None:
        joints = parse_urdf(file).findall("joint")
        _check_joints(
            header.joints, tuple(j.get("name", "") for j in joints if j.get("type") in MOVING), path
        )
    return read_text(file, limit=MAX_XML_BYTES)


def _check_joints(joints: Iterable[str], known: tuple[str, ...], path: Path) -> None:
    for joint in joints:
        if joint not in known:
            raise LogError(
                f"the robot has no joint {joint!r}",
                source=path,
                field="joints",
                remedy="it has " + ", ".join(known),
            )
