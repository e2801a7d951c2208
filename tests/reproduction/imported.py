"""Recordings with columns of other people's naming, brought into a log by a mapping."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from excite.arrays import Array
from excite.errors import LogError
from excite.formats.documents import read_yaml
from excite.formats.registry import read_content
from excite.logs.columns import check_measured, numeric_column, read_columns
from excite.logs.header import check_header
from excite.logs.header_blocks import Role
from excite.logs.log import Log, LogHeader
from excite.logs.sampling import check_log_clock, check_stamps

_Model = TypeVar("_Model", bound=BaseModel)
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]


class _Block(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class RecordingTrial(_Block):
    """One trial cut from a recording.

    ``part`` is the share of the recording's duration that it covers, so that one file can serve as
    identification and validation trial; ``name`` has to differ then.
    """

    file: str
    role: Role
    name: str | None = None
    part: tuple[Fraction, Fraction] = (0.0, 1.0)
    session: str | None = None
    start_s: float | None = None


class RecordingMapping(_Block):
    """How recordings become a log.

    ``log`` is a ``log.yaml`` without ``schema`` and ``trials``. ``columns`` maps the contract's names to the
    recording's; ``{joint}`` stands for each joint of the log and ``{n}`` for its number from 1, as in
    ``q.{joint}: q{n}_rad``. The columns of an array ``(n, k)`` in an archive are called ``NAME.1`` to
    ``NAME.k``, as in ``q.{joint}: positions.{n}``. ``scale`` multiplies columns on the way, under the same
    names (for example ``q.{joint}: 0.017453292519943295`` for degrees). ``flip`` names columns whose sign is
    turned.
    """

    log: dict[str, Any]
    columns: dict[str, str]
    scale: dict[str, float] = {}
    flip: tuple[str, ...] = ()
    trials: Annotated[tuple[RecordingTrial, ...], Field(min_length=1)]


@dataclass(frozen=True)
class _Column:
    target: str
    source: str
    factor: float


def import_recordings(mapping: Mapping[str, Any] | Path, folder: Path, robot_text: str | None = None) -> Log:
    """Read recordings whose columns somebody else named as a log, to identify from or to save.

    With, in ``map.yaml``::

        log: {robot: ur10.urdf, base: fixed, rate_hz: 500, joints: [shoulder, elbow], torque: motor_side, modelled: []}
        columns: {time: t_ms, "q.{joint}": "actual_q{n}", "tau.{joint}": "torque_{n}"}
        scale: {time: 0.001}
        trials:
          - {file: slow.csv, role: identification}
          - {file: fast.csv, role: validation}

    Args:
        mapping: a :class:`RecordingMapping` as a dictionary, or a YAML file that holds one.
        folder: folder that the trials' files are relative to.
        robot_text: text of the nominal model, needed if the log is to be saved.

    Returns:
        The log, checked and repaired as by :func:`~excite.logs.files.load_log`.

    Raises:
        LogError: the mapping or a recording is wrong.
    """
    source = mapping if isinstance(mapping, Path) else "mapping"
    parsed = _parse_mapping(mapping, source)
    names = [trial.name or Path(trial.file).stem for trial in parsed.trials]
    entries = [
        {"file": f"{name}.parquet"} | trial.model_dump(include={"role", "session", "start_s"})
        for name, trial in zip(names, parsed.trials, strict=True)
    ]
    header = _validate_content(LogHeader, {"schema": "excite.log/1", "trials": entries} | parsed.log, source)
    check_header(header, Path(str(source)))
    columns = _expand_columns(parsed, header, source)
    trials = tuple(
        read_columns(
            _cut_columns(folder / trial.file, trial.part, columns), entry, header, folder / trial.file
        )
        for trial, entry in zip(parsed.trials, header.trials, strict=True)
    )
    check_log_clock(trials, header, folder / "log.yaml")
    check_measured(trials, header, folder / "log.yaml")
    return Log(header=header, trials=trials, folder=None, robot_text=robot_text)


def _parse_mapping(mapping: Mapping[str, Any] | Path, source: object) -> RecordingMapping:
    if not isinstance(mapping, Path):
        return _validate_content(RecordingMapping, dict(mapping), source)
    return _validate_content(RecordingMapping, read_yaml(mapping), source)


def _validate_content(kind: type[_Model], content: object, source: object) -> _Model:
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or None
        raise LogError(first["msg"], source=source, field=field, remedy="see RecordingMapping") from error


def _expand_columns(mapping: RecordingMapping, header: LogHeader, source: object) -> list[_Column]:
    """Columns with the joints filled in."""

    def expand(name: str) -> list[tuple[str, dict[str, str]]]:
        if "{joint}" not in name:
            return [(name, {})]
        numbered = enumerate(header.joints, start=1)
        return [(name.replace("{joint}", j), {"{joint}": j, "{n}": str(n)}) for n, j in numbered]

    factors: dict[str, float] = {}
    for name, factor in [*mapping.scale.items(), *((name, -1.0) for name in mapping.flip)]:
        for target, _ in expand(name):
            factors[target] = factors.get(target, 1.0) * factor
    columns = []
    for name, theirs in mapping.columns.items():
        for target, values in expand(name):
            column = theirs
            for mark, value in values.items():
                column = column.replace(mark, value)
            columns.append(_Column(target, column, factors.pop(target, 1.0)))
    if factors:
        raise LogError(
            "scales no column", source=source, field=next(iter(factors)), remedy="map it under columns"
        )
    return columns


def _single_columns(found: dict[str, Array]) -> dict[str, Array]:
    """Arrays ``(n, k)`` taken apart into columns ``NAME.1 … NAME.k``."""
    return {
        f"{name}.{i + 1}" if np.ndim(values) == 2 else name: column
        for name, values in found.items()
        for i, column in enumerate(np.atleast_2d(np.transpose(values)))
    }


def _cut_columns(file: Path, part: tuple[float, float], wanted: list[_Column]) -> dict[str, Array]:
    """The wanted columns of a file under the contract's names, from the wanted part of its duration."""
    content = read_content(file)
    found = _single_columns(content.written or content.columns)
    columns = {}
    for column in wanted:
        if column.source not in found:
            raise LogError(
                "column is missing",
                source=file,
                field=column.source,
                remedy="the file has " + ", ".join(found)[:200],
            )
        values = found[column.source]
        if column.factor != 1.0:
            values = numeric_column(values, column.source, file, len(values)) * column.factor
        columns[column.target] = values
    if "time" not in columns:
        raise LogError(
            "no column is mapped to it", source=file, field="time", remedy="map time under columns"
        )
    time = numeric_column(columns["time"], "time", file, np.size(columns["time"]))
    check_stamps(time, file)
    low, high = (time[0] + share * (time[-1] - time[0]) for share in part)
    inside = (time >= low) & (time <= high) if part[1] == 1.0 else (time >= low) & (time < high)
    return {name: numeric_column(values, name, file, len(time))[inside] for name, values in columns.items()}
