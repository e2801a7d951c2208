"""USD models as URDF: rigid bodies, joints and shapes of USD physics, each link's frame put where its joint is.

Semantics are those of UsdPhysics (openusd.org): a joint's frames are given in its two bodies, revolute limits in
degrees, lengths and masses in the stage's units; body 1 moves against body 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError, RobotError, raised_as
from excite.formats.file import check_file
from excite.robot.catalogue import MODEL_SUFFIXES
from excite.robot.refusal import robot_error
from excite.robot.shapes.mesh_files import binary_stl
from excite.robot.urdf.converted import ConvertedModel
from excite.robot.urdf.writing import add_element, add_inertial, add_joint, add_solid

USD_SUFFIXES = MODEL_SUFFIXES[-4:]
_DEGREE = np.pi / 180.0
# Single precision's largest number, which exporters write where there is no limit, is 3.4e38.
_ENDLESS = 1e30
_KINDS = {
    "PhysicsRevoluteJoint": "revolute",
    "PhysicsPrismaticJoint": "prismatic",
    "PhysicsFixedJoint": "fixed",
}


@dataclass(frozen=True, eq=False)
class _Joint:
    """A joint on the way from the root: its prim, bodies as paths, its frame in both, and the turn's sign."""

    prim: Any
    parent: str
    child: str
    outer: pin.SE3
    inner: pin.SE3
    sign: float


@raised_as(RobotError)
def convert_usd(path: Path) -> ConvertedModel:
    """The URDF of the robot in a USD file; materials, lights and scenes are left out.

    Args:
        path: the file; what it refers to is looked for as USD does.

    Raises:
        InputError: usd-core is not installed.
        RobotError: it cannot be read, holds no rigid body or several robots, a joint has more than one coordinate, or
            a body has a mass and no moments.
    """
    try:
        from pxr import Tf, Usd, UsdGeom, UsdPhysics
    except ImportError as error:
        raise InputError(
            "needs usd-core to be read", source=path, remedy="pip install 'excite[usd]', or give a URDF"
        ) from error
    try:
        stage = Usd.Stage.Open(str(check_file(path)))
    except Tf.ErrorException as error:
        # The library's own sentence, without the place in its source.
        said = str(error).rpartition(" : ")[2].strip("' \n").splitlines()[0][:160]
        raise robot_error(path, None, f"USD cannot read it ({said})", "export it again") from error
    length, weight = UsdGeom.GetStageMetersPerUnit(stage), UsdPhysics.GetStageKilogramsPerUnit(stage)
    # What is instanced is read as if it stood there.
    prims = list(stage.Traverse(Usd.TraverseInstanceProxies()))
    bodies = {str(prim.GetPath()): prim for prim in prims if prim.HasAPI(UsdPhysics.RigidBodyAPI)}
    if not bodies:
        raise robot_error(path, None, "holds no rigid body", "export it with its physics")
    cache = UsdGeom.XformCache()
    scales = {name: length * _body_scale(cache, prim) for name, prim in bodies.items()}
    joints, loops = _order_joints(path, prims, bodies, scales)
    own = [prim.GetName() for prim in bodies.values()]
    names = {
        path: prim.GetName() if own.count(prim.GetName()) == 1 else path.strip("/").replace("/", "_")
        for path, prim in bodies.items()
    }
    shifts = {joint.child: joint.inner for joint in joints}
    roots = [name for name in bodies if name not in {joint.child for joint in joints}]
    floating = not any(joint.parent == "" for joint in joints)
    if len(roots) != floating:
        called = ", ".join(names[root] for root in roots[:3])
        raise robot_error(
            path, None, f"holds bodies that no joint carries ({called})", "give one robot a file"
        )
    robot, meshes = Element("robot", name=path.stem), dict[str, bytes]()
    if not floating:
        SubElement(robot, "link", name="world")
    for name, prim in bodies.items():
        link, scale = SubElement(robot, "link", name=names[name]), scales[name]
        shift = shifts.get(name, pin.SE3.Identity()).inverse()
        if prim.HasAPI(UsdPhysics.MassAPI):
            _write_inertial(link, prim, shift, (weight, scale, weight * scale**2), path)
        for shape in _find_shapes(prim, bodies):
            place = np.array(cache.ComputeRelativeTransform(shape, prim)[0])
            _write_shape(link, shape, shift, place, scale, meshes)
    for joint in joints:
        _write_joint(robot, joint, names, shifts, (length, weight))
    notes = tuple(f"{loop} closes a loop and is left out" for loop in loops)
    return ConvertedModel(floating=floating, urdf=tostring(robot, "unicode"), meshes=meshes, notes=notes)


