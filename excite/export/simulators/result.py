"""What a command's result says of a robot: an identification's parameters, or the robot that a diagnosis left."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.documents.campaign import Campaign
from excite.documents.diagnosis import Diagnosis
from excite.documents.document import read_document, schema_of
from excite.documents.identification import Identification
from excite.errors import InputError, UnknownNameError
from excite.export.models.parameters import Found, ModelParameters
from excite.export.models.servos import with_servos
from excite.export.simulators.diagnosed import diagnosed_subject, parameters_of
from excite.export.simulators.subject import Lost, Subject
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.inertia import FILE_ORDER
from excite.logs.robot import robot_for_log
from excite.reading.json_document import read_json
from excite.robot.bringing import load_robot
from excite.robot.mjcf.conversion import is_mjcf
from excite.robot.robot import Robot

_FILES = ("identification.json", "campaign.json", "diagnosis.json")
_AGAIN = "write it again with excite identify … --out DIR"


def subject_of(
    result: str | Path | Found,
    folder: Path,
    *,
    robot: str | Robot | None = None,
    template: Path | None = None,
) -> Subject:
    """What is to be written of a result, in memory or on disk; arguments and errors as of :func:`read_subject`."""
    if isinstance(result, str | Path):
        name = str(robot.source) if isinstance(robot, Robot) else robot
        return read_subject(Path(result), folder, robot=name, template=template)
    if isinstance(robot, Robot):
        loaded = robot
    else:
        loaded = load_robot(robot or result.robot)
        if template is None and robot is not None and Path(robot).is_file() and is_mjcf(Path(robot)):
            template = Path(robot)
    if result.links != tuple(segment.link for segment in loaded.segments):
        raise InputError(
            f"is of another robot than {loaded.name}",
            source="identification",
            remedy="give the robot that it was made for, robot=",
        )
    return Subject(loaded, ModelParameters(loaded.name, result.identified), folder, template)


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
    if schema == schema_of(Diagnosis):
        return diagnosed_subject(file, folder, robot)
    if schema == schema_of(Campaign):
        document = read_document(file, Campaign, remedy=_AGAIN).identification
    else:
        document = read_document(file, Identification, remedy=_AGAIN)
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
    beyond: tuple[Lost, ...] = ()
    if document.torque_delay is not None:
        why = "how late torques were logged is no part of the robot: correct the log"
        beyond = (Lost("torque_delay", loaded.name, document.torque_delay.value_s, why),)
    found = ModelParameters(document.robot, _identified_parameters_of(document, loaded, file))
    return Subject(loaded, found, folder, template, beyond)


def _result_document(result: Path) -> Path:
    if not result.is_dir():
        return result
    found = next((result / name for name in _FILES if (result / name).is_file()), None)
    if found is None:
        raise InputError(
            f"holds none of {', '.join(_FILES)}", source=result, remedy="give the --out of excite identify"
        )
    return found


def _named_robot(document: Identification, file: Path) -> str:
    if document.robot_file is None:
        return document.robot
    there = file.parent / document.robot_file
    if not there.exists():
        raise InputError(
            f"names {document.robot_file!r}, which is not there",
            source=file,
            field="robot_file",
            remedy="say where the robot lies, --robot ROBOT",
        )
    return str(there)


def _result_robot(name: str, document: Identification, file: Path) -> Robot:
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
    links = [segment.link for segment in loaded.segments]
    if links != list(document.standard_parameters):
        other = next((link for link in document.standard_parameters if link not in links), None)
        raise InputError(
            f"is of another robot than {loaded.name}" + (f": link {other!r} is not in it" if other else ""),
            source=file,
            field="standard_parameters",
            remedy="give the robot that it was made for, --robot ROBOT",
        )
    return loaded


def _identified_parameters_of(document: Identification, robot: Robot, file: Path) -> IdentifiedParameters:
    values: list[Array] = []
    for link, block in document.standard_parameters.items():
        ten = [block.mass, *block.first_moment, *_pinocchio_order(list(block.inertia))]
        if any(value is None for value in ten):
            raise InputError(
                "a parameter is null",
                source=file,
                field=f"standard_parameters.{link}",
                remedy="identify with a method that gives all parameters, such as lmi",
            )
        values.append(np.array(ten, dtype=float))
    drives = {name: value for name, value in document.drive_parameters.items() if value is not None}
    return parameters_of(robot, np.concatenate(values), drives)


def _pinocchio_order(six: list[Any]) -> list[Any]:
    ordered = [None] * 6
    for place, value in zip(FILE_ORDER, six, strict=True):
        ordered[place] = value
    return ordered
