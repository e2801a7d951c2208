"""USD, the format of Isaac Sim, Isaac Lab and Newton: how it is written as text and how it is read."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.export.models.model_format import (
    Body,
    Joint,
    LoadedModel,
    ModelFormat,
    Rendered,
    Subject,
    Tree,
    described_tree,
    with_friction,
)
from excite.export.models.verification import States, pinocchio_torques
from excite.export.models.xml_text import moment_texts, number_text
from excite.robot.shapes.shape import Shape
from excite.robot.urdf.tree import WORLD as _WORLD

# USD as text, its own grammar: prims with metadata and attributes, and the shapes of a body.

_SOLIDS = {"sphere": "Sphere", "capsule": "Capsule", "cylinder": "Cylinder", "box": "Cube", "convex": "Mesh"}


@dataclass(eq=False)
class Prim:
    """A prim: what it is, what is said of it, what is inside.

    Attributes:
        kind: type, such as ``Xform``.
        name: name.
        schemas: API schemas that are applied to it.
        lines: attributes and relationships, as text.
        inside: prims in it.
    """

    kind: str
    name: str
    schemas: Sequence[str] = ()
    lines: list[str] = field(default_factory=list)
    inside: list[Prim] = field(default_factory=list)

    def text(self, indent: str = "") -> Iterable[str]:
        """Its lines."""
        yield f'{indent}def {self.kind} "{self.name}"' + (" (" if self.schemas else "")
        if self.schemas:
            named = ", ".join(f'"{name}"' for name in self.schemas)
            yield f"{indent}    prepend apiSchemas = [{named}]"
            yield f"{indent})"
        yield indent + "{"
        yield from (f"{indent}    {line}" for line in self.lines)
        for prim in self.inside:
            yield ""
            yield from prim.text(indent + "    ")
        yield indent + "}"


def format_single(value: float) -> str:
    """A number with the digits of single precision, which is what USD keeps of most."""
    single = np.float32(value)
    return (
        "inf"
        if np.isposinf(single)
        else "-inf"
        if np.isneginf(single)
        else np.format_float_positional(single, trim="-")
        if 1e-5 <= abs(single) < 1e7 or single == 0
        else np.format_float_scientific(single, trim="-")
    )


def format_several(values: Iterable[float]) -> str:
    """Numbers in brackets."""
    return "(" + ", ".join(format_single(value) for value in values) + ")"


def format_quaternion(rotation: Array) -> str:
    """A rotation ``(3, 3)``, real part first."""
    x, y, z, w = pin.Quaternion(rotation).normalized().coeffs()
    return format_several((w, x, y, z))


def pose_attributes(pose: pin.SE3, scale: Array | None = None) -> list[str]:
    """Attributes that put a prim somewhere."""
    lines = [
        f"double3 xformOp:translate = {format_several(pose.translation)}",
        f"quatf xformOp:orient = {format_quaternion(pose.rotation)}",
    ]
    order = ["xformOp:translate", "xformOp:orient"]
    if scale is not None:
        lines.append(f"double3 xformOp:scale = {format_several(scale)}")
        order.append("xformOp:scale")
    named = ", ".join(f'"{name}"' for name in order)
    return [*lines, f"uniform token[] xformOpOrder = [{named}]"]


def shape_prim(shape: Shape) -> Prim:
    """A collision shape, which is also what is seen."""
    schemas = ["PhysicsCollisionAPI"]
    if shape.vertices is None or shape.faces is None:
        scale = np.array(shape.size) if shape.kind == "box" else None
        lines = pose_attributes(shape.placement, scale)
        if shape.kind == "box":
            lines.append("double size = 1")
        else:
            lines.append(f"double radius = {format_single(shape.size[0])}")
        if shape.kind in ("capsule", "cylinder"):
            lines += ['uniform token axis = "Z"', f"double height = {format_single(shape.size[1])}"]
        return Prim(_SOLIDS[shape.kind], prim_name(shape.name), schemas, lines)
    points = ", ".join(format_several(corner) for corner in np.round(shape.vertices, 6))
    return Prim(
        "Mesh",
        prim_name(shape.name),
        [*schemas, "PhysicsMeshCollisionAPI"],
        [
            *pose_attributes(shape.placement),
            f"point3f[] points = [{points}]",
            f"int[] faceVertexCounts = [{', '.join(['3'] * len(shape.faces))}]",
            f"int[] faceVertexIndices = [{', '.join(str(int(corner)) for corner in shape.faces.ravel())}]",
            'uniform token subdivisionScheme = "none"',
            'uniform token physics:approximation = "convexHull"',
        ],
    )


DEGREE = np.pi / 180.0
# Of a hinge USD counts angles in degrees: gains and viscous friction are for each degree, speeds in degrees.
_HINGE_UNITS = {"kp": DEGREE, "kd": DEGREE, "viscous": DEGREE, "velocity_limit": 1.0 / DEGREE}
# Terms that stand a second time: for Newton's solvers, and as the friction at rest, which PhysX wants no smaller than
# that of motion.
_AGAIN = (
    ("armature", "newton:armature"),
    ("coulomb", "newton:friction"),
    ("viscous", "newton:damping"),
    ("velocity_limit", "newton:velocityLimit"),
    ("coulomb", "physxJointAxis:{axis}:staticFrictionEffort"),
)
_SCHEMAS = {"drive": "PhysicsDriveAPI", "physxJointAxis": "PhysxJointAxisAPI"}


def unit_factor(term: str, *, slides: bool) -> float:
    """What a value in SI is multiplied by to be in USD's unit."""
    return 1.0 if slides else _HINGE_UNITS.get(term, 1.0)


