"""USD's text as a simulator reads it: a small reader of the grammar, and what the physics in it means."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.export.simulators.tree.read import LoadedTree, ReadBody, ReadJoint
from excite.robot.robot import Robot

_TOKEN = re.compile(r'#[^\n]*|"(?:[^"\\]|\\.)*"|<[^>]*>|[{}()\[\],=;]|[^\s{}()\[\],=;"<]+')
_JOINTS = {
    "PhysicsRevoluteJoint": "revolute",
    "PhysicsPrismaticJoint": "prismatic",
    "PhysicsFixedJoint": "fixed",
}
_AXES = {"X": 0, "Y": 1, "Z": 2}


@dataclass(eq=False)
class UsdPrim:
    """A prim of a text.

    Attributes:
        kind: its type.
        name: its name.
        path: from the top.
        metadata: what stands in brackets behind its name.
        values: attributes and relationships by name.
        inside: prims in it.
    """

    kind: str
    name: str
    path: str
    metadata: dict[str, Any] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    inside: list[UsdPrim] = field(default_factory=list)

    def everywhere(self) -> Iterator[UsdPrim]:
        """It and all in it."""
        yield self
        for prim in self.inside:
            yield from prim.everywhere()


class _Reader:
    """Reads one text, token by token."""

    def __init__(self, text: str) -> None:
        found = (match[0] for match in _TOKEN.finditer(text))
        self._tokens = [token for token in found if not token.startswith("#")]
        self._at = 0

    def _next(self) -> str:
        self._at += 1
        return self._tokens[self._at - 1]

    def _peek(self) -> str:
        return self._tokens[self._at] if self._at < len(self._tokens) else ""

    def stage(self) -> UsdPrim:
        """The whole text as a prim without a name."""
        top = UsdPrim("", "", "")
        if self._peek() == "(":
            top.metadata = self._assignments(")")
        while self._peek():
            top.inside.append(self._prim(""))
        return top

    def _prim(self, above: str) -> UsdPrim:
        self._next()  # def, over or class
        kind = self._next() if not self._peek().startswith('"') else ""
        name = self._next().strip('"')
        prim = UsdPrim(kind, name, f"{above}/{name}")
        if self._peek() == "(":
            prim.metadata = self._assignments(")")
        self._next()  # {
        while self._peek() != "}":
            if self._peek() in ("def", "over", "class"):
                prim.inside.append(self._prim(prim.path))
            else:
                name, value = self._assignment()
                prim.values[name] = value
        self._next()
        return prim

    def _assignments(self, end: str) -> dict[str, Any]:
        self._next()
        found = {}
        while self._peek() != end:
            name, value = self._assignment()
            found[name] = value
        self._next()
        return found

    def _assignment(self) -> tuple[str, Any]:
        """``uniform token NAME = value``: the word before the sign is the name."""
        words = [self._next()]
        while self._peek() != "=":
            words.append(self._next())
        self._next()
        words = [word for word in words if word not in "[]"]
        return words[-1], self._value()

    def _value(self) -> Any:
        token = self._next()
        if token in "([":
            end = {"(": ")", "[": "]"}[token]
            items = []
            while self._peek() != end:
                if self._peek() == ",":
                    self._next()
                else:
                    items.append(self._value())
            self._next()
            return items
        if token[0] in '"<':
            return token[1:-1]
        return float(token)


def parse_usda(text: str) -> UsdPrim:
    """The prims of a USD text, under a prim without a name; raises InputError where it is none."""
    if not text.startswith("#usda 1.0"):
        raise InputError("is no USD text", source="written model")
    try:
        return _Reader(text).stage()
    except (IndexError, ValueError, KeyError) as error:
        raise InputError(f"is no USD text that can be read ({error})", source="written model") from error


def read_usda(robot: Robot, text: str) -> LoadedTree:
    """The articulation of a USD text; raises InputError where its joints are not the robot's."""
    prims = [prim for prim in parse_usda(text).everywhere()]
    bodies = {
        prim.path: _read_body(prim) for prim in prims if "PhysicsRigidBodyAPI" in _applied_schemas(prim)
    }
    joints = {_joint_name(prim): prim for prim in prims if prim.kind in _JOINTS}
    missing = [name for name in robot.joint_names if name not in joints]
    if missing:
        raise InputError(f"joint {missing[0]!r} is not in it", source="written model")
    own = [joints[name] for name in robot.joint_names]
    return LoadedTree(
        robot,
        bodies,
        [_read_joint(name, prim) for name, prim in joints.items()],
        {
            "viscous": _read_attribute(
                own, "PhysxJointAxisAPI", "physxJointAxis:%s:viscousFrictionCoefficient", "per"
            ),
            "coulomb": _read_attribute(own, "PhysxJointAxisAPI", "physxJointAxis:%s:dynamicFrictionEffort"),
            "armature": _read_attribute(own, "PhysxJointAxisAPI", "physxJointAxis:%s:armature"),
        },
        {
            "kp": _read_attribute(own, "PhysicsDriveAPI", "drive:%s:physics:stiffness", "per"),
            "kd": _read_attribute(own, "PhysicsDriveAPI", "drive:%s:physics:damping", "per"),
            "torque_limit": _read_attribute(own, "PhysicsDriveAPI", "drive:%s:physics:maxForce"),
            "velocity_limit": _read_attribute(
                own, "PhysxJointAxisAPI", "physxJointAxis:%s:maxJointVelocity", "of"
            ),
        },
    )


