"""USD as text: the robot as an articulation of USD physics, made anew."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.export.simulators.model_format import LoadedModel, ModelFormat, Rendered
from excite.export.simulators.subject import Subject
from excite.export.simulators.tree.described import Body, Joint, Tree, described_tree
from excite.export.simulators.usd.names import DRIVE, NEWTON, PHYSX, STATIC, prim_name, unit_factor
from excite.export.simulators.usd.reading import read_usda
from excite.export.simulators.usd.writing import (
    Prim,
    format_quaternion,
    format_several,
    format_single,
    pose_attributes,
    shape_prim,
)

_HEAD = """#usda 1.0
(
    defaultPrim = "{name}"
    kilogramsPerUnit = 1
    metersPerUnit = 1
    upAxis = "Z"
)
"""


class UsdaFormat(ModelFormat):
    """Rigid bodies with mass properties, joints with drives, friction for PhysX and for Newton, and convex shapes.

    Numbers are in USD's units: angles in degrees, so that gains and viscous friction are for each degree.
    """

    name = "usda"
    summary = "USD as text, an articulation made anew (Isaac Sim, Newton)"
    servo_terms = ("kp", "kd", "torque_limit", "velocity_limit")
    lacks: ClassVar[Mapping[str, str]] = {"delay": "USD's drives have no delay; the format isaaclab has one"}
    # Single precision of masses, places and turns, in the torques of a whole robot: 3e-9 (Go2), 6e-9 (G1), 2e-8 (a
    # person), 3e-8 (UR10).
    tolerance = 2e-7

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`."""
        tree = described_tree(subject)
        name = prim_name(subject.stem)
        names = _prim_names(tree)
        top = Prim("Xform", name, ["PhysicsArticulationRootAPI", "PhysxArticulationAPI"])
        top.lines.append("bool physxArticulation:enabledSelfCollisions = 0")
        top.inside = [_body_prim(body, own) for body, own in zip(tree.bodies, names, strict=True)]
        paths = [f"/{name}/{own}" for own in names]
        joints = Prim("Scope", prim_name("joints", names))
        if not tree.free:
            anchor = Prim("PhysicsFixedJoint", "world_to_base")
            anchor.lines.append(f"rel physics:body1 = <{paths[0]}>")
            joints.inside.append(anchor)
        taken = ["world_to_base"]
        for joint in tree.joints:
            taken.append(prim_name(joint.name, taken))
            joints.inside.append(_joint_prim(joint, taken[-1], paths))
        top.inside.append(joints)
        text = _HEAD.format(name=name) + "\n" + "\n".join(top.text()) + "\n"
        return Rendered({f"{subject.stem}.usda": text.encode()}, tree.notes)

    def load(self, subject: Subject, rendered: Rendered) -> LoadedModel:
        """Read by a reader of USD's text, in single precision where USD is."""
        return read_usda(subject.robot, rendered.files[rendered.main].decode())


def _prim_names(tree: Tree) -> list[str]:
    names: list[str] = []
    for body in tree.bodies:
        names.append(prim_name(body.name, names))
    return names


def _body_prim(body: Body, name: str) -> Prim:
    prim = Prim("Xform", name, ["PhysicsRigidBodyAPI"], pose_attributes(body.pose))
    if body.inertia is not None:
        prim.schemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
        prim.lines += [
            f"float physics:mass = {format_single(body.inertia.mass)}",
            f"point3f physics:centerOfMass = {format_several(body.inertia.com)}",
            f"float3 physics:diagonalInertia = {format_several(_single_moments(body.inertia.moments))}",
            f"quatf physics:principalAxes = {format_quaternion(body.inertia.rotation)}",
        ]
    prim.inside = [shape_prim(shape) for shape in body.shapes]
    return prim


def _single_moments(moments: Array) -> Array:
    """Principal moments in single precision, of a flat body too none larger than the two others together."""
    single = np.array(moments, dtype=np.float32)
    largest = int(np.argmax(single))
    others = float(single.astype(float).sum() - single[largest])
    while float(single[largest]) >= others > 0.0:
        single[largest] = np.nextafter(single[largest], np.float32(0.0))
    return single.astype(float)


def _joint_prim(joint: Joint, name: str, paths: list[str]) -> Prim:
    kind = "PhysicsPrismaticJoint" if joint.slides else "PhysicsRevoluteJoint"
    axis = "linear" if joint.slides else "angular"
    schemas = [f"PhysicsDriveAPI:{axis}", f"PhysxJointAxisAPI:{axis}", "NewtonJointAPI"]
    turn = _along_x(joint.axis)
    angle = 1.0 if joint.slides else 180.0 / np.pi
    lower, upper = (angle * value for value in joint.range)
    lines = [
        f"rel physics:body0 = <{paths[joint.parent]}>",
        f"rel physics:body1 = <{paths[joint.child]}>",
        'uniform token physics:axis = "X"',
        f"point3f physics:localPos0 = {format_several(joint.placement.translation)}",
        f"quatf physics:localRot0 = {format_quaternion(joint.placement.rotation @ turn)}",
        "point3f physics:localPos1 = (0, 0, 0)",
        f"quatf physics:localRot1 = {format_quaternion(turn)}",
        f"float physics:lowerLimit = {format_single(lower)}",
        f"float physics:upperLimit = {format_single(upper)}",
        f'uniform token drive:{axis}:physics:type = "force"',
    ]
    values = {**joint.terms, **joint.servo}
    for table in (DRIVE, PHYSX, NEWTON):
        for term, attribute in table.items():
            if term in values:
                value = format_single(values[term] * unit_factor(term, slides=joint.slides))
                lines.append(f"float {attribute.format(axis=axis)} = {value}")
    lines.append(f"float {STATIC.format(axis=axis)} = {format_single(joint.terms['coulomb'])}")
    # The name that the robot's description has, where USD takes no such name.
    if name != joint.name:
        lines.append(f'custom string excite:joint = "{joint.name}"')
    return Prim(kind, name, schemas, lines)


def _along_x(axis: Array) -> Array:
    """A rotation whose first column is an axis: USD's joints turn about one of three."""
    start = np.array([1.0, 0.0, 0.0])
    if axis @ start < -1.0 + 1e-9:
        return np.diag([-1.0, -1.0, 1.0])
    return np.asarray(pin.Quaternion.FromTwoVectors(start, axis).matrix())