def prim_name(name: str, taken: Collection[str] = ()) -> str:
    """A name that USD takes (letters, digits and underscores, no digit first) and that is not taken."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    plain = f"_{plain}" if not plain or plain[0].isdigit() else plain
    while plain in taken:
        plain += "_"
    return plain


# What the text says, read line by line: each statement has one of its own.

_PRIM = re.compile(r'def (\w+) "([^"]*)"')
_STATEMENT = re.compile(r"(?:[\w\[\]]+ )*([\w:]+) = (.*)")
_NUMBER = re.compile(r"[-+]?(?:inf|nan|[\d.]+(?:e[-+]?\d+)?)")
_JOINTS = {
    "PhysicsRevoluteJoint": "revolute",
    "PhysicsPrismaticJoint": "prismatic",
    "PhysicsFixedJoint": "fixed",
}


@dataclass(eq=False)
class _ReadPrim:
    """A prim of a text: its type, its path, and what is said of it, as text by name."""

    kind: str
    path: str
    says: dict[str, str] = field(default_factory=dict)

    def numbers(self, name: str, default: str = "nan") -> Array:
        """Numbers of an attribute as single precision keeps them."""
        found = [float(word) for word in _NUMBER.findall(self.says.get(name, default))]
        return np.array(found, dtype=np.float32).astype(float)

    def rotation(self, name: str) -> Array:
        """A rotation ``(3, 3)``."""
        return np.asarray(pin.Quaternion(*self.numbers(name, "1 0 0 0")).normalized().matrix())

    def has(self, schema: str) -> bool:
        """Whether a schema is applied to it."""
        return f'"{schema}"' in self.says.get("apiSchemas", "")

    @property
    def joint(self) -> str:
        """Name of a joint as the robot's description has it."""
        return self.says.get("excite:joint", self.path.rpartition("/")[2]).strip('"')


def _read_prims(text: str) -> list[_ReadPrim]:
    if not text.startswith("#usda 1.0"):
        raise InputError("is no USD text", source="written model")
    found: list[_ReadPrim] = []
    opened: list[_ReadPrim] = []
    for line in map(str.strip, text.splitlines()):
        if prim := _PRIM.match(line):
            above = opened[-1].path if opened else ""
            opened.append(_ReadPrim(prim[1], f"{above}/{prim[2]}"))
            found.append(opened[-1])
        elif line == "}" and opened:
            opened.pop()
        elif opened and (statement := _STATEMENT.fullmatch(line)):
            opened[-1].says[statement[1]] = statement[2]
    return found


