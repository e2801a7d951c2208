"""Log folders on disk, schema ``excite.log/1``: ``log.yaml``, the nominal model and one file a trial."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import yaml

from excite.atomic import atomic_folder
from excite.errors import LogError
from excite.logs.cleaning import clean_columns
from excite.logs.header import check_header, read_header
from excite.logs.log import Log, LogHeader, Trial, TrialHeader
from excite.logs.readers.registry import reader_for
from excite.robot.robot import Array, Robot
from excite.robot.urdf import parse_urdf
from excite.robot.urdf_tree import MOVING

BASE_POSE = tuple(f"base.{name}" for name in ("px", "py", "pz", "qx", "qy", "qz", "qw"))
WRENCH_AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
_JOINT_CHANNELS = {
    "q": "q",
    "tau": "tau",
    "i": "current",
    "q_cmd": "q_cmd",
    "tau_cmd": "tau_cmd",
    "v": "v",
    "a": "a",
}


def load_log(path: str | Path, robot: Robot | None = None) -> Log:
    """Read a log folder, check it, repair its rows.

    Repeated and swapped rows are repaired and counted, missing rows, clipping and quantisation counted
    (:class:`~excite.logs.log.Cleaning`, one per trial); everything else that is wrong is an error.

    Args:
        path: the folder, or its ``log.yaml``.
        robot: the robot that the log should be of; its joints and base are then checked, and the model
            file that ``log.yaml`` names need not be there.

    Returns:
        The log; every array finite, time strictly increasing.

    Raises:
        LogError: a file, field or column is missing, unknown, not numeric, not finite or contradictory.
        RobotError: the nominal model's file is malformed.
    """
    path = Path(path)
    path = path / "log.yaml" if path.is_dir() else path
    header = read_header(path)
    robot_text = _read_robot(header, path, robot)
    trials = tuple(_read_trial(entry, header, path) for entry in header.trials)
    return Log(header=header, trials=trials, folder=path.parent, robot_text=robot_text)


def save_log(log: Log, folder: str | Path) -> Path:
    """Write a log folder; it appears under its name only when it is complete, replacing an older log.

    Args:
        log: the log; the format of each trial follows its file's suffix in ``log.header.trials``.
        folder: where to.

    Returns:
        The folder.

    Raises:
        LogError: the header and the trials contradict each other, the nominal model's text is missing, or
            ``folder`` holds something that is no log.
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
    if folder.exists() and (
        not folder.is_dir() or (any(folder.iterdir()) and not (folder / "log.yaml").is_file())
    ):
        raise LogError("exists and is no log", source=folder, remedy="choose another folder")
    with atomic_folder(folder) as temporary:
        temporary.mkdir()
        text = yaml.safe_dump(
            header.model_dump(mode="json", by_alias=True, exclude_none=True), sort_keys=False
        )
        (temporary / "log.yaml").write_text(text, encoding="utf-8")
        (temporary / header.robot).write_text(log.robot_text, encoding="utf-8")
        for entry, trial in zip(header.trials, log.trials, strict=True):
            columns = trial_columns(trial, header)
            _check_columns(columns, header, folder / entry.file)
            reader_for(Path(entry.file)).write(columns, temporary / entry.file)
    return folder


def trial_columns(trial: Trial, header: LogHeader) -> dict[str, Array]:
    """Columns of a trial's file, ``(n,)`` each, by name, in order."""
    columns: dict[str, Array] = {"time": trial.time}
    if trial.base is not None:
        columns |= {name: trial.base[:, i] for i, name in enumerate(BASE_POSE)}
    for prefix, attribute in _JOINT_CHANNELS.items():
        values = getattr(trial, attribute)
        if values is not None:
            kept = _with_channel(prefix, header)
            columns |= {f"{prefix}.{joint}": values[:, header.joints.index(joint)] for joint in kept}
    for sensor in header.sensors:
        if sensor.name in trial.wrenches:
            wrench = trial.wrenches[sensor.name]
            columns |= {f"wrench.{sensor.name}.{axis}": wrench[:, i] for i, axis in enumerate(WRENCH_AXES)}
    return columns


def _read_robot(header: LogHeader, path: Path, robot: Robot | None) -> str | None:
    """Text of the nominal model, its joints checked against the header's."""
    if robot is not None:
        _check_joints(header.joints, robot.joint_names, path)
        if robot.floating != (header.base != "fixed"):
            raise LogError(
                f"is {header.base}, unlike that of robot {robot.name!r}",
                source=path,
                field="base",
                remedy=f"its base is {'floating' if robot.floating else 'fixed'}: check the robot",
            )
    file = path.parent / header.robot
    if not file.is_file():
        if robot is not None:
            return None
        raise LogError(
            f"no such file {header.robot!r}",
            source=path,
            field="robot",
            remedy="put the nominal model beside log.yaml",
        )
    if file.suffix in {".yaml", ".yml"}:
        return file.read_text(encoding="utf-8")
    if robot is None:
        joints = parse_urdf(file).findall("joint")
        _check_joints(
            header.joints, tuple(j.get("name", "") for j in joints if j.get("type") in MOVING), path
        )
    return file.read_text(encoding="utf-8")


def _check_joints(joints: Iterable[str], known: tuple[str, ...], path: Path) -> None:
    for joint in joints:
        if joint not in known:
            raise LogError(
                f"the robot has no joint {joint!r}",
                source=path,
                field="joints",
                remedy="it has " + ", ".join(known),
            )


def _read_trial(entry: TrialHeader, header: LogHeader, path: Path) -> Trial:
    file = path.parent / entry.file
    return read_columns(reader_for(file).read(file), entry, header, file)


