"""The URDF of a compiled MuJoCo model: links, joints, inertials and geometry, frame by frame."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.robot.urdf.numbers import format_row, write_origin

if TYPE_CHECKING:
    import mujoco


WORLD = "world"
MESHES = "meshes"
# Cosine of 2.5 degrees: less than a base leans in any posture in which a robot is drawn standing.
_UPRIGHT = 0.999
# File systems take 255 bytes, of which a letter may need four.
_LONGEST_NAME = 60


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: ``q = offset + multiplier · q_master`` [rad or m]."""

    master: int
    multiplier: float
    offset: float


@dataclass(eq=False)
class UrdfWriter:
    """Builds the ``robot`` element of a MuJoCo model.

    A body becomes a link whose frame has the body's axes and its origin at the body's last joint, since a URDF
    joint turns about its link's origin. Each further joint of a body gets a link without mass before it.
    Capsules become a cylinder and two spheres, ellipsoids their boxes; planes and height fields are left out.

    Attributes:
        model: the compiled model.
        bodies: bodies to write, in the model's order, parents first.
        mimics: by joint index.
        torque_limits: largest torque by joint index [N·m or N].
        meshes: STL files by name, filled while writing.
        notes: what the URDF does not say, filled while writing.
    """

    model: mujoco.MjModel
    bodies: tuple[int, ...]
    mimics: dict[int, Mimic]
    torque_limits: dict[int, float]
    meshes: dict[str, bytes] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def robot(self, name: str, root: int) -> ElementTree.Element:
        """The ``robot`` element; ``root`` is the body that becomes the root link, 0 for the world."""
        self._element = ElementTree.Element("robot", name=name)
        self._anchor: dict[int, Array] = {}
        if root == 0:
            ElementTree.SubElement(self._element, "link", name=WORLD)
            self._anchor[0] = np.zeros(3)
        else:
            self._upright(root)
        for body in self.bodies:
            self._anchor[body] = np.zeros(3) if body == root else self._joints(body)
            self._link(body)
        ElementTree.indent(self._element)
        return self._element

    def _upright(self, root: int) -> None:
        """A link without mass above a floating body whose own axes do not stand upright in the model."""
        pose = pose_of(np.zeros(3), self.model.body_quat[root])
        if pose.rotation[2, 2] > _UPRIGHT:
            return
        name = f"{self.link_name(root)}_upright"
        ElementTree.SubElement(self._element, "link", name=name)
        self._joint(f"{name}_fixed", "fixed", name, self.link_name(root), pose)
        self.notes.append(f"the base is {name}: the axes of {self.link_name(root)} do not stand upright")

    @property
    def anchors(self) -> dict[int, Array]:
        """By body, where its link's frame is in the body's frame ``(3,)`` [m]; filled while writing."""
        return self._anchor

    def link_name(self, body: int) -> str:
        """Name of a body's link."""
        return WORLD if body == 0 else self.model.body(body).name or f"body_{body}"

    def joint_name(self, joint: int) -> str:
        """Name of a joint."""
        return self.model.joint(joint).name or f"joint_{joint}"

    def _joints(self, body: int) -> Array:
        """Write the joints that carry a body; returns the last one's anchor in the body's frame [m]."""
        model, parent = self.model, int(self.model.body_parentid[body])
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        pose = pose_of(model.body_pos[body], model.body_quat[body])
        before, link = pin.SE3(np.eye(3), -self._anchor[parent]) * pose, self.link_name(parent)
        anchor = np.zeros(3)
        if count == 0:
            self._joint(f"{self.link_name(body)}_fixed", "fixed", link, self.link_name(body), before)
            return anchor
        for number in range(count):
            joint = first + number
            last = number == count - 1
            child = self.link_name(body) if last else f"{self.link_name(body)}_before_{number + 1}"
            origin = before * pin.SE3(np.eye(3), model.jnt_pos[joint] - anchor)
            self._moving(joint, link, child, origin)
            if not last:
                ElementTree.SubElement(self._element, "link", name=child)
            before, link, anchor = pin.SE3.Identity(), child, model.jnt_pos[joint].copy()
        return anchor

    def _moving(self, joint: int, parent: str, child: str, origin: pin.SE3) -> None:
        import mujoco

        model, name = self.model, self.joint_name(joint)
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL:
            self._joint(name, "fixed", parent, child, origin)
            return
        slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        limited = bool(model.jnt_limited[joint])
        kind = "prismatic" if slides else "revolute" if limited else "continuous"
        element = self._joint(name, kind, parent, child, origin)
        ElementTree.SubElement(element, "axis", xyz=format_row(model.jnt_axis[joint]))
        reference = float(model.qpos0[model.jnt_qposadr[joint]])
        # 0 stands for what MuJoCo does not say, since readers of URDFs insist on a number.
        limit = {"effort": _format_number(self.torque_limits.get(joint, 0.0)), "velocity": "0"}
        if limited:
            low, high = model.jnt_range[joint] - reference
            limit |= {"lower": _format_number(low), "upper": _format_number(high)}
        ElementTree.SubElement(element, "limit", limit)
        if reference != 0.0:
            self.notes.append(
                f"joint {name!r} has ref {reference:g}: its angles are less by that in the URDF"
            )
        if joint in self.mimics:
            mimic = self.mimics[joint]
            ElementTree.SubElement(
                element,
                "mimic",
                joint=self.joint_name(mimic.master),
                multiplier=_format_number(mimic.multiplier),
                offset=_format_number(mimic.offset),
            )

    def _joint(self, name: str, kind: str, parent: str, child: str, origin: pin.SE3) -> ElementTree.Element:
        element = ElementTree.SubElement(self._element, "joint", name=name, type=kind)
        ElementTree.SubElement(element, "parent", link=parent)
        ElementTree.SubElement(element, "child", link=child)
        write_origin(element, origin)
        return element

    def _link(self, body: int) -> None:
        model = self.model
        link = ElementTree.SubElement(self._element, "link", name=self.link_name(body))
        shift = pin.SE3(np.eye(3), -self._anchor[body])
        if model.body_mass[body] > 0.0:
            inertial = ElementTree.SubElement(link, "inertial")
            write_origin(inertial, shift * pose_of(model.body_ipos[body], model.body_iquat[body]))
            ElementTree.SubElement(inertial, "mass", value=_format_number(model.body_mass[body]))
            xx, yy, zz = (_format_number(value) for value in model.body_inertia[body])
            ElementTree.SubElement(inertial, "inertia", ixx=xx, ixy="0", ixz="0", iyy=yy, iyz="0", izz=zz)
        first = int(model.body_geomadr[body])
        for geom in range(first, first + int(model.body_geomnum[body])):
            touches = model.geom_contype[geom] or model.geom_conaffinity[geom]
            pose = shift * pose_of(model.geom_pos[geom], model.geom_quat[geom])
            for placement, solid in self._solids(geom):
                element = ElementTree.SubElement(link, "collision" if touches else "visual")
                write_origin(element, pose * placement)
                ElementTree.SubElement(element, "geometry").append(solid)

    def _solids(self, geom: int) -> list[tuple[pin.SE3, ElementTree.Element]]:
        """What a geom is made of in a URDF, each solid with its pose in the geom's frame."""
        import mujoco

        kinds, size = mujoco.mjtGeom, self.model.geom_size[geom]
        kind, here = kinds(int(self.model.geom_type[geom])), pin.SE3.Identity()
        if kind == kinds.mjGEOM_SPHERE:
            return [(here, _solid_element("sphere", radius=size[0]))]
        if kind in (kinds.mjGEOM_BOX, kinds.mjGEOM_ELLIPSOID):
            return [(here, ElementTree.Element("box", size=format_row(2.0 * size)))]
        if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
            solids = [(here, _solid_element("cylinder", radius=size[0], length=2.0 * size[1]))]
            if kind == kinds.mjGEOM_CAPSULE:
                for end in (-size[1], size[1]):
                    place = pin.SE3(np.eye(3), np.array([0.0, 0.0, end]))
                    solids.append((place, _solid_element("sphere", radius=size[0])))
            return solids
        if kind == kinds.mjGEOM_MESH:
            return [
                (here, ElementTree.Element("mesh", filename=self._mesh(int(self.model.geom_dataid[geom]))))
            ]
        return []

    def _mesh(self, mesh: int) -> str:
        """Relative path of a mesh's file."""
        called = self.model.mesh(mesh).name.replace("/", "_")
        if not called or len(called) > _LONGEST_NAME or not called.isprintable():
            called = f"mesh_{mesh}"
        name = f"{MESHES}/{called}.stl"
        if name not in self.meshes:
            model = self.model
            vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
            faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
            self.meshes[name] = binary_stl(vertices[faces])
        return name


def binary_stl(triangles: NDArray[np.floating]) -> bytes:
    """Binary STL of triangles ``(n, 3, 3)`` [m]."""
    corners = np.asarray(triangles, dtype="<f4")
    records = np.zeros(
        len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("extra", "<u2")]
    )
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records["normal"] = normals / np.where(lengths > 0.0, lengths, 1.0)
    records["corners"] = corners
    return b"\0" * 80 + struct.pack("<I", len(corners)) + records.tobytes()


def pose_of(position: Array, quaternion: Array) -> pin.SE3:
    """From MuJoCo's position and quaternion (w first)."""
    w, x, y, z = (float(value) for value in quaternion)
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(position, dtype=float))


def _solid_element(tag: str, **lengths: float) -> ElementTree.Element:
    return ElementTree.Element(tag, {name: _format_number(value) for name, value in lengths.items()})


def _format_number(value: float) -> str:
    return repr(float(value) + 0.0)
