"""A robot with the effects that a diagnosis found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import yaml

from excite.arrays import Array
from excite.atomic import write_text
from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.answer.candidate import Applied, RobotChanges, in_words
from excite.diagnosis.equations.units import unit_at
from excite.errors import InputError, RobotError
from excite.identification.inertia import ROUNDING
from excite.logs.robot import is_bare
from excite.robot.init_robot.description import draft_description
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.urdf.converted import Said
from excite.robot.urdf.inertia import read_inertial
from excite.robot.urdf.writing import add_inertial

# A URDF whose links have bodies more than its author knew of.


@dataclass(frozen=True)
class Loaded:
    """A URDF with bodies more.

    Attributes:
        urdf: its text.
        raised: links whose moments of inertia, as found, no body has; they got the nearest that one can have.
    """

    urdf: str
    raised: tuple[str, ...]


def with_bodies(urdf: str, bodies: Mapping[str, Array], source: Path) -> Loaded:
    """A URDF whose links have bodies more, ``(10,)`` about the link's frame each.

    Mass and its centre, which gravity tells far better than any moment of inertia, are as found; ``source`` is the
    file that errors name.
    """
    raised: list[str] = []
    root = ElementTree.fromstring(urdf)
    for link in root.findall("link"):
        body = bodies.get(str(link.get("name")))
        if body is None:
            continue
        own = read_inertial(link, source)
        if own is not None:
            body = body + own.ten_parameters
        for inertial in link.findall("inertial"):
            link.remove(inertial)
        found = pin.Inertia.FromDynamicParameters(body)
        there = _nearest_existing_body(found)
        raised += [] if there is found else [str(link.get("name"))]
        moments = np.asarray(there.inertia)[np.triu_indices(3)]
        add_inertial(link, pin.SE3(np.eye(3), there.lever), there.mass, moments)
    return Loaded(ElementTree.tostring(root, encoding="unicode"), tuple(raised))


def _nearest_existing_body(body: pin.Inertia) -> pin.Inertia:
    """The body itself, or that of the nearest second moments ``½ tr(I) 1 − I`` about its centre that mass can have.

    None of these is negative (Wensing, Kim and Slotine 2018, section III); of matrices without a negative eigenvalue
    the nearest one, in the sum of squares, has those of this one raised to zero (Higham 1988).
    """
    inertia = np.asarray(body.inertia)
    values, vectors = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
    if values[0] >= -ROUNDING * np.abs(values).max():
        return body
    second = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return pin.Inertia(body.mass, body.lever, np.trace(second) * np.eye(3) - second)


# The robot with the effects that a diagnosis found: its description and its URDF, for the next round.

ROBOT, MODEL = "robot.yaml", "robot.urdf"
_SOURCE = "excite diagnose --apply"
# Of joints that turn.
_UNITS = {"viscous": "N·m·s/rad", "coulomb": "N·m", "armature": "kg·m²"}


def apply_effects(diagnosis: Diagnosis, robot: Robot, folder: Path) -> Applied:
    """Write ``robot.yaml`` and ``robot.urdf`` of a robot with the accepted effects in it.

    Bodies go into the links' inertials, friction and rotor inertia into ``drives``, marked as found, so that a
    diagnosis of a log with this robot works on what is left.

    Args:
        diagnosis: of a log of a fixed-base arm.
        robot: the nominal robot that it was made with.
        folder: folder to write to.

    Raises:
        InputError: the diagnosis is not of an arm; :func:`check_applicable` says so before it is made.
        RobotError: what was found makes no robot, such as a payload that its drives cannot hold.
    """
    if len(diagnosis.changes) <= len(diagnosis.effects):
        raise InputError(
            "has no effects that could be written into a robot",
            field="apply",
            remedy="diagnose a log of a fixed base",
        )
    changes = diagnosis.changes[len(diagnosis.effects)]
    folder.mkdir(parents=True, exist_ok=True)
    model = with_bodies(robot.urdf, changes.bodies, robot.source)
    write_text(folder / MODEL, model.urdf)
    content = _describe_robot(robot, changes, folder)
    path = write_text(folder / ROBOT, _render_description(content))
    try:
        load_robot(path)
    except RobotError as error:
        for file in (path, folder / MODEL):
            file.unlink()
        raise RobotError(
            f"with what was found it is no robot ({error.what})",
            source=robot.name,
            field=error.field,
            remedy="diagnose without --apply; augmented.xml has what a simulator can",
        ) from error
    said = (
        *_describe_changes(changes, robot),
        *(
            f"{link}: no body has the moments of inertia found; it got the nearest that one can have"
            for link in model.raised
        ),
        *_list_doubts(diagnosis),
    )
    return Applied(path, said, tuple(changes.beyond))


def check_applicable(robot: Robot) -> None:
    """Raise InputError where a diagnosis of a robot cannot be written into it: bases that move are diagnosed apart."""
    if robot.floating:
        raise InputError(
            f"{robot.name} has a free base, whose effects no robot.yaml takes up",
            field="--apply",
            remedy="diagnose it without --apply; augmented.xml has what a simulator can",
        )


def _render_description(content: Mapping[str, Any]) -> str:
    head = "# The robot with the effects that a diagnosis found; drives marked found are part of the model.\n"
    return head + str(yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=110))


def _describe_robot(robot: Robot, changes: RobotChanges, folder: Path) -> dict[str, Any]:
    """The content of the new ``robot.yaml``, beside its URDF."""
    content = robot.description.model_dump(mode="json", by_alias=True, exclude_unset=True)
    low, high = robot.limits.position_lower, robot.limits.position_upper
    rest = np.clip(robot.rest[robot.n_base_q :], low, high)
    content["posture"]["joints"] = {n: float(v) for n, v in zip(robot.joint_names, rest, strict=True) if v}
    if is_bare(robot):
        content |= _first_description(folder / MODEL, robot)
    content["model"] = {
        **content["model"],
        "path": MODEL,
        "source": f"{robot.description.model.source}, with {_SOURCE}",
    }
    content["model"].pop("package", None)
    # The URDF that is written has them fixed.
    content.pop("locked_joints", None)
    drives: dict[str, Any] = {}
    for term in ("viscous", "coulomb", "armature"):
        values = {name: value for name, value in getattr(changes, term).items() if value > 0.0}
        if values:
            drives[term] = {"joints": values, "source": _SOURCE}
    content["drives"] = {**drives, "found": True} if drives else {}
    return content


def _first_description(urdf: Path, robot: Robot) -> dict[str, Any]:
    """What a log does not say of a robot that is to move: limits, a servo that carries it, what may touch.

    As ``excite init-robot`` assumes it, which holds for all joints or is left.
    """
    try:
        made = draft_description(urdf, urdf.parent, np.random.default_rng(0), Said(floating=False))
    except RobotError:
        return {}
    if set(made["controller"]["kp"]["joints"]) != set(robot.joint_names):
        return {}
    return {name: made[name] for name in ("title", "posture", "limits", "controller", "collision", "assumed")}


def _list_doubts(diagnosis: Diagnosis) -> list[str]:
    """What was taken for what it may not be."""
    if not (diagnosis.ambiguous_with and diagnosis.effects):
        return []
    first = diagnosis.effects[0]
    taken = {(item.effect, item.location) for item in diagnosis.effects}
    others = [
        in_words(item.effect, item.location)
        for item in diagnosis.ambiguous_with
        if (item.effect, item.location) not in taken
    ]
    what = in_words(first.effect, first.location)
    return [f"{what} was taken, which this record cannot tell from {', '.join(others)}"] if others else []


def _describe_changes(changes: RobotChanges, robot: Robot) -> list[str]:
    """What was changed, in words; joints that slide have units of their own."""
    said = [f"{link}: {body[0]:+.3g} kg" for link, body in changes.bodies.items()]
    for term, turning in _UNITS.items():
        values = {name: value for name, value in getattr(changes, term).items() if value}
        units = {name: unit_at(robot, name, turning) for name in values}
        # Joints that turn before those that slide.
        for unit in sorted(set(units.values()), key=lambda unit: unit != turning):
            found = [f"{name} {value:.3g}" for name, value in values.items() if units[name] == unit]
            said.append(f"{term} [{unit}]: " + ", ".join(found))
    return said
