"""Columns of a trial's file, by the contract's names: written, and checked when read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from excite.arrays import Array, Flags
from excite.errors import LogError
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import Cleaning, LogHeader, Trial
from excite.logs.quantisation import channel_noise, coarse_step
from excite.logs.sampling import FEWEST_ROWS, SAME_S, check_span, check_stamps, in_seconds, missing_rows
from excite.motion.content import BASE_POSE, unit_quaternions

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
    **dict.fromkeys("q q_cmd v i imu".split(), 1e6),
    **dict.fromkeys("a tau tau_cmd wrench".split(), 1e9),
    "base": 1e7,
}


def _column_groups(header: LogHeader) -> dict[str, tuple[str, ...]]:
    """Columns that a trial's file may have, in order; a file has all of a group or none."""
    groups: dict[str, tuple[str, ...]] = {"time": ("time",), "base": BASE_POSE}
    for prefix in _JOINT_CHANNELS:
        # Of torques and currents some joints have none.
        joints = header.torque_joints if prefix in {"tau", "i"} else header.joints
        groups[prefix] = tuple(f"{prefix}.{joint}" for joint in joints)
    for sensor in header.sensors:
        groups[f"wrench.{sensor.name}"] = tuple(f"wrench.{sensor.name}.{axis}" for axis in WRENCH_AXES)
    groups["imu"] = IMU_AXES if header.imu is not None else ()
    return groups | {name: (name,) for name in (f"contact.{foot.name}" for foot in header.feet)}


def trial_columns(trial: Trial, header: LogHeader) -> dict[str, Array]:
    """Columns of a trial's file, ``(n,)`` each, by name, in order."""
    tables = {"time": trial.time[:, None], "base": trial.base, "imu": trial.imu}
    tables |= {f"wrench.{name}": values for name, values in trial.wrenches.items()}
    tables |= {f"contact.{name}": flags[:, None].astype(float) for name, flags in trial.contacts.items()}
    columns: dict[str, Array] = {}
    for group, names in _column_groups(header).items():
        values = getattr(trial, _JOINT_CHANNELS[group]) if group in _JOINT_CHANNELS else tables.get(group)
        if values is not None and group in _JOINT_CHANNELS:
            values = values[:, [header.joints.index(name.partition(".")[2]) for name in names]]
        columns |= {} if values is None else {name: values[:, i] for i, name in enumerate(names)}
    return columns


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
    numbers = {name: numeric_column(columns[name], name, file, n_rows) for name in wanted}
    numbers["time"], unit = in_seconds(numbers["time"], header.rate_hz)
    cleaned = clean_columns(numbers, file)
    values = cleaned.columns
    tables = {
        group: np.column_stack([values[name] for name in names])
        for group, names in _column_groups(header).items()
        if names and names[0] in values
    }
    joint_values: dict[str, Any] = {}
    for prefix, attribute in _JOINT_CHANNELS.items():
        if prefix in tables:
            # Zero of joints that have no such channel.
            nothing = np.zeros_like(values["time"])
            parts = [values.get(f"{prefix}.{joint}", nothing) for joint in header.joints]
            joint_values[attribute] = np.column_stack(parts)
    base = tables.get("base")
    if base is not None:
        base[:, 3:] = _unit_quaternions(base[:, 3:], file)
    return Trial(
        name=Path(entry.file).stem,
        role=entry.role,
        time=values["time"],
        base=base,
        wrenches=_of_kind(tables, "wrench."),
        contacts={name: flags[:, 0] > 0.5 for name, flags in _of_kind(tables, "contact.").items()},
        imu=tables.get("imu"),
        session=entry.session,
        start_s=entry.start_s,
        repeats=None if entry.repeats is None else Path(entry.repeats).stem,
        beyond=None,
        cleaning=replace(cleaned.report, time_unit=unit),
        **joint_values,
    )


def _of_kind(tables: dict[str, Array], prefix: str) -> dict[str, Array]:
    return {name.removeprefix(prefix): table for name, table in tables.items() if name.startswith(prefix)}