def _order_joints(
    path: Path, prims: list[Any], bodies: dict[str, Any], scales: dict[str, float]
) -> tuple[list[_Joint], list[str]]:
    """Joints from the root outwards, and the names of those that close loops."""
    from pxr import UsdPhysics

    waiting = []
    for prim in prims:
        if not prim.IsA(UsdPhysics.Joint):
            continue
        joint = UsdPhysics.Joint(prim)
        relations = (joint.GetBody0Rel(), joint.GetBody1Rel())
        named = [[str(end) for end in relation.GetTargets()] for relation in relations]
        ends = [next((end for end in targets if end in bodies), "") for targets in named]
        if joint.GetJointEnabledAttr().Get() is False or ends == ["", ""]:
            continue
        if prim.GetTypeName() not in _KINDS:
            remedy = "replace it by joints of one coordinate (revolute, prismatic), or fix it"
            raise robot_error(path, str(prim.GetPath()), f"is a {prim.GetTypeName()}", remedy)
        frames = [
            _read_pose(attributes[0].Get(), attributes[1].Get(), scales.get(end, 1.0))
            for end, attributes in zip(
                ends,
                (
                    (joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr()),
                    (joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr()),
                ),
                strict=True,
            )
        ]
        waiting.append((prim, ends, frames, bool(joint.GetExcludeFromArticulationAttr().Get())))
    held = any("" in ends for _, ends, _, _ in waiting)
    second = {ends[1] for _, ends, _, _ in waiting}
    reached = {""} if held else {next((name for name in bodies if name not in second), next(iter(bodies)))}
    found: list[_Joint] = []
    waiting.sort(key=lambda item: item[3])
    while True:
        ready = next((one for one in waiting if len(reached.intersection(one[1])) == 1), None)
        if ready is None:
            return found, [prim.GetName() for prim, *_ in waiting]
        waiting.remove(ready)
        prim, ends, frames, _ = ready
        turned = ends[1] in reached
        parent, child = reversed(ends) if turned else ends
        outer, inner = reversed(frames) if turned else frames
        found.append(_Joint(prim, parent, child, outer, inner, -1.0 if turned else 1.0))
        reached.add(child)


def _read_pose(place: Any, turn: Any, scale: float) -> pin.SE3:
    quaternion = pin.Quaternion(turn.GetReal(), *turn.GetImaginary())
    return pin.SE3(quaternion.normalized().matrix(), scale * np.array(place, dtype=float))


def _body_scale(cache: Any, prim: Any) -> float:
    """By how much a body's own lengths are larger in the stage."""
    whole = np.array(cache.GetLocalToWorldTransform(prim))[:3, :3]
    return float(abs(np.linalg.det(whole)) ** (1.0 / 3.0))


def _write_inertial(
    link: Element, prim: Any, shift: pin.SE3, units: tuple[float, float, float], path: Path
) -> None:
    """Its mass, centre and moments; ``units`` of mass, length and moment in SI."""
    from pxr import UsdPhysics

    weight, length, moment = units
    mass = UsdPhysics.MassAPI(prim)
    total = weight * float(mass.GetMassAttr().Get())
    moments = moment * np.array(mass.GetDiagonalInertiaAttr().Get(), dtype=float)
    center = np.array(mass.GetCenterOfMassAttr().Get(), dtype=float)
    if total <= 0.0:
        return
    if not moments.any():
        remedy = "state physics:diagonalInertia, or leave the mass out too"
        raise robot_error(path, str(prim.GetPath()), "has a mass and no moments of inertia", remedy)
    axes = mass.GetPrincipalAxesAttr().Get()
    turn = np.eye(3) if not axes.GetLength() else _read_pose(np.zeros(3), axes, 1.0).rotation
    # Unless it is stated, the centre of mass is not a number: the body's origin then.
    place = pin.SE3(np.eye(3), length * center if np.isfinite(center).all() else np.zeros(3))
    about = turn @ np.diag(moments) @ turn.T
    add_inertial(link, shift * place, total, about[np.triu_indices(3)].tolist())


def _find_shapes(body: Any, bodies: dict[str, Any]) -> Iterator[Any]:
    """What a body collides with: shapes with a collider at or above them, below the body and no other one."""
    from pxr import Usd, UsdGeom, UsdPhysics

    inside = iter(Usd.PrimRange(body, Usd.TraverseInstanceProxies()))
    collides: dict[str, bool] = {}
    for prim in inside:
        path, above = str(prim.GetPath()), str(prim.GetParent().GetPath())
        if prim != body and path in bodies:
            inside.PruneChildren()
            continue
        collides[path] = prim.HasAPI(UsdPhysics.CollisionAPI) or collides.get(above, False)
        if collides[path] and prim.IsA(UsdGeom.Gprim):
            yield prim


