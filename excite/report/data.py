"""The arrays that a report shows and that no JSON file holds: ``report_data.npz``, of a log ``doctor_data.npz``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.atomic import atomic_path
from excite.documents.document import LARGEST, MOST_CHANNELS
from excite.errors import InputError
from excite.reading.npz_arrays import read_npz
from excite.report.comparisons import ConditioningComparison, ForceComparison, MassComparison, PathComparison


@dataclass(frozen=True, eq=False)
class ReportData:
    """Everything that is in such files; what there is nothing to say about is None.

    ``gap`` is a diagnosis's; ``torques`` are of a log that was looked through, and in a file of their own, since an
    identification or a diagnosis of the log may be written to the same folder.
    """

    forces: ForceComparison | None = None
    masses: MassComparison | None = None
    conditioning: ConditioningComparison | None = None
    gap: ForceComparison | None = None
    path: PathComparison | None = None
    torques: ForceComparison | None = None


DOCTOR_DATA = "doctor_data.npz"
_PARTS: dict[str, type] = {
    "forces": ForceComparison,
    "masses": MassComparison,
    "conditioning": ConditioningComparison,
    "gap": ForceComparison,
    "path": PathComparison,
    "torques": ForceComparison,
}
# What each field is, where it is not an array of numbers; by kind, numpy's kinds and how many dimensions.
_FIELDS = {
    **dict.fromkeys(("trial", "before_label", "after_label"), "a text"),
    **dict.fromkeys(("channels", "units", "names", "segments", "joints"), "texts"),
    **dict.fromkeys(("full_before", "full_after", "horizon_s"), "a number"),
    "changed": "flags",
}
_EXPECTED = {
    "a text": ("U", {0}),
    "texts": ("U", {1}),
    "a number": ("fiu", {0}),
    "flags": ("b", {1}),
    "numbers": ("fiu", {1, 2}),
}
# A condition number is a quotient of two numbers, each rounded.
_ROUNDING = 1e-9


def save_report_data(data: ReportData, path: Path) -> Path:
    """Write the arrays under the names ``PART/FIELD``; appears only when complete, and not at all without any."""
    arrays: dict[str, Any] = {}
    for part, kind in _PARTS.items():
        content = getattr(data, part)
        for field in fields(kind) if content is not None else ():
            value = getattr(content, field.name)
            if value is not None:
                arrays[f"{part}/{field.name}"] = np.asarray(value)
    path = Path(path)
    if not arrays:
        path.unlink(missing_ok=True)
        return path
    with atomic_path(path) as temporary:
        np.savez_compressed(temporary, **arrays)
    return path


def load_report_data(path: Path) -> ReportData:
    """Read what :func:`save_report_data` wrote.

    Raises:
        InputError: unreadable, empty, a field is missing, or the lengths of a part's arrays disagree.
    """
    known = {f"{part}/{field.name}" for part, kind in _PARTS.items() for field in fields(kind)}
    arrays = read_npz(path, known)
    if not arrays:
        raise InputError("holds no arrays", source=path, remedy="write it again, or remove it")
    parts = {part: _read_part(part, kind, arrays, path) for part, kind in _PARTS.items()}
    return ReportData(**parts)


def _read_part(part: str, kind: type, arrays: Mapping[str, NDArray], path: Path) -> Any:
    prefix = part + "/"
    found = {name[len(prefix) :]: value for name, value in arrays.items() if name.startswith(prefix)}
    if not found:
        return None
    values: dict[str, Any] = {}
    for field in fields(kind):
        if field.name in found:
            values[field.name] = _native_value(found[field.name], field.name, prefix, path)
        elif field.default is not None and not isinstance(field.default, str):
            raise _wrong_field("is missing", prefix + field.name, path)
    content = kind(**values)
    _check_lengths(part, content, path)
    return content


def _native_value(value: NDArray, name: str, prefix: str, path: Path) -> Any:
    """A field as it is used: texts as ``str`` or tuples of it, one number as float, flags and numbers as arrays."""
    kind = _FIELDS.get(name, "numbers")
    kinds, dimensions = _EXPECTED[kind]
    if value.dtype.kind not in kinds or value.ndim not in dimensions:
        raise _wrong_field(f"is {value.ndim}-dimensional {value.dtype}, not {kind}", prefix + name, path)
    if kind in {"a text", "texts"}:
        texts = tuple(str(item) for item in value.ravel())
        if any(not item.isprintable() for item in texts):
            raise _wrong_field("holds characters that cannot be shown", prefix + name, path)
        return texts[0] if kind == "a text" else texts
    if kind == "flags":
        return value
    with np.errstate(over="ignore"):  # What double precision cannot hold is infinite, and refused as such.
        numbers = value.astype(float, copy=False)
    _check_numbers(numbers, prefix + name, path)
    return float(numbers) if kind == "a number" else numbers


def _check_numbers(value: NDArray, field: str, path: Path) -> None:
    """Finite ones that figures can show; condition numbers are 1 or more, infinite where nothing excites a segment."""
    conditions = field.startswith("conditioning/")
    if np.isnan(value).any() or (np.isinf(value).any() and not conditions):
        raise _wrong_field("holds NaN or infinity", field, path)
    if conditions and (value < 1.0 - _ROUNDING).any():
        raise _wrong_field(f"is {value.min():g}, below 1", field, path)
    if (np.abs(value[np.isfinite(value)]) > LARGEST).any():
        raise _wrong_field(f"holds numbers above {LARGEST:g}", field, path)


def _check_lengths(part: str, content: Any, path: Path) -> None:
    timed = isinstance(content, ForceComparison | PathComparison)
    shapes: dict[str, tuple[int, ...]]
    if timed:
        names = "channels" if isinstance(content, ForceComparison) else "joints"
        size = len(getattr(content, names))
        shapes = {"units": (size,)} if names == "channels" else {}
        shapes["time"] = (len(content.time),)
        shapes |= dict.fromkeys(("measured", "nominal", "identified"), (len(content.time), size))
    elif isinstance(content, MassComparison):
        names, size = "names", len(content.names)
        shapes = dict.fromkeys(
            ("nominal", "identified", "true", "changed", "half_width", "determined"), (size,)
        )
    else:
        names, size = "segments", len(content.segments)
        shapes = dict.fromkeys(("before", "after"), (size,))
    if not 0 < size <= MOST_CHANNELS or (timed and not len(content.time)):
        raise _wrong_field(f"has {size} names, not 1 to {MOST_CHANNELS}", f"{part}/{names}", path)
    for name, shape in shapes.items():
        value = getattr(content, name)
        if value is not None and np.shape(value) != shape:
            raise _wrong_field(f"has shape {np.shape(value)}, not {shape}", f"{part}/{name}", path)


def _wrong_field(what: str, field: str, path: Path) -> InputError:
    return InputError(what, source=path, field=field, remedy="write it again")
