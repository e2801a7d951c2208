"""Units of joints that slide instead of turning."""

from __future__ import annotations

from dataclasses import replace

from excite.diagnosis.answer.candidate import Estimate
from excite.robot import prismatic as sliding
from excite.robot.robot import Robot

_OF_SLIDES = {
    "N·m": "N",
    "N·m/(N·m)": "N/N",
    "N·m/rad": "N/m",
    "N·m/rad²": "N/m²",
    "N·m/rad³": "N/m³",
    "N·m·s/rad": "N·s/m",
    "N·m·s": "N·s",
    "kg·m²": "kg",
    "rad": "m",
    "rad/s": "m/s",
}


def is_sliding_joint(robot: Robot, joint: str | None) -> bool:
    """Whether a place is a joint that slides."""
    if joint is None or not robot.model.existJointName(joint):
        return False
    return sliding.is_prismatic(robot.model, robot.model.idx_vs[robot.model.getJointId(joint)])


def unit_at(robot: Robot, joint: str | None, unit: str) -> str:
    """Unit at a joint of what has ``unit`` at joints that turn."""
    return _OF_SLIDES.get(unit, unit) if is_sliding_joint(robot, joint) else unit


def force_unit(robot: Robot, joint: str) -> str:
    """Unit of a joint's torque or force."""
    return unit_at(robot, joint, "N·m")


def at_joint(robot: Robot, joint: str | None, parameters: dict[str, Estimate]) -> dict[str, Estimate]:
    """Parameters with the units that they have at a joint."""
    return {name: replace(item, unit=unit_at(robot, joint, item.unit)) for name, item in parameters.items()}
