"""Columns of a trial's file, by the contract's names: written, and checked when read."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.cleaning import clean_columns
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import LogHeader, Trial
from excite.logs.sampling import in_seconds

BASE_POSE = tuple(f"base.{name}" for name in ("px", "py", "pz", "qx", "qy", "qz", "qw"))
IMU_AXES = tuple(f"imu.{name}" for name in ("gx", "gy", "gz", "ax", "ay", "az"))
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
# What is larger is no reading in any unit that people log in (degrees, millimetres, N·mm, mA), but a counter that
# overflowed or a float read from the wrong bytes: turns of years, map coordinates, the largest drives in N·mm. Squares
# and products of what is below stay far from the largest float.
_LARGEST = {
    "q": 1e6,
    "q_cmd": 1e6,
    "v": 1e6,
    "a": 1e9,
    "tau": 1e9,
    "tau_cmd": 1e9,
    "i": 1e6,
    "base": 1e7,
    "wrench": 1e9,
    "imu": 1e6,
}


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
    if trial.imu is not None:
        columns |= {name: trial.imu[:, i] for i, name in enumerate(IMU_AXES)}
    return columns | {f"contact.{name}": flags.astype(float) for name, flags in trial.contacts.items()}


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
    wanted = check_columns(columns, header, file)
    n_rows = np.size(columns["time"])
    # The time before all, by whose rows the others are counted.
    wanted = ["time", *(name for name in wanted if name != "time")]
    numbers = {name: numeric_column(columns[name], name, file, n_rows) for name in wanted}
    numbers["time"], unit = in_seconds(numbers["time"], header.rate_hz)
    cleaned = clean_columns(numbers, file)
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
    flags = {
        foot.name: values[f"contact.{foot.name}"] > 0.5
        for foot in header.feet
        if f"contact.{foot.name}" in values
    }
    return Trial(
        name=Path(entry.file).stem,
        role=entry.role,
        time=values["time"],
        base=base,
        wrenches=wrenches,
        contacts=flags,
        imu=np.column_stack([values[name] for name in IMU_AXES]) if IMU_AXES[0] in values else None,
        session=entry.session,
        start_s=entry.start_s,
        repeats=None if entry.repeats is None else Path(entry.repeats).stem,
        beyond=None,
        cleaning=replace(cleaned.report, time_unit=unit),
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


def check_columns(columns: Iterable[str], header: LogHeader, file: Path) -> list[str]:
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
    if header.imu is not None:
        groups["imu"] = list(IMU_AXES)
    for foot in header.feet:
        groups[f"contact.{foot.name}"] = [f"contact.{foot.name}"]
    required = {"time", "q"}
    required |= set() if header.measures_contacts else {f"contact.{foot.name}" for foot in header.feet}
    required |= {"tau"} if header.torque in {"motor_side", "link_side"} else set()
    required |= {"i"} if header.torque == "current" else set()
    required |= {"imu"} if header.uses_imu else {"base"} if header.free_base else set()
    required |= {f"wrench.{sensor.name}" for sensor in header.sensors} if header.base == "floating" else set()
    allowed = {name for names in groups.values() for name in names}
    allowed |= {f"{prefix}.{joint}" for prefix in ("tau", "i") for joint in header.no_torque}
    for name in present:
        if name not in allowed and name.split(".")[0] in {
            *_JOINT_CHANNELS,
            "base",
            "wrench",
            "contact",
            "imu",
        }:
            raise LogError(
                "names no joint, sensor, foot or IMU of log.yaml",
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


def numeric_column(values: Array, name: str, file: Path, n_rows: int) -> Array:
    """A column as numbers that a robot can have; raises LogError.

    Args:
        values: as they stand in the file.
        name: of the column, by the contract.
        file: for errors.
        n_rows: rows that it should have.
    """
    values = np.asarray(values)
    if values.dtype.kind not in "fiu":
        raise LogError(
            f"is not numeric (it is of type {values.dtype})",
            source=file,
            field=name,
            remedy="write numbers only",
        )
    if values.ndim != 1:
        raise LogError(f"has shape {values.shape}", source=file, field=name, remedy="write one number a row")
    if len(values) != n_rows:
        raise LogError(
            f"has {len(values)} rows, time has {n_rows}", source=file, field=name, remedy="align the columns"
        )
    numbers = values.astype(float, copy=False)
    if not np.isfinite(numbers).all():
        row = int(np.argmax(~np.isfinite(numbers)))
        raise LogError(
            f"is {numbers[row]} in row {row}",
            source=file,
            field=name,
            remedy="leave out rows that were not measured",
        )
    largest = _LARGEST.get(name.split(".")[0], np.inf)
    if n_rows and max(-numbers.min(), numbers.max()) > largest:
        row = int(np.argmax(np.abs(numbers) > largest))
        raise LogError(
            f"is {numbers[row]:.4g} in row {row}, more than any robot has ({largest:g})",
            source=file,
            field=name,
            remedy="leave the row out, or correct the unit",
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