def check_columns(columns: Iterable[str], header: LogHeader, file: Path) -> list[str]:
    """Names of the columns that the header promises or allows, time first; all of a group or none.

    Raises LogError for a promised column that is missing and for one that names an unknown joint or sensor.
    """
    present, groups = set(columns), _column_groups(header)
    required = {"time", "q"}
    required |= set() if header.measures_contacts else {f"contact.{foot.name}" for foot in header.feet}
    required |= {"tau"} if header.torque in {"motor_side", "link_side"} else set()
    required |= {"i"} if header.torque == "current" else set()
    required |= {"imu"} if header.uses_imu else {"base"} if header.free_base else set()
    required |= {f"wrench.{sensor.name}" for sensor in header.sensors} if header.base == "floating" else set()
    allowed = {name for names in groups.values() for name in names}
    allowed |= {f"{prefix}.{joint}" for prefix in ("tau", "i") for joint in header.no_torque}
    kinds = {*_JOINT_CHANNELS, "base", "wrench", "contact", "imu"}
    for name in columns:
        if name not in allowed and name.partition(".")[0] in kinds:
            what, remedy = "names no joint, sensor, foot or IMU of log.yaml", "correct one of the two"
            raise LogError(what, source=file, field=name, remedy=remedy)
    wanted: list[str] = []
    for group, names in groups.items():
        missing = [name for name in names if name not in present]
        if missing and (group in required or len(missing) < len(names)):
            remedy = "log it, or correct log.yaml"
            raise LogError("column is missing", source=file, field=missing[0], remedy=remedy)
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
    what, remedy = _shape_fault(values, n_rows)
    if not what:
        values = values.astype(float, copy=False)
        what, remedy = _number_fault(values, _LARGEST.get(name.partition(".")[0], np.inf))
    if what:
        raise LogError(what, source=file, field=name, remedy=remedy)
    return values


def _shape_fault(values: Array, n_rows: int) -> tuple[str, str]:
    """What is wrong, empty where nothing is, and the remedy."""
    if values.dtype.kind not in "fiu":
        return f"is not numeric (it is of type {values.dtype})", "write numbers only"
    if values.ndim != 1:
        return f"has shape {values.shape}", "write one number a row"
    return (
        f"has {len(values)} rows, time has {n_rows}" if len(values) != n_rows else ""
    ), "align the columns"


def _number_fault(values: Array, largest: float) -> tuple[str, str]:
    finite, small = np.isfinite(values), np.abs(values) <= largest
    if not finite.all():
        row = int(np.argmin(finite))
        return f"is {values[row]} in row {row}", "leave out rows that were not measured"
    if small.all():
        return "", ""
    row = int(np.argmin(small))
    what = f"is {values[row]:.4g} in row {row}, more than any robot has ({largest:g})"
    return what, "leave the row out, or correct the unit"


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
    return unit_quaternions(quaternions)


# Finding and repairing what loggers do to samples: repeated, swapped and missing rows, clipping, steps.

# A quantised position that moves changes within so many rows.
_AROUND = 8
# Commands are clipped and stepped on purpose.
_NOT_MEASURED = {"time", "q_cmd", "tau_cmd"}


@dataclass(frozen=True, eq=False)
class CleanColumns:
    """Columns in strictly increasing time, and the report of what was done to them."""

    columns: dict[str, Array]
    report: Cleaning


