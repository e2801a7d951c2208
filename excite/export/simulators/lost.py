"""What a format has no place for: said beside the files, not left for the simulation to show."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from excite.export.simulators.model_format import ModelFormat
from excite.export.simulators.subject import JOINT_TERMS, SERVO_TERMS, Lost, Subject

# Terms of drives that no robot model of any simulator here has, and what to do without them.
_NOWHERE = {
    "offset": "no joint has a constant torque, nor Coulomb friction that differs by direction: add it to the command",
    "root": "friction that grows with the square root of speed is in no joint: coulomb and viscous alone are there",
    "joint_viscous": "friction behind a gear that two motors share belongs to no single joint of the model",
    "joint_coulomb": "friction behind a gear that two motors share belongs to no single joint of the model",
    "joint_armature": "inertia behind a gear that two motors share belongs to no single joint of the model",
    "encoder": "an encoder's zero is no part of the robot: correct the readings",
    "bending": "cross-talk of a torque sensor is no part of the robot: correct the readings",
    "gain": "a torque constant that is off is no part of the robot: scale the torques",
    "load_friction": "friction of joints does not grow with the load there: it is too small where the load is large",
}
_BELOW_ZERO = "was found below zero, which no joint can be: what the model had before stands there"


def lost_in(model_format: ModelFormat, subject: Subject) -> tuple[Lost, ...]:
    """All that was found of a robot and that its files in a format do not hold."""
    found = [
        item for name, value in subject.drives.items() for item in _lost_terms(model_format, name, value)
    ]
    return (*found, *_lost_servo_terms(model_format, subject), *subject.beyond, *model_format.lost(subject))


def _lost_servo_terms(model_format: ModelFormat, subject: Subject) -> list[Lost]:
    """Terms of servos that are known and not held, one entry for all joints."""
    held = model_format.servo(subject)
    return [
        Lost(term, "every joint", subject.delay_s if term == "delay" else None, model_format.lacks[term])
        for term in SERVO_TERMS
        if term not in held and term in model_format.lacks and np.isfinite(subject.servo(term)).any()
    ]


def _lost_terms(model_format: ModelFormat, name: str, value: float) -> list[Lost]:
    term, _, joint = name.partition(".")
    if value == 0.0:
        return []
    if term not in JOINT_TERMS:
        return [Lost(term, joint, value, _NOWHERE.get(term, "no robot model has it"))]
    if value < 0.0:
        return [Lost(term, joint, value, _BELOW_ZERO)]
    lacks: Mapping[str, str] = model_format.lacks
    return [] if term in model_format.terms else [Lost(term, joint, value, lacks[term])]
