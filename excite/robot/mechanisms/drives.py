"""What a description says of drives, for the joints of a mechanism that have none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.description import RobotDescription
from excite.robot.mechanisms.mechanism import Mechanism
from excite.robot.per_joint import PerJoint


def without_motors(
    description: RobotDescription, names: tuple[str, ...], mechanism: Mechanism, model: pin.Model
) -> RobotDescription:
    """The description with joints that no motor drives made so: no gains, no friction or rotor of a drive.

    Limits of speed, acceleration and torque that nobody states for them are the largest of the driven joints', a
    scale for tolerances: what moves and loads them is limited where the motors are.
    """
    first = model.nv - len(names)
    passive = [names[column - first] for column in mechanism.passive]
    driven = [name for name in names if name not in passive]
    controller, drives, limits = description.controller, description.drives, description.limits
    stated = {"velocity": model.velocityLimit[first:], "torque": model.effortLimit[first:]}
    found: dict[str, Any] = {}
    for field in ("velocity", "acceleration", "jerk", "torque"):
        own = dict(zip(names, stated.get(field, np.zeros(len(names))), strict=True))
        found[field] = _scale_driven(getattr(limits, field), driven, passive, own)
    return description.model_copy(
        update={
            "controller": controller.model_copy(
                update={name: _zero_passive(getattr(controller, name), passive) for name in ("kp", "kd")}
            ),
            "drives": drives.model_copy(
                update={
                    name: _zero_passive(block, passive)
                    for name in ("viscous", "coulomb", "armature")
                    if (block := getattr(drives, name)) is not None
                }
            ),
            "limits": limits.model_copy(update=found),
        }
    )


def _zero_passive(block: PerJoint, passive: list[str]) -> PerJoint:
    return block.model_copy(update={"joints": {**block.joints, **dict.fromkeys(passive, 0.0)}})


def _scale_driven(
    block: PerJoint | None, driven: list[str], passive: list[str], own: dict[str, Array]
) -> PerJoint | None:
    """A block with numbers for passive joints that neither it nor the URDF has any for."""
    values = {} if block is None else block.joints
    default = None if block is None else block.default

    def of(name: str) -> float:
        return float(values.get(name, own[name] if default is None else default))

    largest = max((of(name) for name in driven), default=0.0)
    added = {name: largest for name in passive if name not in values and not (default or own[name] > 0.0)}
    if not added or not largest > 0.0:
        return block
    if block is None:
        return PerJoint(joints=added, source="the driven joints'")
    return block.model_copy(update={"joints": {**values, **added}})
