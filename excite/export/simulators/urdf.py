"""URDF: its author's text with identified inertials and friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np

from excite.arrays import Array
from excite.export.models.urdf import edited_urdf
from excite.export.models.verification import States, pinocchio_torques
from excite.export.simulators.model_format import (
    LoadedModel,
    ModelFormat,
    Rendered,
    Subject,
    move_attribute,
    with_friction,
)
from excite.formats.documents import elements_of
from excite.robot.loading import model_file
from excite.robot.robot import Robot

_NO_SERVO = "URDF describes no servo; set it in the controller"
_ATTRIBUTES = {"viscous": "damping", "coulomb": "friction"}


class UrdfFormat(ModelFormat):
    """The URDF that the robot came as: comments, order, shapes and limits stay, inertials and ``<dynamics>`` change.

    A robot that came as MJCF has the URDF that was made of it.
    """

    name = "urdf"
    summary = "URDF, the author's text kept (ROS, pinocchio, Drake, PyBullet)"
    terms = ("viscous", "coulomb")
    lacks: ClassVar[Mapping[str, str]] = {
        "armature": "URDF has no rotor inertia; add it where the simulator sets it",
        "kp": _NO_SERVO,
        "kd": _NO_SERVO,
        "delay": _NO_SERVO,
    }

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`."""
        edit = edited_urdf(subject.robot, subject.found, drives=True, force=False)
        folder = model_file(subject.robot).parent
        for mesh in edit.text.root.everywhere("mesh"):
            move_attribute(edit.text, mesh, "filename", folder, subject.folder)
        return Rendered({f"{subject.stem}.urdf": edit.text.edited()}, edit.notes)

    def load(self, subject: Subject, rendered: Rendered) -> LoadedModel:
        """Read by pinocchio, ``<dynamics>`` by the XML's own words."""
        return LoadedUrdf(subject.robot, rendered.files[rendered.main])


class LoadedUrdf(LoadedModel):
    """A URDF in pinocchio, with the friction that its joints state.

    Args:
        robot: whose joints and order are asked for.
        text: the URDF.
        servos: terms of servos that are asked for, by the attribute of ``<limit>`` that holds each.
    """

    def __init__(self, robot: Robot, text: bytes, servos: Mapping[str, str] | None = None) -> None:
        self._robot, self._text = robot, text
        joints = {joint.get("name"): joint for joint in elements_of(text).findall("joint")}
        own = [joints[name] for name in robot.joint_names]
        super().__init__(
            {term: _joint_attributes(own, "dynamics", name, 0.0) for term, name in _ATTRIBUTES.items()},
            {term: _joint_attributes(own, "limit", name, np.nan) for term, name in (servos or {}).items()},
        )

    def torques(self, states: States) -> Array:
        """See :class:`LoadedModel`."""
        bodies = pinocchio_torques(self._robot, self._text, states)
        return with_friction(self._robot, bodies, states, self.drives)


def _joint_attributes(joints: list[ElementTree.Element], tag: str, name: str, default: float) -> Array:
    """An attribute of an element of each joint, ``(n_joints,)``."""
    found = (joint.find(tag) for joint in joints)
    return np.array([default if one is None else float(one.get(name, default)) for one in found])
