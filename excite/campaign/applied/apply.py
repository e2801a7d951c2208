"""The robot with the effects that a diagnosis found: its description and its URDF, for the next round."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from excite.atomic import write_text
from excite.campaign.applied.bodies import with_bodies
from excite.diagnosis.answer.candidate import in_words
from excite.diagnosis.answer.result import Diagnosis
from excite.diagnosis.answer.robot_changes import RobotChanges
from excite.diagnosis.equations.units import unit_at
from excite.errors import InputError, RobotError
from excite.logs.bare_urdf import is_bare
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.scaffold.description import draft_description
from excite.robot.scaffold.said import Said

ROBOT, MODEL = "robot.yaml", "robot.urdf"
_SOURCE = "excite diagnose --apply"
# Of joints that turn.
_UNITS = {"viscous": "N·m·s/rad", "coulomb": "N·m", "armature": "kg·m²"}


@dataclass(frozen=True)
class Applied:
    """A robot that was written with the effects of a diagnosis in it.

    Attributes:
        robot: its ``robot.yaml``.
        written: what was changed, a sentence each.
        left_out: what the files have no place for, a sentence each.
    """

    robot: Path
    written: tuple[str, ...]
    left_out: tuple[str, ...]

    def to_json(self, beside: Path) -> dict[str, Any]:
        """As it stands in the document of a diagnosis, the path from the folder ``beside``."""
        robot = Path(os.path.relpath(self.robot, beside)).as_posix()
        return {"robot": robot, "written": list(self.written), "left_out": list(self.left_out)}

    def summary(self) -> str:
        """A line each."""
        lines = [f"robot with the effects: {self.robot}"]
        lines += [f"  {text}" for text in self.written or ("nothing was found that it did not have",)]
        lines += [f"  not in it: {text}" for text in self.left_out]
        if self.left_out:
            lines.append("  a diagnosis with this robot finds again what is not in it")
        return "\n".join(lines)


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
    model = with_bodies(robot.urdf, changes.bodies)
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
        *map(_raise_link_origin, model.raised),
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


def _raise_link_origin(link: str) -> str:
    return f"{link}: no body has the moments of inertia found; it got the nearest that one can have"


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