def urdf_of(prims: Sequence[_ReadPrim]) -> bytes:
    """The bodies and joints of an articulation as URDF: a link for each body, called by its path."""
    robot = ElementTree.Element("robot", name="articulation")
    ElementTree.SubElement(robot, "link", name=_WORLD)
    for prim in prims:
        if prim.has("PhysicsRigidBodyAPI"):
            link = ElementTree.SubElement(robot, "link", name=prim.path)
            # Without mass properties it is a base that is held, whose mass nothing feels.
            if prim.has("PhysicsMassAPI"):
                _add_inertial(link, prim)
    for prim in (prim for prim in prims if prim.kind in _JOINTS):
        outer, inner = (
            pin.SE3(
                prim.rotation(f"physics:localRot{side}"), prim.numbers(f"physics:localPos{side}", "0 0 0")
            )
            for side in (0, 1)
        )
        joint = ElementTree.SubElement(robot, "joint", name=prim.joint, type=_JOINTS[prim.kind])
        for end, side in (("parent", 0), ("child", 1)):
            path = prim.says.get(f"physics:body{side}", "").strip("<>")
            ElementTree.SubElement(joint, end, link=path or _WORLD)
        place = outer * inner.inverse()
        rpy = pin.rpy.matrixToRpy(place.rotation)
        ElementTree.SubElement(joint, "origin", xyz=number_text(*place.translation), rpy=number_text(*rpy))
        if _JOINTS[prim.kind] != "fixed":
            along = inner.rotation[:, "XYZ".index(prim.says.get("physics:axis", "X").strip('"'))]
            ElementTree.SubElement(joint, "axis", xyz=number_text(*along))
            ElementTree.SubElement(joint, "limit", lower="0", upper="0", effort="0", velocity="0")
    if not any(parent.get("link") == _WORLD for parent in robot.iter("parent")):
        robot.remove(robot[0])
    return ElementTree.tostring(robot)


def _add_inertial(link: ElementTree.Element, prim: _ReadPrim) -> None:
    turn = prim.rotation("physics:principalAxes")
    inertia = turn @ np.diag(prim.numbers("physics:diagonalInertia")) @ turn.T
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=number_text(*prim.numbers("physics:centerOfMass")))
    ElementTree.SubElement(inertial, "mass", value=number_text(*prim.numbers("physics:mass")))
    ElementTree.SubElement(inertial, "inertia", moment_texts(inertia))


def _read_term(joints: Sequence[_ReadPrim], term: str, attribute: str) -> Array:
    """A term of all joints in SI; NaN where it or its schema is missing."""
    found = []
    for prim in joints:
        slides = prim.kind == "PhysicsPrismaticJoint"
        axis = "linear" if slides else "angular"
        there = prim.has(f"{_SCHEMAS[attribute.partition(':')[0]]}:{axis}")
        (value,) = prim.numbers(attribute.format(axis=axis)) if there else [np.nan]
        found.append(float(value) / unit_factor(term, slides=slides))
    return np.array(found)


# USD as text: the robot as an articulation of USD physics, made anew.

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
    held: ClassVar[Mapping[str, str]] = {
        "kp": "drive:{axis}:physics:stiffness",
        "kd": "drive:{axis}:physics:damping",
        "torque_limit": "drive:{axis}:physics:maxForce",
        "armature": "physxJointAxis:{axis}:armature",
        "coulomb": "physxJointAxis:{axis}:dynamicFrictionEffort",
        "viscous": "physxJointAxis:{axis}:viscousFrictionCoefficient",
        "velocity_limit": "physxJointAxis:{axis}:maxJointVelocity",
    }
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

    def load(self, subject: Subject, rendered: Rendered, states: States) -> LoadedModel:
        """Bodies and joints as URDF by pinocchio, terms by their attributes, in single precision where USD is."""
        prims, robot = _read_prims(rendered.files[rendered.main].decode()), subject.robot
        joints = {prim.joint: prim for prim in prims if prim.kind in _JOINTS}
        own = [joints[name] for name in robot.joint_names]
        terms = {term: _read_term(own, term, attribute) for term, attribute in self.held.items()}
        bodies = pinocchio_torques(robot, urdf_of(prims), states)
        return LoadedModel(with_friction(robot, bodies, states, terms), terms)


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
    for term, attribute in (*UsdaFormat.held.items(), *_AGAIN):
        if term in joint.terms:
            value = format_single(joint.terms[term] * unit_factor(term, slides=joint.slides))
            lines.append(f"float {attribute.format(axis=axis)} = {value}")
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
