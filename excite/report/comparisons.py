"""What a report compares: measured with modelled, before with after."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin, get_type_hints

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

# What a file of arrays holds of a field: a kind, and a letter an axis; those of one letter are equally long.
Text = Annotated[str, ("text", "")]
Names = Annotated[tuple[str, ...], ("texts", "c")]
PerName = Annotated[Array, ("numbers", "c")]
Times = Annotated[Array, ("numbers", "n")]
Curves = Annotated[Array, ("numbers", "nc")]
Scalar = Annotated[float, ("numbers", "")]
Flags = Annotated[NDArray[np.bool_], ("flags", "c")]

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
    """

    trial: Text
    channels: Names
    units: Names
    time: Times
    measured: Curves
    nominal: Curves
    identified: Curves


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
    nominal: PerName
    identified: PerName
    true: PerName | None = None
    changed: Flags | None = None
    half_width: PerName | None = None
    determined: PerName | None = None


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
    before: PerName
    after: PerName
    full_before: Scalar
    full_after: Scalar
    before_label: Text = "before"
    after_label: Text = "chosen motions"


@dataclass(frozen=True, eq=False)
class PathComparison:
    """A trial as its joints moved, and as simulators move them; where nothing was simulated these are the record.

    Attributes:
        trial: its name.
        joints: of the columns.
        time: ``(n,)`` [s].
        measured: positions, ``(n, n_joints)`` [rad or m].
        nominal: of the nominal simulator, likewise.
        identified: of the simulator with the effects, likewise.
    """

    trial: Text
    joints: Names
    time: Times
    measured: Curves
    nominal: Curves
    identified: Curves


# The arrays that a report shows and that no JSON file holds: ``report_data.npz``.


@dataclass(frozen=True, eq=False)
class ReportData:
    """Everything that is in such files; what there is nothing to say about is None. ``gap`` is a diagnosis's."""

    forces: ForceComparison | None = None
    masses: MassComparison | None = None
    conditioning: ConditioningComparison | None = None
    gap: ForceComparison | None = None
    path: PathComparison | None = None


_PARTS: dict[str, type] = {name: get_args(hint)[0] for name, hint in get_type_hints(ReportData).items()}
# numpy's kinds of what is stored.
_KINDS = {"text": "U", "texts": "U", "numbers": "fiu", "flags": "b"}
# A condition number is a quotient of two numbers, each rounded.
_ROUNDING = 1e-9


def save_report_data(data: ReportData, path: Path) -> Path:
    """Write the arrays under the names ``PART/FIELD``; appears only when complete, and not at all without any."""
    parts = {name: vars(part) for name in _PARTS if (part := getattr(data, name)) is not None}
    arrays = {
        f"{name}/{one}": np.asarray(value)
        for name, part in parts.items()
        for one, value in part.items()
        if value is not None
    }
    path = Path(path)
    if not arrays:
        path.unlink(missing_ok=True)
        return path
    with atomic_path(path) as temporary:
        np.savez_compressed(temporary, **arrays)  # type: ignore[arg-type]
    return path


def save_diagnosis_curves(result: Diagnosis, out: Path) -> None:
    """Write the curves that a page of a diagnosis shows, where there are any."""
    curves, path = result.curves, None if result.simulation is None else result.simulation.path
    gap = moved = None
    if curves is not None:
        models = (curves.measured, curves.before, curves.after)
        gap = ForceComparison(curves.trial, curves.channels, curves.units, curves.time, *models)
    if path is not None:
        moved = PathComparison(path.trial, path.joints, path.time, path.recorded, path.before, path.after)
    if gap is not None or moved is not None:
        save_report_data(ReportData(gap=gap, path=moved), out / "report_data.npz")


def load_report_data(path: Path) -> ReportData:
    """Read what :func:`save_report_data` wrote.

    Raises:
        InputError: unreadable, empty, a field is missing, or the lengths of a part's arrays disagree.
    """
    arrays = read_npz(path, {f"{part}/{one.name}" for part, kind in _PARTS.items() for one in fields(kind)})
    if not arrays:
        raise InputError("holds no arrays", source=path, remedy="write it again, or remove it")
    return ReportData(**{part: _read_part(part, kind, arrays, path) for part, kind in _PARTS.items()})


def _read_part(part: str, kind: type, arrays: Mapping[str, NDArray], path: Path) -> Any:
    if not any(name.startswith(f"{part}/") for name in arrays):
        return None
    sizes: dict[str, int] = {}
    values, hints = {}, get_type_hints(kind, include_extras=True)
    for one in fields(kind):
        name, hint = f"{part}/{one.name}", hints[one.name]
        fault = "is missing" if one.default is MISSING else ""
        if name in arrays:
            # Of a field that may be None the other part of its type.
            what, axes = (hint if get_origin(hint) is Annotated else get_args(hint)[0]).__metadata__[0]
            fault = _array_fault(what, axes, arrays[name], sizes)
            if not fault:
                values[one.name] = value = _as_used(what, axes, arrays[name])
                fault = _number_fault(value, part == "conditioning") if what == "numbers" else ""
            if not fault and "text" in what and not all(map(str.isprintable, np.ravel(arrays[name]))):
                fault = "holds characters that cannot be shown"
        if fault:
            raise InputError(fault, source=path, field=name, remedy="write it again")
    return kind(**values)


def _as_used(kind: str, axes: str, value: NDArray) -> Any:
    with np.errstate(over="ignore"):  # What double precision cannot hold is infinite, and refused as such.
        found = value.astype(float, copy=False) if kind == "numbers" else value
    if axes:
        return tuple(map(str, found)) if kind == "texts" else found
    return found.item()


def _array_fault(kind: str, axes: str, value: NDArray, sizes: dict[str, int]) -> str:
    """What is wrong with an array's kind and shape; lengths of axes by their letters stand in ``sizes``."""
    if value.dtype.kind not in _KINDS[kind] or value.ndim != len(axes):
        wanted = f"{kind} of {len(axes)} dimensions" if axes else f"a {kind}"
        return f"is {value.ndim}-dimensional {value.dtype}, not {wanted}"
    expected = tuple(sizes.setdefault(axis, n) for axis, n in zip(axes, value.shape, strict=True))
    if value.shape != expected:
        return f"has shape {value.shape}, not {expected}"
    if not 0 < sizes.get("c", 1) <= MOST_CHANNELS or not sizes.get("n", 1):
        rows = f" and {sizes['n']} rows, not one or more" if "n" in sizes else ""
        return f"has {sizes.get('c', 1)} names, not 1 to {MOST_CHANNELS}{rows}"
    return ""


def _number_fault(value: Any, is_condition: bool) -> str:
    """Finite ones that figures can show; condition numbers are 1 or more, infinite where nothing excites a segment."""
    value = np.asarray(value)
    if np.isnan(value).any() or (np.isinf(value).any() and not is_condition):
        return "holds NaN or infinity"
    if is_condition and (value < 1.0 - _ROUNDING).any():
        return f"is {value.min():g}, below 1"
    if (np.abs(value[np.isfinite(value)]) > LARGEST).any():
        return f"holds numbers above {LARGEST:g}"
    return ""


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
