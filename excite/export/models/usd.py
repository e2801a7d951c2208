"""USD, the format of Isaac Sim, Isaac Lab and Newton: how it is written as text and how it is read."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import RobotError
from excite.export.models.model_format import ModelFormat, Rendered, Subject
from excite.export.models.verification import Reading, States, read_pinocchio
from excite.robot.robot import Robot
from excite.robot.shapes.collision import SURROUNDINGS, collision_shapes
from excite.robot.shapes.shape import Shape, joints_at
from excite.simulation.mjcf import joint_axis, mechanical_range, mujoco_quaternion, segment_inertia
from excite.simulation.true_parameters import PrincipalInertia

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
    if not np.isfinite(single):
        return str(float(single))
    is_plain = 1e-5 <= abs(single) < 1e7 or single == 0
    write = np.format_float_positional if is_plain else np.format_float_scientific
    return write(single, trim="-")


def format_several(values: Iterable[float]) -> str:
    """Numbers in brackets."""
    return "(" + ", ".join(format_single(value) for value in values) + ")"


def format_quaternion(rotation: Array) -> str:
    """A rotation ``(3, 3)``, real part first."""
    return format_several(mujoco_quaternion(rotation))


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

_LINE = re.compile(r'def (\w+) "([^"]*)"(?: \()?|(?:[\w\[\]]+ )*([\w:]+) = (.*)|(})')
_NUMBER = re.compile(r"[-+]?(?:inf|nan|[\d.]+(?:e[-+]?\d+)?)")
_JOINTS = {
    "PhysicsRevoluteJoint": pin.JointModelRevoluteUnaligned,
    "PhysicsPrismaticJoint": pin.JointModelPrismaticUnaligned,
    "PhysicsFixedJoint": None,
}


@dataclass(eq=False)
class _Read:
    """A prim of a text: its type, its path, and what is said of it, as text by name."""

    kind: str
    path: str
    says: dict[str, str] = field(default_factory=dict)

    def numbers(self, name: str, default: str = "nan") -> Array:
        """Numbers of an attribute as single precision keeps them."""
        found = [float(word) for word in _NUMBER.findall(self.says.get(name, default))]
        return np.array(found, dtype=np.float32).astype(float)

    def pose(self, place: str, turn: str) -> pin.SE3:
        """A pose of two attributes; where they are missing there is none."""
        return pin.SE3(
            pin.Quaternion(*self.numbers(turn, "1 0 0 0")).normalized().matrix(), self.numbers(place, "0 0 0")
        )


def _read_prims(text: str) -> list[_Read]:
    found: list[_Read] = []
    opened: list[_Read] = []
    for line in map(_LINE.fullmatch, map(str.strip, text.splitlines())):
        if line and line[1]:
            above = opened[-1].path if opened else ""
            opened.append(_Read(line[1], f"{above}/{line[2]}"))
            found.append(opened[-1])
        elif line and line[5]:
            opened.pop()
        elif line and opened:
            opened[-1].says[line[3]] = line[4]
    return found


def read_articulation(robot: Robot, text: str, states: States) -> Reading:
    """Bodies and joints of a USD text as a model of pinocchio, terms of its joints in SI; NaN where one is missing.

    Raises:
        InputError: its joints are not the robot's.
    """
    prims, model = _read_prims(text), pin.Model()
    # By path of a body, the joint that carries it and its place there.
    carried: dict[str, tuple[int, pin.SE3]] = {"": (0, pin.SE3.Identity())}
    bodies = [prim for prim in prims if "PhysicsRigidBodyAPI" in prim.says.get("apiSchemas", "")]
    if robot.floating:
        free = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
        carried[bodies[0].path] = free, pin.SE3.Identity()
    terms: dict[str, list[float]] = {term: [] for term in UsdaFormat.held}
    for prim in (prim for prim in prims if prim.kind in _JOINTS):
        outer, inner = (prim.pose(f"physics:localPos{k}", f"physics:localRot{k}") for k in (0, 1))
        parent, child = (prim.says.get(f"physics:body{k}", "").strip("<>") for k in (0, 1))
        joint, place = carried[parent]
        place, kind = place * outer * inner.inverse(), _JOINTS[prim.kind]
        if kind is not None:
            along = inner.rotation[:, "XYZ".index(prim.says.get("physics:axis", "X").strip('"'))]
            name = prim.says.get("excite:joint", prim.path.rpartition("/")[2]).strip('"')
            joint, place = model.addJoint(joint, kind(along), place, name), pin.SE3.Identity()
            slides = kind is pin.JointModelPrismaticUnaligned
            for term, attribute in UsdaFormat.held.items():
                (value,) = prim.numbers(attribute.format(axis="linear" if slides else "angular"))
                terms[term].append(float(value) / unit_factor(term, slides=slides))
        carried[child] = joint, place
    for prim in bodies:
        # Without mass properties it is a base that is held, whose mass nothing feels.
        if "PhysicsMassAPI" in prim.says["apiSchemas"]:
            own = prim.pose("physics:centerOfMass", "physics:principalAxes")
            moments = own.rotation @ np.diag(prim.numbers("physics:diagonalInertia")) @ own.rotation.T
            (mass,) = prim.numbers("physics:mass")
            joint, place = carried[prim.path]
            model.appendBodyToJoint(joint, pin.Inertia(float(mass), own.translation, moments), place)
    return read_pinocchio(robot, model, states, {term: np.array(values) for term, values in terms.items()})


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
        robot, name = subject.robot, prim_name(subject.stem)
        shapes: tuple[Shape, ...] = ()
        notes: tuple[str, ...] = ()
        try:
            shapes = collision_shapes(robot)
        except RobotError as error:
            notes = (f"it has no shapes: {error.what}",)
        top = Prim("Xform", name, ["PhysicsArticulationRootAPI", "PhysxArticulationAPI"])
        top.lines.append("bool physxArticulation:enabledSelfCollisions = 0")
        taken, paths = list[str](), dict[int, str]()
        for joint, body in _body_prims(subject, taken).items():
            paths[joint] = f"/{name}/{body.name}"
            body.inside = [
                shape_prim(one) for one in shapes if one.joint == joint and one.link not in SURROUNDINGS
            ]
            top.inside.append(body)
        joints = Prim("Scope", prim_name("joints", taken))
        if not robot.floating:
            anchor = Prim("PhysicsFixedJoint", "world_to_base")
            anchor.lines.append(f"rel physics:body1 = <{paths[0]}>")
            joints.inside.append(anchor)
        taken = ["world_to_base"]
        terms = {term: subject.written(term) for term in UsdaFormat.held}
        for index, own in enumerate(robot.joint_names):
            taken.append(prim_name(own, taken))
            known = {term: float(row[index]) for term, row in terms.items() if np.isfinite(row[index])}
            joints.inside.append(_joint_prim(robot, own, taken[-1], paths, known))
        top.inside.append(joints)
        text = _HEAD.format(name=name) + "\n" + "\n".join(top.text()) + "\n"
        return Rendered({f"{subject.stem}.usda": text.encode()}, notes, subject.changed_links)

    def read(self, subject: Subject, rendered: Rendered, states: States) -> Reading:
        """Bodies and joints by pinocchio, terms by their attributes, in single precision where USD is."""
        return read_articulation(subject.robot, rendered.files[rendered.model].decode(), states)


def _body_prims(subject: Subject, taken: list[str]) -> dict[int, Prim]:
    """A rigid body for each joint that carries one, the base among them; their names are put to ``taken``.

    Raises:
        UnphysicalParametersError: a segment's parameters belong to no body.
    """
    robot, model = subject.robot, subject.robot.model
    data, ten = joints_at(model, pin.neutral(model)), subject.parameters.reshape(-1, 10)
    found = {}
    for joint in range(1 if robot.floating else 0, model.njoints):
        link = robot.segments[joint - 1].link if joint else _root_link(model)
        taken.append(prim_name(link, taken))
        prim = Prim("Xform", taken[-1], ["PhysicsRigidBodyAPI"], pose_attributes(data.oMi[joint]))
        if joint or model.inertias[0].mass > 0.0:
            inertia = segment_inertia(robot, joint, ten[joint - 1]) if joint else _base_inertia(model)
            prim.schemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
            prim.lines += [
                f"float physics:mass = {format_single(inertia.mass)}",
                f"point3f physics:centerOfMass = {format_several(inertia.com)}",
                f"float3 physics:diagonalInertia = {format_several(_single_moments(inertia.moments))}",
                f"quatf physics:principalAxes = {format_quaternion(inertia.rotation)}",
            ]
        found[joint] = prim
    return found


def _root_link(model: pin.Model) -> str:
    """The link that stands at a fixed base's origin; ``base`` where the robot's description has none there."""
    names = [
        str(frame.name)
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and frame.parentJoint == 0 and frame.placement.isIdentity(1e-12)
    ]
    return next((name for name in names if name not in ("world", "universe")), "base")


def _base_inertia(model: pin.Model) -> PrincipalInertia:
    own = model.inertias[0]
    moments, axes = np.linalg.eigh(own.inertia)
    axes[:, 0] *= np.linalg.det(axes)
    return PrincipalInertia(float(own.mass), np.array(own.lever), moments, axes)


def _single_moments(moments: Array) -> Array:
    """Principal moments in single precision, of a flat body too none larger than the two others together."""
    single = np.array(moments, dtype=np.float32)
    largest = int(np.argmax(single))
    others = float(single.astype(float).sum() - single[largest])
    while float(single[largest]) >= others > 0.0:
        single[largest] = np.nextafter(single[largest], np.float32(0.0))
    return single.astype(float)


def _joint_prim(robot: Robot, own: str, name: str, paths: dict[int, str], terms: dict[str, float]) -> Prim:
    """A joint of the robot with its drive; ``own`` is its name there, ``terms`` those that are known [SI]."""
    joint = robot.model.getJointId(own)
    direction, slides = joint_axis(robot.model, joint)
    axis = "linear" if slides else "angular"
    schemas = [f"PhysicsDriveAPI:{axis}", f"PhysxJointAxisAPI:{axis}", "NewtonJointAPI"]
    turn, placement = _along_x(direction), robot.model.jointPlacements[joint]
    lower, upper = (v if slides else v / DEGREE for v in mechanical_range(robot, joint))
    lines = [
        f"rel physics:body0 = <{paths[robot.model.parents[joint]]}>",
        f"rel physics:body1 = <{paths[joint]}>",
        'uniform token physics:axis = "X"',
        f"point3f physics:localPos0 = {format_several(placement.translation)}",
        f"quatf physics:localRot0 = {format_quaternion(placement.rotation @ turn)}",
        "point3f physics:localPos1 = (0, 0, 0)",
        f"quatf physics:localRot1 = {format_quaternion(turn)}",
        f"float physics:lowerLimit = {format_single(lower)}",
        f"float physics:upperLimit = {format_single(upper)}",
        f'uniform token drive:{axis}:physics:type = "force"',
    ]
    for term, attribute in (*UsdaFormat.held.items(), *_AGAIN):
        if term in terms:
            value = format_single(terms[term] * unit_factor(term, slides=slides))
            lines.append(f"float {attribute.format(axis=axis)} = {value}")
    # The name that the robot's description has, where USD takes no such name.
    if name != own:
        lines.append(f'custom string excite:joint = "{own}"')
    return Prim("PhysicsPrismaticJoint" if slides else "PhysicsRevoluteJoint", name, schemas, lines)


def _along_x(axis: Array) -> Array:
    """A rotation whose first column is an axis: USD's joints turn about one of three."""
    start = np.array([1.0, 0.0, 0.0])
    if axis @ start < -1.0 + 1e-9:
        return np.diag([-1.0, -1.0, 1.0])
    return np.asarray(pin.Quaternion.FromTwoVectors(start, axis).matrix())
