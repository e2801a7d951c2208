"""The URDF of a compiled MuJoCo model: links, joints, inertials and geometry, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element, SubElement, indent

import mujoco
import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.shapes.mesh_files import binary_stl
from excite.robot.urdf.tree import WORLD
from excite.robot.urdf.writing import add_element, add_inertial, add_joint, add_solid

FREE, BALL, SLIDE, HINGE = (
    int(kind)
    for kind in (
        mujoco.mjtJoint.mjJNT_FREE,
        mujoco.mjtJoint.mjJNT_BALL,
        mujoco.mjtJoint.mjJNT_SLIDE,
        mujoco.mjtJoint.mjJNT_HINGE,
    )
)


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
        mimics: by joint index.
        torque_limits: largest torque by joint index [N·m or N].
        meshes: STL files by name, filled while writing.
        notes: what the URDF does not say, filled while writing.
        anchors: by body, where its link's frame is in the body's frame ``(3,)`` [m]; filled while writing.
    """

    model: mujoco.MjModel
    mimics: dict[int, Mimic] = field(default_factory=dict)
    torque_limits: dict[int, float] = field(default_factory=dict)
    meshes: dict[str, bytes] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    anchors: dict[int, Array] = field(default_factory=dict)

    def write_robot(self, name: str, root: int, bodies: list[int]) -> Element:
        """The ``robot`` element of bodies, parents first; ``root`` becomes the root link, 0 for the world."""
        self._element, self.anchors[root] = Element("robot", name=name), np.zeros(3)
        pose = pose_of(np.zeros(3), self.model.body_quat[root])
        if root == 0:
            SubElement(self._element, "link", name=WORLD)
        # Cosine of 2.5 degrees: less than a base leans in any posture in which a robot is drawn standing.
        elif pose.rotation[2, 2] <= 0.999:
            # A link without mass above a floating body whose own axes do not stand upright in the model.
            link = self.link_name(root)
            SubElement(self._element, "link", name=f"{link}_upright")
            add_joint(self._element, f"{link}_upright_fixed", "fixed", f"{link}_upright", link, pose)
            self.notes.append(f"the base is {link}_upright: the axes of {link} do not stand upright")
        for body in bodies:
            if body != root:
                self._write_joints(body)
            self._write_link(body)
        indent(self._element)
        return self._element

    def link_name(self, body: int) -> str:
        """Name of a body's link."""
        return WORLD if body == 0 else self.model.body(body).name or f"body_{body}"

    def joint_name(self, joint: int) -> str:
        """Name of a joint."""
        return self.model.joint(joint).name or f"joint_{joint}"

    def _write_joints(self, body: int) -> None:
        """The joints that carry a body, the last of which its link's frame is at."""
        model, parent, own = self.model, int(self.model.body_parentid[body]), self.link_name(body)
        pose = pose_of(model.body_pos[body], model.body_quat[body])
        before, link = pin.SE3(np.eye(3), -self.anchors[parent]) * pose, self.link_name(parent)
        self.anchors[body], count = np.zeros(3), int(model.body_jntnum[body])
        if count == 0:
            add_joint(self._element, f"{own}_fixed", "fixed", link, own, before)
        for number in range(count):
            joint, last = int(model.body_jntadr[body]) + number, number == count - 1
            child = own if last else f"{own}_before_{number + 1}"
            step = pin.SE3(np.eye(3), model.jnt_pos[joint] - self.anchors[body])
            self._write_joint(joint, link, child, before * step)
            if not last:
                SubElement(self._element, "link", name=child)
            before, link, self.anchors[body] = pin.SE3.Identity(), child, model.jnt_pos[joint].copy()

    def _write_joint(self, joint: int, parent: str, child: str, origin: pin.SE3) -> None:
        model, name, type_ = self.model, self.joint_name(joint), self.model.jnt_type[joint]
        limited = bool(model.jnt_limited[joint])
        kind = "prismatic" if type_ == SLIDE else "revolute" if limited else "continuous"
        kind = "fixed" if type_ == BALL else kind
        element = add_joint(self._element, name, kind, parent, child, origin)
        if type_ == BALL:
            return
        add_element(element, "axis", xyz=model.jnt_axis[joint])
        reference = float(model.qpos0[model.jnt_qposadr[joint]])
        # 0 stands for what MuJoCo does not say, since readers of URDFs insist on a number.
        limit = add_element(element, "limit", effort=self.torque_limits.get(joint, 0.0), velocity="0")
        if limited:
            low, high = (model.jnt_range[joint] - reference).tolist()
            limit.attrib.update(lower=repr(low + 0.0), upper=repr(high + 0.0))
        if reference != 0.0:
            self.notes.append(
                f"joint {name!r} has ref {reference:g}: its angles are less by that in the URDF"
            )
        mimic = self.mimics.get(joint)
        if mimic is not None:
            master = self.joint_name(mimic.master)
            add_element(element, "mimic", joint=master, multiplier=mimic.multiplier, offset=mimic.offset)

    def _write_link(self, body: int) -> None:
        model = self.model
        link = SubElement(self._element, "link", name=self.link_name(body))
        shift = pin.SE3(np.eye(3), -self.anchors[body])
        if model.body_mass[body] > 0.0:
            pose, (xx, yy, zz) = (
                pose_of(model.body_ipos[body], model.body_iquat[body]),
                model.body_inertia[body],
            )
            add_inertial(link, shift * pose, model.body_mass[body], (xx, "0", "0", yy, "0", zz))
        for geom in int(model.body_geomadr[body]) + np.arange(model.body_geomnum[body]):
            touches = model.geom_contype[geom] or model.geom_conaffinity[geom]
            pose = shift * pose_of(model.geom_pos[geom], model.geom_quat[geom])
            for height, tag, sizes in self._split_geom(int(geom)):
                place = pose * pin.SE3(np.eye(3), np.array([0.0, 0.0, height]))
                add_solid(link, "collision" if touches else "visual", place, tag, **sizes)

    def _split_geom(self, geom: int) -> Iterator[tuple[float, str, dict[str, str | float | Array]]]:
        """What a geom is made of in a URDF, each solid with its height in the geom's frame [m], tag and sizes."""
        kinds, size = mujoco.mjtGeom, self.model.geom_size[geom]
        kind = kinds(int(self.model.geom_type[geom]))
        if kind == kinds.mjGEOM_SPHERE:
            yield 0.0, "sphere", {"radius": size[0]}
        elif kind in (kinds.mjGEOM_BOX, kinds.mjGEOM_ELLIPSOID):
            yield 0.0, "box", {"size": 2.0 * size}
        elif kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
            yield 0.0, "cylinder", {"radius": size[0], "length": 2.0 * size[1]}
            for end in (-size[1], size[1]) if kind == kinds.mjGEOM_CAPSULE else ():
                yield end, "sphere", {"radius": size[0]}
        elif kind == kinds.mjGEOM_MESH:
            # Relative path of a mesh's file.
            mesh = int(self.model.geom_dataid[geom])
            model, called = self.model, self.model.mesh(mesh).name.replace("/", "_")
            # File systems take 255 bytes, of which a letter may need four.
            if not called or len(called) > 60 or not called.isprintable():
                called = f"mesh_{mesh}"
            vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
            faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
            self.meshes.setdefault(f"meshes/{called}.stl", binary_stl(vertices[faces]))
            yield 0.0, "mesh", {"filename": f"meshes/{called}.stl"}


def pose_of(position: Array, quaternion: Array) -> pin.SE3:
    """From MuJoCo's position and quaternion (w first)."""
    w, x, y, z = (float(value) for value in quaternion)
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(position, dtype=float))
