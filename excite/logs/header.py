"""Strict reading of ``log.yaml``, the header of a log folder."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

from excite.errors import InputError, LogError
from excite.formats.documents import check_content, read_yaml
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import LogHeader
from excite.logs.signals.coupling import coupling_matrix
from excite.logs.vocabulary import EFFECTS, RIGID_BODY

# Gains that the servos of large robots have stay below [N·m/rad, N·m·s/rad, Hz].
_LARGEST_GAIN = 1e9
_MANUAL = "see docs/formats.md, or let `excite init-log` write one to fill in"
_REQUIRED = ("schema", "robot", "base", "rate_hz", "joints", "trials")
_GAINS = ("kp", "kd", "ki")
_CONTROLLER_NUMBERS = ("rate_hz", "delay_s")


def header_path(log: str | Path) -> Path:
    """The ``log.yaml`` of a log, given as a folder or as that file itself; raises LogError for what is no path."""
    if not isinstance(log, str | Path):
        raise LogError(
            f"is a {type(log).__name__}",
            field="log",
            remedy="give a log folder or a loaded log; excite.recordings.join_logs makes one log of several",
        )
    # Not Path.is_dir, which raises for names that no file can have.
    return Path(log) / "log.yaml" if os.path.isdir(log) else Path(log)


def read_header(path: Path) -> LogHeader:
    """Read and validate a ``log.yaml``.

    Raises:
        LogError: the file is missing, is no YAML, or something in it is unknown, doubled or contradictory.
    """
    content = read_yaml(path, error=LogError, remedy=_MANUAL)
    _check_complete(content, path)
    header = check_content(LogHeader, content, path, remedy=_MANUAL, error=LogError)
    check_header(header, path)
    return header


def _check_complete(content: dict[str, Any], path: Path) -> None:
    """Name all fields that are missing, those too that only some logs need; one alone is told by what checks it."""
    base = content.get("base")
    needed = [*_REQUIRED]
    needed += ["base_link"] if base in ("floating", "suspended") else ["torque"]
    needed += ["sensors", "wrench"] if base == "floating" and not content.get("feet") else []
    missing = [name for name in needed if content.get(name) is None]
    if len(missing) > 1:
        raise LogError("are missing", source=path, field=", ".join(missing), remedy=_MANUAL)


def check_header(header: LogHeader, path: Path) -> None:
    """What the schema alone does not say; raises LogError."""
    _check_unique_names(header.joints, "joints", path)
    _check_unique_names([sensor.name for sensor in header.sensors], "sensors", path)
    _check_unique_names([foot.name for foot in header.feet], "feet", path)
    files = [trial.file for trial in header.trials]
    _check_unique_names(files, "trials", path)
    _check_unique_names([Path(file).stem for file in files], "trials", path)
    known = (*RIGID_BODY, *EFFECTS)
    _check_unique_names(header.modelled, "modelled", path)
    for name in header.modelled:
        if name not in known:
            raise LogError(
                f"unknown name {name!r}",
                source=path,
                field="modelled",
                remedy="choose among " + ", ".join(known),
            )
    if set(RIGID_BODY) <= set(header.modelled):
        raise LogError(
            "names both rigid_body and rigid_body_fixed", source=path, field="modelled", remedy="choose one"
        )
    _check_repeats(header.trials, path)
    _check_base(header, path)
    _check_no_torque(header, path)
    _check_coupling(header, path)
    _check_controller(header, path)


def _check_repeats(trials: tuple[TrialHeader, ...], path: Path) -> None:
    """Each repeats a trial of the log, and none itself, not even by way of others."""
    repeated = {trial.file: trial.repeats for trial in trials}
    sound: set[str | None] = {None}
    for trial in trials:
        way: dict[str, None] = {}
        name: str | None = trial.file
        while name is not None and name not in sound:
            field = f"trials.{name}.repeats"
            following = repeated[name]
            way[name] = None
            if following is not None and following not in repeated:
                files = ", ".join(repeated)[:200]
                raise LogError(
                    f"repeats {following!r}, which is no trial of this log",
                    source=path,
                    field=field,
                    remedy="name one of " + files,
                )
            if following in way:
                raise LogError(
                    f"repeats {following!r}, which repeats it",
                    source=path,
                    field=field,
                    remedy="name the trial that ran first, and leave that one's repeats out",
                )
            name = following
        sound |= way.keys()


def _check_base(header: LogHeader, path: Path) -> None:
    if not header.measures_contacts and header.torque is None:
        what = "a fixed-base log" if header.base == "fixed" else "a log without contact wrenches"
        raise LogError(
            "is missing",
            source=path,
            field="torque",
            remedy=f"{what} says motor_side, link_side, current or none",
        )
    if not header.free_base:
        return
    if header.base_link is None:
        raise LogError(
            "is missing", source=path, field="base_link", remedy="name the link whose pose is logged"
        )
    if header.sensors and header.wrench is None:
        raise LogError(
            "is missing", source=path, field="wrench", remedy="say wrench: on_robot_in_sensor_frame"
        )
    if header.base == "floating" and not header.sensors:
        if header.torque in {None, "none"}:
            remedy = "a floating base needs its contact sensors, or joint torques"
            raise LogError("is empty", source=path, field="sensors", remedy=remedy)
        if not header.feet:
            remedy = "a floating base without contact sensors needs its feet, and a flag contact.NAME of each"
            raise LogError("is empty", source=path, field="feet", remedy=remedy)


def _check_no_torque(header: LogHeader, path: Path) -> None:
    for joint in header.no_torque:
        if joint not in header.joints:
            raise LogError(
                f"no joint {joint!r} in this log",
                source=path,
                field="no_torque",
                remedy="the log has " + ", ".join(header.joints),
            )
    if not header.torque_joints:
        raise LogError(
            "names every joint", source=path, field="no_torque", remedy="write torque: none instead"
        )


def _check_coupling(header: LogHeader, path: Path) -> None:
    try:
        coupling_matrix(header.torque_joints, header.coupling)
    except InputError as error:
        raise LogError(error.what, source=path, field="coupling", remedy=error.remedy) from error


def _check_controller(header: LogHeader, path: Path) -> None:
    said = header.controller or {}
    for name in _CONTROLLER_NUMBERS:
        if name in said:
            _check_gain(said[name], f"controller.{name}", path)
    for gain in _GAINS:
        values = said.get(gain, {})
        if not isinstance(values, dict):
            for value in values if isinstance(values, list) else [values]:
                _check_gain(value, f"controller.{gain}", path)
            continue
        for joint, value in values.items():
            if joint not in header.joints:
                raise LogError(
                    f"no joint {str(joint)[:60]!r} in this log",
                    source=path,
                    field=f"controller.{gain}",
                    remedy="the log has " + ", ".join(header.joints),
                )
            _check_gain(value, f"controller.{gain}.{joint}", path)


def _check_gain(value: object, field: str, path: Path) -> None:
    try:
        # YAML takes 1e3 for a word.
        number = float(value) if isinstance(value, int | float | str) else math.nan
    except (ValueError, OverflowError):
        number = math.nan
    if value is not None and (isinstance(value, bool) or not 0.0 <= number <= _LARGEST_GAIN):
        raise LogError(
            f"is {str(value)[:60]!r}",
            source=path,
            field=field,
            remedy="give a number of 0 or more, or leave it out",
        )


def _check_unique_names(names: list[str] | tuple[str, ...], field: str, path: Path) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise LogError(f"{name!r} stands twice", source=path, field=field, remedy="name each once")
        seen.add(name)