def clean_columns(columns: dict[str, Array], path: Path) -> CleanColumns:
    """Put rows in order of time, drop repeated ones, and count what is missing, clipped or coarse.

    A repeated time stamp keeps its first row. Rows out of order are put in order as long as they are at
    most 1 % of all; more than that is a clock that went back, which nothing here can mend.

    Args:
        columns: finite columns ``(n,)`` by name, ``time`` [s] among them.
        path: the file, for errors.

    Returns:
        The repaired columns and the report.

    Raises:
        LogError: time goes back too often, is not in seconds, or leaps too far, or fewer than 16 distinct samples are
            left.
    """
    time = columns["time"]
    check_stamps(time, path)
    late = time < np.maximum.accumulate(time)
    reordered = int(late.sum())
    if reordered > max(1, 0.01 * len(time)):
        row = int(np.argmax(late))
        raise LogError(
            f"goes back from {time[row - 1]:.6g} s to {time[row]:.6g} s in row {row}, {reordered} rows late",
            source=path,
            field="time",
            remedy="split the recording where its clock was reset",
        )
    order = np.argsort(time, kind="stable")
    keep = order[np.concatenate([[True], np.diff(time[order]) > SAME_S])]
    repeated = len(time) - len(keep)
    if len(keep) < FEWEST_ROWS:
        raise LogError(
            f"has {len(keep)} distinct samples",
            source=path,
            field="time",
            remedy=f"at least {FEWEST_ROWS} are needed",
        )
    # Rows that are all in order are not copied.
    rows = slice(None) if not repeated and not reordered else keep
    cleaned = {name: values[rows] for name, values in columns.items()}
    check_span(cleaned["time"], path)
    step = np.diff(cleaned["time"])
    median = float(np.median(step))
    missing = missing_rows(cleaned["time"])
    measured = {name: values for name, values in cleaned.items() if name.split(".")[0] not in _NOT_MEASURED}
    sizes = channel_noise(cleaned["time"], list(measured.values()))
    noise = dict(zip(measured, sizes, strict=True))
    quantised = {
        name: size for name, values in measured.items() if (size := coarse_step(values, noise[name]))
    }
    moving = _in_motion([values for name, values in cleaned.items() if name.startswith("q.")], len(keep))
    clipped = {
        name: count
        for name, values in measured.items()
        if (count := clipped_samples(values, quantised.get(name, 0.0), noise[name], moving))
    }
    report = Cleaning(
        repeated_rows=repeated,
        reordered_rows=reordered,
        missing_rows=int(missing.sum()),
        longest_gap_s=float(step.max()),
        rate_hz=1.0 / median,
        jitter=float(np.std(step[missing == 0]) / median),
        clipped=clipped,
        quantised=quantised,
    )
    return CleanColumns(cleaned, report)


def _in_motion(positions: list[Array], n: int) -> Flags:
    """Rows ``(n,)`` near which any position changes; all where there are no positions."""
    if not positions:
        return np.ones(n, dtype=bool)
    changes = np.zeros(n - 1, dtype=bool)
    for values in positions:
        changes |= np.diff(values) != 0.0
    passed = np.concatenate([[0], np.cumsum(np.concatenate([[False], changes]))])
    rows = np.arange(n)
    return np.asarray(passed[np.minimum(rows + _AROUND + 1, n)] > passed[np.maximum(rows - _AROUND, 0)])


_LEAST, _SHARE = 8, 0.002
# Depth below the extreme at which an approach is judged, in steps or deviations of the noise, and how much deeper
# it is judged again. A straight approach takes four times as long from there, one that turns back or comes to rest
# twice, and 2.5 times where a step hides the top of a parabola.
_DEEP, _DEEPER = 4.0, 4.0
# Rows that an approach takes from the first depth.
_ROWS = 2
# Share of the usual pace from row to row above which noise is seen; curves of a tenth of the rate have half of that.
_NOISY = 0.2


def clipped_samples(values: Array, step: float, noise: float, moving: Flags) -> int:
    """Samples at the largest or smallest value of a channel, where that is the end of its range.

    A clipped channel is at its extreme much more often than next to it, and arrives there at speed, or its noise stops
    there. One that turns back is there as often as its resolution makes it, and one that comes to rest arrives slowly.

    Args:
        values: ``(n,)``.
        step: of a quantised channel, else 0, same unit.
        noise: standard deviation of the channel's noise, same unit.
        moving: ``(n,)`` rows in which the robot moves; at standstill any channel stays where it is.

    Returns:
        Their number; 0 where the channel is not clipped.
    """
    if values.max() == values.min():
        return 0
    depth, noisy = _DEEP * max(step, noise), step == 0.0 and _is_noisy(values)
    return sum(_at_the_top(sign * values, step, depth, moving, noisy) for sign in (1.0, -1.0))


