"""The robot that a diagnosis wrote with its effects in it, as a subject for simulators."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.simulator.robot_changes import in_no_description
from excite.documents.diagnosis import Diagnosis
from excite.documents.document import read_document
from excite.errors import InputError
from excite.export.models.parameters import ModelParameters
from excite.export.simulators.subject import JOINT_TERMS, Lost, Subject
from excite.identification.identified_parameters import IdentifiedParameters
from excite.robot.bringing import load_robot
from excite.robot.robot import Robot
from excite.simulation.drives import nominal_drives


def parameters_of(robot: Robot, inertial: Array, drives: dict[str, float]) -> IdentifiedParameters:
    """Parameters that were found for a robot, beside its own.

    Args:
        robot: the robot.
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
        identified.nominal[:] = _robot_before(nominal, robot, file).nominal_parameters
    late, said = _stated_delay(document)
    beyond = tuple(
        Lost("effect", robot.name, None, text) for text in document.applied.left_out if text != said
    )
    return Subject(robot, ModelParameters(robot.name, identified), folder, None, beyond, late)


def _stated_delay(document: Diagnosis) -> tuple[float | None, str]:
    """How late the motors follow what they are told [s], and how a description says that it lacks that."""
    for found in document.effects:
        effect = EFFECTS.get(found.effect)
        value = found.parameters.get(effect.late_by) if effect is not None else None
        if value is not None and value.value is not None:
            return value.value, in_no_description(found.effect, str(found.location))
    return None, ""


def _robot_before(nominal: str, robot: Robot, file: Path) -> Robot:
    before = load_robot(nominal)
    if [segment.link for segment in before.segments] != [segment.link for segment in robot.segments]:
        raise InputError(
            f"is another robot than that of {file}",
            source=nominal,
            field="--robot",
            remedy="give the nominal one, or leave it out",
        )
    return before
