"""What a command's result says of a robot: an identification's parameters, or the robot that a diagnosis left."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.units import unit_at
from excite.diagnosis.simulator.augmented_plant import describe_missing
from excite.documents.campaign import Campaign
from excite.documents.document import model_of, read_document
from excite.errors import InputError, UnknownNameError
from excite.export.models.model_format import JOINT_TERMS, Lost, Subject
from excite.export.models.parameters import model_parameters, with_servos
from excite.formats.documents import read_json
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.inertia import FILE_ORDER, central_inertia_matrices
from excite.identification.result import Identification
from excite.logs.robot import robot_for_log
from excite.results import Name, Stated, Unbounded, stated
from excite.robot.load import load_robot
from excite.robot.mjcf.conversion import is_mjcf
from excite.robot.robot import Robot
from excite.simulation.true_parameters import nominal_drives

_FILES = ("identification.json", "campaign.json", "diagnosis.json")
_AGAIN = "write it again with excite identify … --out DIR"


def subject_of(
    result: str | Path | Identification,
    folder: Path,
    *,
    robot: str | Robot | None = None,
    template: Path | None = None,
) -> Subject:
    """What is to be written of a result, in memory or on disk; arguments and errors as of :func:`read_subject`."""
    if isinstance(result, str | Path):
        name = str(robot.source) if isinstance(robot, Robot) else robot
        return read_subject(Path(result), folder, robot=name, template=template)
    found = model_parameters(result)
    if isinstance(robot, Robot):
        loaded = robot
    else:
        loaded = load_robot(robot or result.robot)
        if template is None and robot is not None and Path(robot).is_file() and is_mjcf(Path(robot)):
            template = Path(robot)
    check_links(loaded, found.links, "identification")
    return Subject(loaded, found, folder, template)


def read_subject(
    result: Path, folder: Path, *, robot: str | None = None, template: Path | None = None
) -> Subject:
    """What is to be written of a result.

    Args:
        result: a folder of ``excite identify``, ``campaign`` or ``diagnose --apply``, or the document in it.
        folder: where the files will stand.
        robot: the robot that it was made for, where the result does not say or it lies elsewhere now.
        template: its MuJoCo model, where the robot is not named by that.

    Raises:
        InputError: there is no such result, a number in it is missing, or it is another robot's.
        RobotError: the robot cannot be loaded.
    """
    file = _result_document(result)
    schema = read_json(file, remedy=_AGAIN).get("schema")
    if schema == Diagnosis.SCHEMA:
        return diagnosed_subject(file, folder, robot)
    if schema == Campaign.SCHEMA:
        campaign: Any = read_document(file, model_of(Campaign), remedy=_AGAIN)
        document = campaign.identification
    else:
        document = read_document(file, model_of(Identification), remedy=_AGAIN)
    if template is not None and not template.is_file():
        raise InputError(
            "is no file", source=template, field="--template", remedy="give the MuJoCo model of the robot"
        )
    if document is None:
        raise InputError("holds no identification", source=file, field="identification", remedy=_AGAIN)
    if any(
        f.kind == "torque_scale" and not f.repaired and {*document.fit} <= {*f.places}
        for f in document.findings
    ):
        raise InputError(
            "is of torques in an unknown unit, and so would be the model's weight",
            source=file,
            remedy="state the unit (map.yaml) and identify again",
        )
    name = robot or _named_robot(document, file)
    loaded = with_servos(_result_robot(name, document, file))
    if template is None and Path(name).is_file() and is_mjcf(Path(name)):
        template = Path(name)
    values: list[float] = []
    for link, block in document.standard_parameters.items():
        six = dict(zip(FILE_ORDER, block.inertia, strict=True))
        ten = [block.mass, *block.first_moment, *(six[place] for place in range(6))]
        values += [value for value in ten if value is not None]
        if None in ten:
            raise InputError(
                "a parameter is null",
                source=file,
                field=f"standard_parameters.{link}",
                remedy="identify with a method that gives all parameters, such as lmi",
            )
    drives = {name: value for name, value in document.drive_parameters.items() if value is not None}
    found = parameters_of(loaded, np.array(values), drives)
    return Subject(loaded, found, folder, template)


def check_links(robot: Robot, links: Iterable[str], source: object, field: str | None = None) -> None:
    """Refuse parameters of links that are not the robot's; raises InputError."""
    own, found = [segment.link for segment in robot.segments], list(links)
    if own != found:
        other = next((link for link in found if link not in own), None)
        raise InputError(
            f"is of another robot than {robot.name}" + (f": link {other!r} is not in it" if other else ""),
            source=source,
            field=field,
            remedy="give the robot that it was made for, --robot ROBOT",
        )


def _result_document(result: Path) -> Path:
    if not result.is_dir():
        return result
    found = next((result / name for name in _FILES if (result / name).is_file()), None)
    if found is None:
        raise InputError(
            f"holds none of {', '.join(_FILES)}", source=result, remedy="give the --out of excite identify"
        )
    return found


def _named_robot(document: Any, file: Path) -> str:
    if document.robot_file is None:
        return str(document.robot)
    there = file.parent / document.robot_file
    if not there.exists():
        raise InputError(
            f"names {document.robot_file!r}, which is not there",
            source=file,
            field="robot_file",
            remedy="say where the robot lies, --robot ROBOT",
        )
    return str(there)


def _result_robot(name: str, document: Any, file: Path) -> Robot:
    """The robot, with the joints free that the log of the identification has."""
    log = None if document.log_file is None else file.parent / document.log_file
    try:
        loaded = robot_for_log(name, log) if log is not None and log.exists() else load_robot(name)
    except UnknownNameError as error:
        raise InputError(
            f"is of {name!r}, no robot that is known here",
            source=file,
            field="robot",
            remedy="say where it lies, --robot ROBOT",
        ) from error
    check_links(loaded, document.standard_parameters, file, "standard_parameters")
    return loaded