def _is_noisy(values: Array) -> bool:
    """Whether noise is seen in each row that is not at an extreme, so that no value is met twice in a row."""
    top, bottom = values == values.max(), values == values.min()
    inside = ~(top | bottom)
    # Noise that is wider than the range goes from one end to the other from row to row.
    if inside.sum() >= _LEAST <= np.sum((top[:-1] & bottom[1:]) | (bottom[:-1] & top[1:])):
        return True
    four = inside[:-3] & inside[1:-2] & inside[2:-1] & inside[3:]
    if four.sum() < _LEAST:
        return False
    # A third difference holds the noise of its rows with 1, 3, 3, 1, and next to nothing of a smooth curve.
    noise = np.median(np.abs(np.diff(values, 3)[four])) / np.sqrt(20.0)
    paces = np.abs(np.diff(values)[inside[:-1] & inside[1:]])
    return bool(paces.min() > 0.0 and noise > _NOISY * np.median(paces))


def _at_the_top(values: Array, step: float, depth: float, moving: Flags, noisy: bool) -> int:
    below = values.max() - values
    at = (below < 0.5 * step) if step else (below == 0.0)
    count = int(np.sum(at & moving))
    # How much more often a clipped channel is at its extreme than at any value near it. A parabola's top level is met
    # at most 2.4 times as often as the next.
    if count < max(_LEAST, _SHARE * len(values)) or count < 4.0 * _share_beside_extreme(below[moving], step):
        return 0
    if noisy and np.sum(at[:-1] & at[1:] & moving[1:]) > 0.5 * count:
        return count
    ways = [way for direction in (1, -1) for way in _ways_out(below[::direction], at[::direction])]
    starts = [way[_ROWS] for way in ways if len(way) > _ROWS]
    depth = max(depth, float(np.median(starts))) if starts else depth
    deep, deeper = depth + 0.5 * step, _DEEPER * depth + 0.5 * step
    # A step so coarse that approaches are judged over more than this share of the range tells nothing: far away, all
    # are alike.
    if _DEEPER * _DEEP * step > 0.1 * float(below.max()):
        return 0
    # A way that comes back before it is deep is part of what is at the top.
    times = np.array([[np.argmax(way > d) for d in (deep, deeper)] for way in ways if way.max() > deeper])
    if len(times) < 2:
        return 0
    short, long = times.sum(axis=0)
    return count if long > 2.75 * short + 0.5 * np.sqrt(len(times)) else 0


def _ways_out(below: Array, at: Flags) -> list[Array]:
    """Distances from the extreme, from the row after it on, until the channel is back or the record ends."""
    out = np.flatnonzero(at[:-1] & ~at[1:]) + 1
    back = np.flatnonzero(at)
    ends = np.append(back, len(at))[np.searchsorted(back, out)]
    return [below[first:last] for first, last in zip(out, ends, strict=True)]


def _share_beside_extreme(below: Array, step: float) -> float:
    """How often the channel is at a value near its extreme: the most of the next levels, or of nearly all values."""
    if step:
        levels = np.rint(below / step)
        return float(max(np.sum(levels == k) for k in range(1, 3 + 1)))
    counts = np.unique(below[below > 0.0], return_counts=True)[1]
    return float(np.quantile(counts, 0.99)) if len(counts) else 0.0


# Whether anything was measured of the torques that a log promises.


def check_measured(trials: Sequence[Trial], header: LogHeader, path: Path) -> None:
    """Refuse a log from whose torques, or currents, nothing can be identified as all stay as they are.

    Single channels that are dead are found later, and the others used.

    Args:
        trials: read and repaired; those of role ``identification`` count, where there are any.
        header: of the log.
        path: its ``log.yaml``, for errors.

    Raises:
        LogError: names the channels.
    """
    trials = [trial for trial in trials if trial.role == "identification"] or trials
    measured = [header.joints.index(joint) for joint in header.torque_joints]
    for attribute, prefix in (("tau", "tau"), ("current", "i")):
        values = [getattr(trial, attribute) for trial in trials]
        wanted = header.torque != "none" and all(value is not None for value in values)
        # No sensor resolves less [N·m, N or A].
        if wanted and not any((np.ptp(value[:, measured], axis=0) > 1e-9).any() for value in values):
            raise LogError(
                "never changes, of no joint and in no identification trial",
                source=path,
                field=f"{prefix}.*",
                remedy="log what was measured, or write torque: none and leave the columns out",
            )
