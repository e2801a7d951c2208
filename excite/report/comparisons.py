"""What a report compares: measured with modelled, before with after."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.atomic import atomic_path
from excite.documents.document import LARGEST, MOST_CHANNELS
from excite.errors import ExciteError, InputError
from excite.formats.arrays import read_npz
from excite.logs.files import load_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot, robot_for_log
from excite.robot.robot import Robot

if TYPE_CHECKING:
    from excite.diagnosis.answer.answer import Diagnosis
    from excite.doctor.model_comparison import BesideModel

Names = tuple[str, ...]

NORMAL_95 = 1.96
"""Deviations of a normal distribution within which 95 of 100 values lie."""


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

    Of a log that was looked through, ``measured`` is what the nominal model needs, ``nominal`` the torques as they
    stand in the log, and ``identified`` the same as they were repaired.
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
        half_width: half of each identified mass's 95 % interval, of the data and of what the nominal model is granted;
            None where it was not computed.
        determined: share of what the nominal model is granted that the data took away, 0 to 1; likewise.
    """

    names: Names
    nominal: Array
    identified: Array
    true: Array | None = None
    changed: NDArray[np.bool_] | None = None
    half_width: Array | None = None
    determined: Array | None = None


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
class PathComparison:
    """A trial as its joints moved, and as simulators move them; where nothing was simulated these are the record.

    Attributes:
        trial: its name.
        joints: of the columns.
        time: ``(n,)`` [s].
        measured: positions, ``(n, n_joints)`` [rad or m].
        nominal: of the nominal simulator, likewise.
        identified: of the simulator with the effects, likewise; of an identification, of the identified model.
        horizon_s: how long a model ran before it started anew from the record [s]; None where the document says it.
    """

    trial: str
    joints: Names
    time: Array
    measured: Array
    nominal: Array
    identified: Array
    horizon_s: float | None = None


# The arrays that a report shows and that no JSON file holds: ``report_data.npz``, of a log
# ``doctor_data.npz``.


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


def save_diagnosis_curves(result: Diagnosis, out: Path) -> None:
    """Write the curves that a page of a diagnosis shows, where there are any."""
    curves, rollouts = result.curves, result.simulation
    path = None if rollouts is None else rollouts.path
    gap = None
    if curves is not None:
        gap = ForceComparison(
            curves.trial,
            curves.channels,
            curves.units,
            curves.time,
            curves.measured,
            curves.before,
            curves.after,
        )
    moved = None
    if path is not None:
        moved = PathComparison(path.trial, path.joints, path.time, path.recorded, path.before, path.after)
    if gap is not None or moved is not None:
        save_report_data(ReportData(gap=gap, path=moved), out / "report_data.npz")


def save_doctor_torques(seen: BesideModel | None, out: Path) -> None:
    """Write the torques that a page of a log shows, those of the model beside them; None of a log without use."""
    shown = None
    if seen is not None:
        shown = ForceComparison(
            seen.trial, seen.joints, seen.units, seen.time, seen.model, seen.logged, seen.repaired
        )
    save_report_data(ReportData(torques=shown), out / DOCTOR_DATA)


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


# The log that a result was made from, where it still lies where the result says.


@dataclass(frozen=True, eq=False)
class Record:
    """A log and its robot.

    Attributes:
        robot: the nominal robot.
        log: the log.
    """

    robot: Robot
    log: Log

    def trial(self, name: str = "") -> Trial:
        """The trial of that name, else the first that judges, else the first."""
        named = [trial for trial in self.log.trials if trial.name == name]
        return (named or self.log.role("validation") or self.log.trials)[0]


def read_record(folder: Path, document: dict[str, Any]) -> Record | str | None:
    """The record that a document names: why it cannot be had, or None where it names none.

    Args:
        folder: of the document.
        document: its content, with ``log_file`` and ``robot_file``.
    """
    named = document.get("log_file")
    if not named:
        return None
    try:
        robot = document.get("robot_file")
        if robot:
            return Record(robot_for_log(folder / robot, folder / named), load_log(folder / named))
        log = load_log(folder / named)
        return Record(nominal_robot(log), log)
    except ExciteError as error:
        return str(error)
    except OSError as error:
        return f"{named[:60]}: cannot be read ({error.strerror})"