def _write_shape(
    link: Element, prim: Any, shift: pin.SE3, place: Array, length: float, meshes: dict[str, bytes]
) -> None:
    """A shape as a solid where it is one and nothing stretches it, else as a mesh."""
    from pxr import UsdGeom

    stretch = np.linalg.norm(place[:3, :3], axis=1)
    turn = (place[:3, :3] / stretch[:, None]).T
    kind, even = prim.GetTypeName(), np.allclose(stretch, stretch[0])
    if np.linalg.det(turn) < 0.0 or kind not in {"Cube", "Sphere", "Cylinder", "Capsule", "Mesh"}:
        return
    pose = shift * pin.SE3(turn, length * place[3, :3])
    if kind in {"Cylinder", "Capsule"}:
        # URDF's cylinders stand along z.
        along = np.eye(3)["XYZ".index(prim.GetAttribute("axis").Get())]
        pose = pose * pin.SE3(
            pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along).matrix(), np.zeros(3)
        )
    values = {
        name: float(attribute.Get()) * length * float(stretch[0])
        for name in ("size", "radius", "height")
        if (attribute := prim.GetAttribute(name)).HasValue()
    }
    if kind == "Cube":
        size = length * float(prim.GetAttribute("size").Get()) * stretch
        add_solid(link, "collision", pose, "box", size=size)
    elif kind == "Sphere" and even:
        add_solid(link, "collision", pose, "sphere", radius=values["radius"])
    elif kind in {"Cylinder", "Capsule"} and even:
        # A capsule's caps come on top of its height.
        more = 2.0 * values["radius"] if kind == "Capsule" else 0.0
        sizes = {"radius": values["radius"], "length": values["height"] + more}
        add_solid(link, "collision", pose, "cylinder", **sizes)
    elif kind == "Mesh":
        mesh = UsdGeom.Mesh(prim)
        points = length * stretch * np.array(mesh.GetPointsAttr().Get(), dtype=float).reshape(-1, 3)
        name = f"meshes/{link.get('name')}_{1 + len(link.findall('collision'))}.stl"
        faces = _cut_triangles(
            mesh.GetFaceVertexCountsAttr().Get(), list(mesh.GetFaceVertexIndicesAttr().Get())
        )
        meshes[name] = binary_stl(points[np.array(faces)])
        add_solid(link, "collision", pose, "mesh", filename=name)


def _cut_triangles(counts: Iterable[int], corners: Sequence[int]) -> list[tuple[int, int, int]]:
    """Faces, cut into triangles, by their corners."""
    found, first = [], 0
    for count in counts:
        face = corners[first : first + count]
        found += [(face[0], face[k], face[k + 1]) for k in range(1, count - 1)]
        first += count
    return found


def _write_joint(
    robot: Element,
    joint: _Joint,
    names: dict[str, str],
    shifts: dict[str, pin.SE3],
    units: tuple[float, float],
) -> None:
    """A joint with its limits; ``units`` of length and mass in SI."""
    prim, kind = joint.prim, _KINDS[joint.prim.GetTypeName()]
    name, parent = _read_stated(prim, "excite:joint") or prim.GetName(), names.get(joint.parent, "world")
    place = shifts.get(joint.parent, pin.SE3.Identity()).inverse() * joint.outer
    written = add_joint(robot, name, kind, parent, names[joint.child], place)
    if kind == "fixed":
        return
    add_element(
        written, "axis", xyz=joint.sign * np.eye(3)["XYZ".index(_read_stated(prim, "physics:axis") or "X")]
    )
    slides, (length, weight) = kind == "prismatic", units
    unit, force, way = (
        (length, weight * length, "linear") if slides else (_DEGREE, weight * length**2, "angular")
    )
    limits: dict[str, float] = {}
    for name, attribute, factor in (
        ("lower", "physics:lowerLimit", unit),
        ("upper", "physics:upperLimit", unit),
        ("effort", f"drive:{way}:physics:maxForce", force),
        ("velocity", "physxJoint:maxJointVelocity", unit),
        ("velocity", f"physxJointAxis:{way}:maxJointVelocity", unit),
    ):
        value = _read_stated(prim, attribute)
        if value is not None and abs(value) < _ENDLESS:
            limits[name] = float(value) * factor
    if not {"lower", "upper"} <= set(limits):
        written.set("type", "prismatic" if slides else "continuous")
        limits = {name: limits[name] for name in limits if name in {"effort", "velocity"}}
    add_element(written, "limit", **limits)


def _read_stated(prim: Any, attribute: str) -> Any:
    found = prim.GetAttribute(attribute)
    return found.Get() if found else None
