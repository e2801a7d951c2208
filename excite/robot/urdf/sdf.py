"""SDF models as URDF: the same links, joints and shapes, each link's frame put where its joint is.

The semantics are those of sdformat.org's specification, versions 1.4 to 1.11: a pose is relative to the frame that
``relative_to`` names, else to the model (links), to the child (joints) or to the link (inertials and shapes); an axis
is expressed in its joint's frame unless ``expressed_in`` says otherwise, up to version 1.4 in the model's.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import RobotError
from excite.robot.refusal import robot_error
from excite.robot.urdf.inertia import GEOMETRY, LENGTHS
from excite.robot.urdf.numbers import MOMENTS, add_element, read_numbers, write_origin

_MODEL, _WORLD = "__model__", "world"
_KINDS = {"revolute", "continuous", "prismatic", "fixed"}
# Limits of SDF from which on a joint has none [rad or m].
_UNLIMITED = 1e10


def convert_sdf(root: Element, path: Path) -> str:
    """The URDF of the only model in an SDF file.

    Args:
        root: the ``sdf`` element.
        path: its file, beside which meshes are looked for; for errors.

    Returns:
        URDF text. Meshes that are found are named by their whole path, ``model://`` becomes ``package://``.

    Raises:
        RobotError: there is no model or more than one, it holds other models, a joint has more than one coordinate that
            URDF knows, a frame is not there or hangs on itself, or a number is none.
    """
    models = [*root.findall("model"), *root.findall("world/model")]
    if len(models) != 1:
        names = ", ".join(model.get("name", "") for model in models)
        raise robot_error(
            path,
            "sdf",
            f"holds {len(models)} models{f', {names}' if names else ''}",
            "give a file with the robot's model alone",
        )
    return ElementTree.tostring(_Conversion(models[0], root.get("version", "1.7"), path).urdf(), "unicode")


class _Conversion:
    def __init__(self, model: Element, version: str, path: Path) -> None:
        self._model, self._path = model, path
        self._old = tuple(int(part) for part in version.split(".")[:2] if part.isdigit()) <= (1, 4)
        for tag in ("model", "include"):
            if model.find(tag) is not None:
                raise self._error(
                    f"holds another model (<{tag}>)", "model", "give the file with that resolved"
                )
        self._links = {link.get("name", ""): link for link in model.findall("link")}
        self._joints = {joint.get("name", ""): joint for joint in model.findall("joint")}
        self._frames = {frame.get("name", ""): frame for frame in model.findall("frame")}
        self._parents = {name: _text(joint, "parent") for name, joint in self._joints.items()}
        self._children = {name: _text(joint, "child") for name, joint in self._joints.items()}
        # A link's frame in URDF is its joint's.
        self._carriers = {self._carrying_link(child): name for name, child in self._children.items()}

    def urdf(self) -> Element:
        robot = Element("robot", name=self._model.get("name") or "robot")
        if _WORLD in self._parents.values():
            SubElement(robot, "link", name=_WORLD)
        for name, link in self._links.items():
            self._write_link(SubElement(robot, "link", name=name), name, link)
        for name, joint in self._joints.items():
            self._write_joint(robot, name, joint)
        return robot

    def _error(self, what: str, field: str, remedy: str) -> RobotError:
        return robot_error(self._path, field, what, remedy)

    def _numbers(self, element: Element | None, tag: str, n: int, default: str | None = None) -> Array:
        """Numbers in the text of an element below another one."""
        found = None if element is None else element.find(tag)
        text = default if found is None or found.text is None else found.text
        holder = Element(tag) if text is None else Element(tag, {tag: text})
        return np.array(read_numbers(holder, tag, n, self._path, f"{self._model.get('name')}/{tag}"))

    def _own_pose(self, element: Element) -> pin.SE3:
        pose = element.find("pose")
        text = "" if pose is None or pose.text is None else pose.text.strip()
        if pose is not None and pose.get("rotation_format") == "quat_xyzw":
            values = self._numbers(element, "pose", 7)
            quaternion = values[3:] / np.linalg.norm(values[3:])
            return pin.SE3(pin.Quaternion(quaternion).toRotationMatrix(), values[:3])
        values = self._numbers(element, "pose", 6) if text else np.zeros(6)
        degrees = pose is not None and pose.get("degrees") in {"true", "1"}
        return pin.SE3(pin.rpy.rpyToMatrix(*(np.radians(values[3:]) if degrees else values[3:])), values[:3])

    def _pose(self, name: str, seen: tuple[str, ...] = ()) -> pin.SE3:
        """Pose of a link, joint or frame in the model."""
        if name in {_MODEL, _WORLD}:
            return pin.SE3.Identity()
        element, default = self._element(name)
        pose = element.find("pose")
        base = default if pose is None else pose.get("relative_to") or pose.get("frame") or default
        if name in seen:
            raise self._error("is relative to itself", f"frame {name!r}", "name another frame, relative_to")
        return self._pose(base, (*seen, name)) * self._own_pose(element)

    def _element(self, name: str) -> tuple[Element, str]:
        if name in self._links:
            return self._links[name], _MODEL
        if name in self._joints:
            return self._joints[name], self._children[name]
        if name in self._frames:
            return self._frames[name], self._frames[name].get("attached_to") or _MODEL
        raise self._error("is not in the model", f"frame {name!r}", "name a link, a joint or a frame")

    def _link_pose(self, name: str) -> pin.SE3:
        """Pose in the model of the frame that a link has in the URDF."""
        return self._pose(self._carriers.get(name, name))

    def _carrying_link(self, name: str) -> str:
        """The link that a joint's parent or child is, or is a frame of."""
        seen: set[str] = set()
        while name in self._frames and name not in seen:
            seen.add(name)
            name = self._frames[name].get("attached_to") or ""
        if name not in self._links and name != _WORLD:
            raise self._error(
                "is no link of the model", f"link {name!r}", "name links, and frames attached to them"
            )
        return name

    def _write_link(self, out: Element, name: str, link: Element) -> None:
        moved = self._link_pose(name).actInv(self._pose(name))
        inertial = link.find("inertial")
        holder = Element("inertial") if inertial is None else inertial
        written = SubElement(out, "inertial")
        write_origin(written, moved * self._own_pose(holder))
        # What is left out is 1 kg and 1 kg·m² about each axis.
        add_element(written, "mass", value=self._numbers(holder, "mass", 1, "1"))
        moments = holder.find("inertia")
        values = {key: self._numbers(moments, key, 1, "1" if key[1] == key[2] else "0") for key in MOMENTS}
        add_element(written, "inertia", **values)
        for kind in GEOMETRY:
            for shape in link.findall(kind):
                self._write_shape(out, kind, shape, moved)

    def _write_shape(self, out: Element, kind: str, shape: Element, moved: pin.SE3) -> None:
        solids = [solid for solid in shape.iterfind("geometry/*") if solid.tag in LENGTHS]
        if not solids:
            return
        written = SubElement(out, kind)
        write_origin(written, moved * self._own_pose(shape))
        place = SubElement(written, "geometry")
        for solid in solids:
            sizes = {
                key: self._numbers(solid, key, n, "1 1 1"[: 2 * n - 1]) for key, n, _ in LENGTHS[solid.tag]
            }
            added = add_element(place, solid.tag, **sizes)
            if solid.tag == "mesh":
                uri = _text(solid, "uri").replace("model://", "package://", 1)
                file = self._path.resolve().parent / uri.removeprefix("file://")
                added.set("filename", str(file) if "://" not in uri and file.is_file() else uri)

    def _write_joint(self, robot: Element, name: str, joint: Element) -> None:
        kind = joint.get("type", "")
        if kind not in _KINDS:
            remedy = "replace it by joints of one coordinate (revolute, continuous, prismatic), or fix it"
            raise self._error(f"is of type {kind!r}", f"joint {name!r}", remedy)
        parent, child = self._carrying_link(self._parents[name]), self._carrying_link(self._children[name])
        written = SubElement(robot, "joint", name=name, type=kind)
        SubElement(written, "parent", link=parent)
        SubElement(written, "child", link=child)
        base = pin.SE3.Identity() if parent == _WORLD else self._link_pose(parent)
        write_origin(written, base.actInv(self._pose(name)))
        if kind != "fixed":
            self._write_axis(written, name, joint)

    def _write_axis(self, written: Element, name: str, joint: Element) -> None:
        axis = joint.find("axis")
        direction = self._numbers(axis, "xyz", 3, "0 0 1")
        add_element(written, "axis", xyz=self._axis_frame(name, axis).rotation.T @ direction)
        limit, dynamics, mimic = (joint.find(f"axis/{tag}") for tag in ("limit", "dynamics", "mimic"))
        ends = {
            key: self._numbers(limit, key, 1, end) for key, end in {"lower": "-1e16", "upper": "1e16"}.items()
        }
        largest = {key: self._numbers(limit, key, 1, "-1") for key in ("effort", "velocity")}
        known = {key: value for key, value in largest.items() if 0.0 <= value[0] < _UNLIMITED}
        limited = -_UNLIMITED < ends["lower"][0] and ends["upper"][0] < _UNLIMITED
        if not limited and written.get("type") == "revolute":
            written.set("type", "continuous")
        add_element(written, "limit", **(ends if limited else {}), **known)
        if dynamics is not None:
            losses = {key: self._numbers(dynamics, key, 1, "0") for key in ("damping", "friction")}
            add_element(written, "dynamics", **losses)
        if mimic is not None:
            factor, offset, reference = (
                self._numbers(mimic, key, 1, "0") for key in ("multiplier", "offset", "reference")
            )
            shift = offset - factor * reference
            add_element(written, "mimic", joint=mimic.get("joint", ""), multiplier=factor, offset=shift)

    def _axis_frame(self, name: str, axis: Element | None) -> pin.SE3:
        """From the frame in which an axis is expressed to its joint's: that frame's axes are seen from the joint."""
        direction = None if axis is None else axis.find("xyz")
        expressed = None if direction is None else direction.get("expressed_in")
        in_model = axis is not None and _text(axis, "use_parent_model_frame", "0") in {"1", "true"}
        if expressed is None and (in_model or self._old):
            expressed = _MODEL
        return pin.SE3.Identity() if expressed is None else self._pose(expressed).actInv(self._pose(name))


def _text(element: Element, tag: str, default: str = "") -> str:
    found = element.find(tag)
    return default if found is None or found.text is None else found.text.strip()
