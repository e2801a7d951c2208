"""USD as text, its own grammar: prims with metadata and attributes, and the shapes of a body."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.export.simulators.usd.names import prim_name
from excite.robot.shapes.shape import Shape

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
