"""Strict reading of ``log.yaml``."""

from __future__ import annotations

from pathlib import Path

import yaml
from pydantic import ValidationError

from excite.errors import InputError, LogError
from excite.logs.log import LogHeader
from excite.logs.signals.coupling import coupling_matrix
from excite.logs.vocabulary import EFFECTS, RIGID_BODY


def read_header(path: Path) -> LogHeader:
    """Read and validate a ``log.yaml``.

    Raises:
        LogError: the file is missing, is no YAML, or something in it is unknown, doubled or contradictory.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise LogError("no such file", source=path, remedy="give a folder that holds a log.yaml") from error
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"cannot be read ({' '.join(str(error).split())})", source=path) from error
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        line = " ".join(str(error).split())
        raise LogError(f"is not valid YAML ({line})", source=path, remedy="mend the syntax") from error
    if not isinstance(content, dict):
        raise LogError("is not a mapping", source=path, remedy="write it as in the manual's log folder")
    try:
        header = LogHeader.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        shown = repr(first["input"]).replace("\n", " ")[:60]
        raise LogError(
            f"{first['msg']}, got {shown}",
            source=path,
            field=".".join(str(part) for part in first["loc"]) or None,
            remedy="see the manual's log folder",
        ) from error
    check_header(header, path)
    return header


def check_header(header: LogHeader, path: Path) -> None:
    """What the schema alone does not say; raises LogError."""
    _unique(header.joints, "joints", path)
    _unique([sensor.name for sensor in header.sensors], "sensors", path)
    files = [trial.file for trial in header.trials]
    _unique(files, "trials", path)
    _unique([Path(file).stem for file in files], "trials", path)
    known = (*RIGID_BODY, *EFFECTS)
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
    for trial in header.trials:
        if trial.repeats is not None and trial.repeats not in files:
            raise LogError(
                f"repeats {trial.repeats!r}, which is no trial of this log",
                source=path,
                field=f"trials.{trial.file}.repeats",
                remedy="name one of " + ", ".join(files),
            )
    _check_base(header, path)
    _check_no_torque(header, path)
    _check_coupling(header, path)
    _check_controller(header, path)


def _check_base(header: LogHeader, path: Path) -> None:
    if header.base == "fixed":
        if header.torque is None:
            raise LogError(
                "is missing",
                source=path,
                field="torque",
                remedy="a fixed-base log says motor_side, link_side, current or none",
            )
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
        raise LogError(
            "is empty", source=path, field="sensors", remedy="a floating base needs its contact sensors"
        )


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
    for gain in ("kp", "kd"):
        values = (header.controller or {}).get(gain, {})
        for joint in values if isinstance(values, dict) else ():
            if joint not in header.joints:
                raise LogError(
                    f"no joint {joint!r} in this log",
                    source=path,
                    field=f"controller.{gain}",
                    remedy="the log has " + ", ".join(header.joints),
                )


def _unique(names: list[str] | tuple[str, ...], field: str, path: Path) -> None:
    for i, name in enumerate(names):
        if name in names[:i]:
            raise LogError(f"{name!r} stands twice", source=path, field=field, remedy="name each once")