# The robot that a diagnosis wrote with its effects in it, as a subject for simulators.


def parameters_of(robot: Robot, inertial: Array, drives: dict[str, float]) -> IdentifiedParameters:
    """Parameters that were found for a robot, beside its own.

    Args:
        inertial: ``(10·n_segments,)``, pinocchio's order, joint frames [SI].
        drives: parameters of the drives by name [SI].
    """
    return IdentifiedParameters(
        links=tuple(segment.link for segment in robot.segments),
        segments=tuple(segment.name for segment in robot.segments),
        unmeasured=(),
        inertial=inertial,
        nominal=robot.nominal_parameters.copy(),
        drive_names=tuple(drives),
        drives=np.array(list(drives.values())),
    )


def diagnosed_subject(file: Path, folder: Path, nominal: str | None) -> Subject:
    """The robot that ``excite diagnose --apply`` wrote.

    Args:
        file: ``diagnosis.json``.
        folder: where the files will stand.
        nominal: the robot before, to compare with; None compares bodies with themselves.

    Raises:
        InputError: no robot was written, it is not there, or ``nominal`` is another one.
    """
    document = read_document(file, Diagnosis, remedy="write it again with excite diagnose … --out DIR")
    if document.applied is None:
        raise InputError(
            "has written no robot with its effects",
            source=file,
            field="applied",
            remedy="diagnose again with --apply DIR --out DIR",
        )
    # From the document's folder, or from the working folder where it had none.
    places = [base / document.applied.robot for base in (file.parent, Path())]
    there = next((place for place in places if place.is_file()), None)
    if there is None:
        raise InputError(
            f"names {document.applied.robot!r}, which is not there",
            source=file,
            field="applied.robot",
            remedy="diagnose again with --apply DIR --out DIR",
        )
    robot = load_robot(there)
    declared = nominal_drives(robot)
    drives = {
        f"{term}.{joint}": float(value)
        for term in JOINT_TERMS
        for joint, value in zip(robot.joint_names, getattr(declared, term), strict=True)
        if value
    }
    identified = parameters_of(robot, robot.nominal_parameters.copy(), drives)
    if nominal is not None:
        before = load_robot(nominal)
        check_links(before, identified.links, nominal, "--robot")
        identified.nominal[:] = before.nominal_parameters
    late, said = _stated_delay(document)
    beyond = tuple(
        Lost("effect", robot.name, None, text) for text in document.applied.left_out if text != said
    )
    return Subject(robot, identified, folder, None, beyond, late)


def _stated_delay(document: Diagnosis) -> tuple[float | None, str]:
    """How late the motors follow what they are told [s], and how a description says that it lacks that."""
    for found in document.effects:
        effect = EFFECTS.get(found.effect)
        value = found.parameters.get(effect.late_by) if effect is not None else None
        if value is not None and value.value is not None:
            return value.value, describe_missing(found.effect, str(found.location))
    return None, ""


# What changes in a robot's model, parameter by parameter, as a person reads it.

_BODY = (
    ("mass", "kg"),
    *((f"com_{axis}", "m") for axis in "xyz"),
    *((f"I{axes}", "kg·m²") for axes in ("xx", "yy", "zz", "xy", "xz", "yz")),
)
_UPPER = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])
COLUMNS = ("place", "parameter", "unit", "before", "after", "change")


@dataclass(frozen=True)
class Change(Stated):
    """A parameter before and after [SI].

    Attributes:
        place: link or joint.
        parameter: ``mass``, ``com_x`` … (of the link, in its joint's frame), ``Ixx`` … about the centre of mass, or a
            joint's ``viscous``, ``coulomb``, ``armature``.
        unit: its unit.
        before: of the nominal model [unit].
        after: as it was found [unit]; equal to ``before`` where it was not.
    """

    place: Name
    parameter: Name
    unit: Name
    before: Unbounded
    after: Unbounded

    @property
    @stated
    def change(self) -> Unbounded:
        """After minus before [unit]."""
        return self.after - self.before

    @property
    @stated
    def percent(self) -> float | None:
        """The change in per cent of what was before; null where that was zero."""
        return 100.0 * self.change / abs(self.before) if self.before else None


def list_changes(subject: Subject) -> tuple[Change, ...]:
    """All parameters of bodies and joints, before and after."""
    before = _body_values(subject.found.nominal)
    after = _body_values(subject.parameters)
    rows = [
        Change(segment.link, name, unit, float(before[k, j]), float(after[k, j]))
        for k, segment in enumerate(subject.robot.segments)
        for j, (name, unit) in enumerate(_BODY)
    ]
    for term, unit in JOINT_TERMS.items():
        declared, found = getattr(subject.declared, term), subject.term(term)
        rows += [
            Change(joint, term, unit_at(subject.robot, joint, unit), float(old), float(new))
            for joint, old, new in zip(subject.robot.joint_names, declared, found, strict=True)
            if np.isfinite(new)
        ]
    return tuple(rows)


def _body_values(parameters: Array) -> Array:
    """Mass, centre of mass and central inertia of each segment, ``(n, 10)``; zeros without mass."""
    ten = parameters.reshape(-1, 10)
    rows = np.zeros((len(ten), 10))
    rows[:, 0] = ten[:, 0]
    heavy = ten[:, 0] > 0.0
    rows[heavy, 1:4] = ten[heavy, 1:4] / ten[heavy, :1]
    rows[heavy, 4:] = central_inertia_matrices(parameters)[heavy][:, _UPPER[0], _UPPER[1]]
    return rows