def read_columns(columns: dict[str, Array], entry: TrialHeader, header: LogHeader, file: Path) -> Trial:
    """Check and repair the columns of a trial.

    Args:
        columns: columns by the contract's names, as they stand in the file.
        entry: the trial's entry in the header.
        header: the header.
        file: the file, for errors.

    Returns:
        The trial.

    Raises:
        LogError: a column is missing, unknown, not numeric or not finite, or time is not repairable.
    """
    wanted = _check_columns(columns, header, file)
    n_rows = np.size(columns["time"])
    cleaned = clean_columns({name: _numeric(columns[name], name, file, n_rows) for name in wanted}, file)
    values = cleaned.columns
    joint_values = {
        attribute: _joint_columns(values, prefix, header)
        for prefix, attribute in _JOINT_CHANNELS.items()
        if f"{prefix}.{_with_channel(prefix, header)[0]}" in values
    }
    base = None
    if BASE_POSE[0] in values:
        base = np.column_stack([values[name] for name in BASE_POSE])
        base[:, 3:] = _unit_quaternions(base[:, 3:], file)
    wrenches = {
        sensor.name: np.column_stack([values[f"wrench.{sensor.name}.{axis}"] for axis in WRENCH_AXES])
        for sensor in header.sensors
        if f"wrench.{sensor.name}.fx" in values
    }
    return Trial(
        name=Path(entry.file).stem,
        role=entry.role,
        time=values["time"],
        base=base,
        wrenches=wrenches,
        session=entry.session,
        start_s=entry.start_s,
        repeats=None if entry.repeats is None else Path(entry.repeats).stem,
        cleaning=cleaned.report,
        **joint_values,
    )


def _with_channel(prefix: str, header: LogHeader) -> tuple[str, ...]:
    """Joints that have a channel: all but, of torques and currents, those without."""
    return header.torque_joints if prefix in {"tau", "i"} else header.joints


def _joint_columns(values: dict[str, Array], prefix: str, header: LogHeader) -> Array:
    """A channel of all joints, zero where there is none, ``(n, n_joints)``."""
    nothing, kept = np.zeros_like(values["time"]), _with_channel(prefix, header)
    parts = [values[f"{prefix}.{joint}"] if joint in kept else nothing for joint in header.joints]
    return np.column_stack(parts)


def _check_columns(columns: Iterable[str], header: LogHeader, file: Path) -> list[str]:
    """Names of the columns that the header promises or allows; all of a group or none.

    Raises LogError for a promised column that is missing and for one that names an unknown joint or sensor.
    """
    present = list(columns)
    groups = {
        prefix: [f"{prefix}.{joint}" for joint in _with_channel(prefix, header)] for prefix in _JOINT_CHANNELS
    }
    groups["time"] = ["time"]
    groups["base"] = list(BASE_POSE)
    for sensor in header.sensors:
        groups[f"wrench.{sensor.name}"] = [f"wrench.{sensor.name}.{axis}" for axis in WRENCH_AXES]
    required = {"time", "q"}
    required |= {"tau"} if header.torque in {"motor_side", "link_side"} else set()
    required |= {"i"} if header.torque == "current" else set()
    required |= {"base"} if header.base != "fixed" else set()
    required |= {f"wrench.{sensor.name}" for sensor in header.sensors} if header.base == "floating" else set()
    allowed = {name for names in groups.values() for name in names}
    allowed |= {f"{prefix}.{joint}" for prefix in ("tau", "i") for joint in header.no_torque}
    for name in present:
        if name not in allowed and name.split(".")[0] in {*_JOINT_CHANNELS, "base", "wrench"}:
            raise LogError(
                "names no joint or sensor of log.yaml",
                source=file,
                field=name,
                remedy="correct one of the two",
            )
    wanted: list[str] = []
    for group, names in groups.items():
        missing = [name for name in names if name not in present]
        if missing and (group in required or len(missing) < len(names)):
            raise LogError(
                "column is missing", source=file, field=missing[0], remedy="log it, or correct log.yaml"
            )
        wanted += [] if missing else names
    return wanted


def _numeric(values: Array, name: str, file: Path, n_rows: int) -> Array:
    try:
        numbers = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise LogError(
            f"is not numeric ({error})", source=file, field=name, remedy="write numbers only"
        ) from error
    if numbers.ndim != 1:
        raise LogError(f"has shape {numbers.shape}", source=file, field=name, remedy="write one number a row")
    if len(numbers) != n_rows:
        raise LogError(
            f"has {len(numbers)} rows, time has {n_rows}", source=file, field=name, remedy="align the columns"
        )
    if not np.isfinite(numbers).all():
        row = int(np.argmax(~np.isfinite(numbers)))
        raise LogError(
            f"is {numbers[row]} in row {row}",
            source=file,
            field=name,
            remedy="leave out rows that were not measured",
        )
    return numbers


def _unit_quaternions(quaternions: Array, file: Path) -> Array:
    norm = np.linalg.norm(quaternions, axis=1)
    if (np.abs(norm - 1.0) > 1e-2).any():
        row = int(np.argmax(np.abs(norm - 1.0)))
        raise LogError(
            f"quaternion has norm {norm[row]:.4f} in row {row}",
            source=file,
            field="base.qw",
            remedy="log unit quaternions, x y z w",
        )
    # Leave those alone that are unit to rounding, so that reading what was saved changes nothing.
    return np.where(np.abs(norm - 1.0)[:, None] > 1e-9, quaternions / norm[:, None], quaternions)