def _applied_schemas(prim: UsdPrim) -> list[str]:
    found = prim.metadata.get("apiSchemas", [])
    return [str(name) for name in found]


def _joint_name(prim: UsdPrim) -> str:
    return str(prim.values.get("excite:joint", prim.name))


def _to_single_precision(values: Any) -> Array:
    """Numbers as single precision keeps them."""
    return np.asarray(values, dtype=np.float32).astype(float)


def _quaternion_rotation(values: Any) -> Array:
    w, x, y, z = _to_single_precision(values)
    return np.asarray(pin.Quaternion(w, x, y, z).normalized().matrix())


def _read_body(prim: UsdPrim) -> ReadBody:
    """A body by its mass properties; without them a base that is held, whose mass nothing feels."""
    if "PhysicsMassAPI" not in _applied_schemas(prim):
        return ReadBody(0.0, np.zeros(3), np.zeros((3, 3)))
    turn = _quaternion_rotation(prim.values["physics:principalAxes"])
    moments = np.diag(_to_single_precision(prim.values["physics:diagonalInertia"]))
    return ReadBody(
        float(_to_single_precision(prim.values["physics:mass"])),
        _to_single_precision(prim.values["physics:centerOfMass"]),
        turn @ moments @ turn.T,
    )


def _read_joint(name: str, prim: UsdPrim) -> ReadJoint:
    kind, values = _JOINTS[prim.kind], prim.values
    poses = [
        pin.SE3(
            _quaternion_rotation(values.get(f"physics:localRot{side}", [1.0, 0.0, 0.0, 0.0])),
            _to_single_precision(values.get(f"physics:localPos{side}", [0.0, 0.0, 0.0])),
        )
        for side in (0, 1)
    ]
    axis = np.eye(3)[_AXES[values.get("physics:axis", "X")]] if kind != "fixed" else None
    parent, child = str(values.get("physics:body0", "")), str(values["physics:body1"])
    return ReadJoint(name, kind, parent, child, poses[0], poses[1], axis)


def _read_attribute(joints: list[UsdPrim], schema: str, attribute: str, angle: str = "") -> Array:
    """An attribute of all joints in SI: ``per`` degree, or ``of`` degrees; NaN where it or its schema is missing."""
    found = []
    for prim in joints:
        axis = "linear" if prim.kind == "PhysicsPrismaticJoint" else "angular"
        value = (
            prim.values.get(attribute % axis, np.nan)
            if f"{schema}:{axis}" in _applied_schemas(prim)
            else np.nan
        )
        turn = {"per": 180.0 / np.pi, "of": np.pi / 180.0}.get(angle, 1.0) if axis == "angular" else 1.0
        found.append(float(_to_single_precision(value)) * turn)
    return np.array(found)
