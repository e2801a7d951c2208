"""Strict reading of ``log.yaml``, the header of a log folder."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from excite.errors import InputError, LogError, raised_as
from excite.formats.documents import check_content, read_yaml
from excite.logs.log import LogHeader
from excite.logs.signals.coupling import coupling_matrix
from excite.logs.vocabulary import EFFECTS, RIGID_BODY

# Gains that the servos of large robots have stay below [N·m/rad, N·m·s/rad, Hz].
_LARGEST_GAIN = 1e9
_MANUAL = "see docs/formats.md, or let `excite init-log` write one to fill in"


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


@raised_as(LogError)
def read_header(path: Path) -> LogHeader:
    """Read and validate a ``log.yaml``.

    Raises:
        LogError: the file is missing, is no YAML, or something in it is unknown, doubled or contradictory.
    """
    content = read_yaml(path, remedy=_MANUAL)
    _check_complete(content, path)
    header = check_content(LogHeader, content, path, remedy=_MANUAL)
    check_header(header, path)
    return header


def _check_complete(content: dict[str, Any], path: Path) -> None:
    """Name all fields that are missing, those too that only some logs need; one alone is told by what checks it."""
    base = content.get("base")
    needed = ["schema", "robot", "base", "rate_hz", "joints", "trials"]
    needed += ["base_link"] if base in ("floating", "suspended") else ["torque"]
    needed += ["sensors", "wrench"] if base == "floating" and not content.get("feet") else []
    missing = [name for name in needed if content.get(name) is None]
    if len(missing) > 1:
        raise LogError("are missing", source=path, field=", ".join(missing), remedy=_MANUAL)


def check_header(header: LogHeader, path: Path) -> None:
    """What the schema alone does not say; raises LogError."""
    for check in _CHECKS:
        for what, field, remedy in check(header):
            raise LogError(what, source=path, field=field, remedy=remedy)


class _Fault(NamedTuple):
    what: str
    field: str
    remedy: str


def _doubled_names(header: LogHeader) -> Iterator[_Fault]:
    files = [trial.file for trial in header.trials]
    for field, names in (
        ("joints", header.joints),
        ("sensors", [sensor.name for sensor in header.sensors]),
        ("feet", [foot.name for foot in header.feet]),
        ("trials", files),
        ("trials", [Path(file).stem for file in files]),
        ("modelled", header.modelled),
    ):
        for name, times in Counter(names).items():
            if times > 1:
                yield _Fault(f"{name!r} stands twice", field, "name each once")


def _unknown_baseline(header: LogHeader) -> Iterator[_Fault]:
    known = (*RIGID_BODY, *EFFECTS)
    for name in header.modelled:
        if name not in known:
            yield _Fault(f"unknown name {name!r}", "modelled", "choose among " + ", ".join(known))
    if set(RIGID_BODY) <= set(header.modelled):
        yield _Fault("names both rigid_body and rigid_body_fixed", "modelled", "choose one")


def _endless_repeats(header: LogHeader) -> Iterator[_Fault]:
    """Each repeats a trial of the log, and none itself, not even by way of others."""
    repeated = {trial.file: trial.repeats for trial in header.trials}
    sound: set[str | None] = {None}
    for trial in header.trials:
        way: dict[str, None] = {}
        name: str | None = trial.file
        while name is not None and name not in sound:
            field, following = f"trials.{name}.repeats", repeated[name]
            way[name] = None
            if following is not None and following not in repeated:
                files = "name one of " + ", ".join(repeated)[:200]
                yield _Fault(f"repeats {following!r}, which is no trial of this log", field, files)
            if following in way:
                remedy = "name the trial that ran first, and leave that one's repeats out"
                yield _Fault(f"repeats {following!r}, which repeats it", field, remedy)
            name = following
        sound |= way.keys()


def _unstated_forces(header: LogHeader) -> Iterator[_Fault]:
    if not header.measures_contacts and header.torque is None:
        what = "a fixed-base log" if header.base == "fixed" else "a log without contact wrenches"
        yield _Fault("is missing", "torque", f"{what} says motor_side, link_side, current or none")
    if not header.free_base:
        return
    if header.base_link is None:
        yield _Fault("is missing", "base_link", "name the link whose pose is logged")
    if header.sensors and header.wrench is None:
        yield _Fault("is missing", "wrench", "say wrench: on_robot_in_sensor_frame")
    if header.base == "floating" and not header.sensors:
        if header.torque in {None, "none"}:
            yield _Fault("is empty", "sensors", "a floating base needs its contact sensors, or joint torques")
        if not header.feet:
            remedy = "a floating base without contact sensors needs its feet, and a flag contact.NAME of each"
            yield _Fault("is empty", "feet", remedy)


def _wrong_torques(header: LogHeader) -> Iterator[_Fault]:
    for joint in header.no_torque:
        if joint not in header.joints:
            yield _unknown_joint(joint, "no_torque", header)
    if not header.torque_joints:
        yield _Fault("names every joint", "no_torque", "write torque: none instead")
    try:
        coupling_matrix(header.torque_joints, header.coupling)
    except InputError as error:
        yield _Fault(error.what, "coupling", error.remedy or "")


def _wrong_gains(header: LogHeader) -> Iterator[_Fault]:
    said = header.controller or {}
    values = [(f"controller.{name}", said[name]) for name in ("rate_hz", "delay_s") if name in said]
    for gain in ("kp", "kd", "ki"):
        field, stated = f"controller.{gain}", said.get(gain, {})
        if isinstance(stated, dict):
            for joint in stated:
                if joint not in header.joints:
                    yield _unknown_joint(str(joint)[:60], field, header)
            values += [(f"{field}.{joint}", value) for joint, value in stated.items()]
        else:
            values += [(field, value) for value in (stated if isinstance(stated, list) else [stated])]
    for field, value in values:
        if value is not None and not _is_gain(value):
            yield _Fault(f"is {str(value)[:60]!r}", field, "give a number of 0 or more, or leave it out")


def _unknown_joint(joint: str, field: str, header: LogHeader) -> _Fault:
    return _Fault(f"no joint {joint!r} in this log", field, "the log has " + ", ".join(header.joints))


def _is_gain(value: object) -> bool:
    """Whether it is a number in bounds; YAML takes 1e3 for a word."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return False
    try:
        return 0.0 <= float(value) <= _LARGEST_GAIN
    except (ValueError, OverflowError):
        return False


_CHECKS: tuple[Callable[[LogHeader], Iterator[_Fault]], ...] = (
    _doubled_names,
    _unknown_baseline,
    _endless_repeats,
    _unstated_forces,
    _wrong_torques,
    _wrong_gains,
)
