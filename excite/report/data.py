"""The arrays that a report shows and that no JSON file holds: ``report_data.npz``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from excite.atomic import atomic_path
from excite.errors import InputError
from excite.robot.robot import Array

Names = tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ForceComparison:
    """One validation trial, measured and predicted.

    Attributes:
        trial: name of the trial.
        channels: what each column is: ``fx`` … ``tz`` in the base frame, or joint names.
        units: unit of each column.
        time: ``(n,)`` [s].
        measured: ``(n, n_channels)``.
        nominal: prediction of the nominal model, ``(n, n_channels)``.
        identified: prediction of the identified model, ``(n, n_channels)``; of a diagnosis, the model with the effects.
    """

    trial: str
    channels: Names
    units: Names
    time: Array
    measured: Array
    nominal: Array
    identified: Array


@dataclass(frozen=True, eq=False)
class MassComparison:
    """Masses of the segments [kg], each ``(n_segments,)``.

    Attributes:
        names: readable names of the segments.
        nominal: of the model as supplied.
        identified: of the identified model.
        true: of the virtual robot; None where nobody knows, as on a real robot.
        changed: True where the identification says that the segment differs; None where not judged.
    """

    names: Names
    nominal: Array
    identified: Array
    true: Array | None = None
    changed: NDArray[np.bool_] | None = None


@dataclass(frozen=True, eq=False)
class ConditioningComparison:
    """Condition numbers of the segments' sub-regressors, before and after the choice of motions.

    Attributes:
        segments: readable names.
        before: ``(n_segments,)``, infinite where nothing excites the segment.
        after: ``(n_segments,)``, likewise.
        full_before: condition number of the base columns.
        full_after: likewise.
        before_label: what "before" is, for the legend.
        after_label: what "after" is.
    """

    segments: Names
    before: Array
    after: Array
    full_before: float
    full_after: float
    before_label: str = "before"
    after_label: str = "chosen motions"


@dataclass(frozen=True, eq=False)
class ReportData:
    """Everything in ``report_data.npz``; what there is nothing to say about is None; ``gap`` is a diagnosis's."""

    forces: ForceComparison | None = None
    masses: MassComparison | None = None
    conditioning: ConditioningComparison | None = None
    gap: ForceComparison | None = None


_PARTS: dict[str, type] = {
    "forces": ForceComparison,
    "masses": MassComparison,
    "conditioning": ConditioningComparison,
    "gap": ForceComparison,
}


def save_report_data(data: ReportData, path: Path) -> Path:
    """Write the arrays under the names ``PART/FIELD``; appears only when complete."""
    arrays: dict[str, Any] = {}
    for part, kind in _PARTS.items():
        content = getattr(data, part)
        for field in fields(kind) if content is not None else ():
            value = getattr(content, field.name)
            if value is not None:
                arrays[f"{part}/{field.name}"] = np.asarray(value)
    path = Path(path)
    with atomic_path(path) as temporary:
        np.savez_compressed(temporary, **arrays)
    return path


def load_report_data(path: Path) -> ReportData:
    """Read what :func:`save_report_data` wrote.

    Raises:
        InputError: unreadable, a field is missing, or the lengths of a part's arrays disagree.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise InputError(f"cannot be read ({error})", source=path, remedy="write it again") from error
    parts = {part: _part(part, kind, arrays, path) for part, kind in _PARTS.items()}
    return ReportData(**parts)


def _part(part: str, kind: type, arrays: Mapping[str, NDArray], path: Path) -> Any:
    prefix = part + "/"
    found = {name[len(prefix) :]: value for name, value in arrays.items() if name.startswith(prefix)}
    if not found:
        return None
    values: dict[str, Any] = {}
    for field in fields(kind):
        if field.name in found:
            values[field.name] = _native(found[field.name])
        elif field.default is not None and not isinstance(field.default, str):
            raise InputError("is missing", source=path, field=prefix + field.name, remedy="write it again")
    content = kind(**values)
    _check_lengths(part, content, path)
    return content


def _native(value: NDArray) -> Any:
    """Zero-dimensional arrays as scalars, text as tuples of str, numbers as they are."""
    if value.ndim == 0:
        return value.item()
    if value.dtype.kind == "U":
        return tuple(str(item) for item in value)
    return value


def _check_lengths(part: str, content: Any, path: Path) -> None:
    if isinstance(content, ForceComparison):
        shape: tuple[int, ...] = (len(content.time), len(content.channels))
        columns: tuple[str, ...] = ("measured", "nominal", "identified")
    elif isinstance(content, MassComparison):
        shape, columns = (len(content.names),), ("nominal", "identified", "true", "changed")
    else:
        shape, columns = (len(content.segments),), ("before", "after")
    for name in columns:
        value = getattr(content, name)
        if value is not None and value.shape != shape:
            raise InputError(
                f"has shape {value.shape}, not {shape}",
                source=path,
                field=f"{part}/{name}",
                remedy="write it again",
            )
