"""Strict reading of URDF files: what is missing or absurd is one clear error before pinocchio sees it.

pinocchio takes the mass ``1,5`` for 0, accepts zero axes and negative inertia, and dies on endless chains
without a message; so everything that it would swallow is checked here.
"""

from __future__ import annotations

import os
import sysconfig
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import pinocchio as pin

from excite.errors import RobotError, raised_as
from excite.formats.documents import read_xml
from excite.robot.joint_values import check_range
from excite.robot.refusal import robot_error, unknown_name
from excite.robot.urdf.inertia import check_inertials, drop_points
from excite.robot.urdf.limits import keep_stated_limits
from excite.robot.urdf.numbers import read_number, read_numbers, read_origin
from excite.robot.urdf.tree import MOVING, check_tree, declare_world, settle_root
from excite.robot.urdf.writing import write_origin

# The deepest element known, a mesh of a link, is the sixth.
MAX_NESTING = 32

_FRAGMENT, _SDF = "a part of a MuJoCo model", "an SDF model"
# What a file of another outermost element is, and what to do with it.
_KINDS = {
    "mujoco": "a MuJoCo model",
    "sdf": _SDF,
    **dict.fromkeys(
        "mujocoinclude worldbody body default asset actuator sensor compiler option contact equality tendon".split(),
        _FRAGMENT,
    ),
}
_REMEDIES = {
    **dict.fromkeys(("a MuJoCo model", _SDF), "give it to excite init-robot, which makes a URDF of it"),
    _FRAGMENT: "give the file that includes it, whose outermost element is <mujoco>",
}


@dataclass(frozen=True)
class Stated:
    """What a ``robot.yaml`` says about joints and links that changes how the URDF is read.

    Attributes:
        floating: whether the base moves, so that the root link needs mass.
        locked: joints that are held, with their value [rad or m].
        limits: position limits by joint, where ``robot.yaml`` states them [rad or m].
        acknowledged: links whose missing or impossible inertia is accepted, with the reason.
    """

    floating: bool = False
    locked: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    acknowledged: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class CheckedUrdf:
    """A URDF that was checked, and rewritten so that every reader understands it alike.

    Attributes:
        root: the ``robot`` element that pinocchio can load.
        tightened: joints by what was tightened of their limits, by the element of the file that says it.
    """

    root: Element
    tightened: dict[str, dict[str, list[str]]]

    @property
    def text(self) -> str:
        """The URDF as text."""
        return tostring(self.root, encoding="unicode")


@raised_as(RobotError)
def read_urdf(path: Path, stated: Stated | None = None) -> CheckedUrdf:
    """Read a URDF, check it, and rewrite it so that every reader understands it alike.

    Mesh paths become absolute where the file is found; locked joints, and mimic joints that follow a
    locked one, become fixed at their value (other mimic joints keep their ``mimic`` element);
    continuous joints become revolute within the limits that
    ``stated`` or the file gives, so that each joint has one coordinate.

    Args:
        stated: what the robot's description says; by default a fixed base and nothing else.

    Raises:
        RobotError: the file is missing or something in it is absurd; names element and remedy.
    """
    stated = stated or Stated()
    root = read_xml(path, max_depth=MAX_NESTING)
    tightened = prepare_urdf(root, path)
    joints = check_tree(root, path)
    _lock_joints(joints, stated, path)
    for joint in joints.values():
        _one_coordinate(joint, stated, path)
    check_inertials(root, joints, stated.floating, stated.acknowledged, path)
    absolute_meshes(root, path)
    return CheckedUrdf(root, tightened)


@raised_as(RobotError)
def parse_urdf(path: Path) -> Element:
    """The ``robot`` element of a URDF file as :func:`prepare_urdf` leaves it.

    Raises:
        RobotError: the file is missing, is no XML, hides entities, is another format, or has a limit that is no number.
    """
    root = read_xml(path, max_depth=MAX_NESTING)
    prepare_urdf(root, path)
    return root


def prepare_urdf(root: Element, path: Path) -> dict[str, dict[str, list[str]]]:
    """Make the ``robot`` element of a file one without solids that are points and a free root, with its world.

    Continuous joints that state a range are revolute in it, limits that stand elsewhere in the file hold where they are
    the tighter ones, a planar root is fixed.

    Returns:
        Joints whose limits were tightened, as of :func:`~excite.robot.urdf.limits.keep_stated_limits`.

    Raises:
        RobotError: the file is another format, or has a limit that is no number.
    """
    if root.tag != "robot":
        raise robot_error(
            path,
            root.tag,
            f"is {_KINDS.get(root.tag, 'no URDF')}: its outermost element is <{root.tag}>, not <robot>",
            _REMEDIES.get(_KINDS.get(root.tag, ""), "export it as URDF or MJCF"),
        )
    drop_points(root)
    declare_world(root)
    settle_root(root)
    return keep_stated_limits(root, path)


def _lock_joints(joints: dict[str, Element], stated: Stated, path: Path) -> None:
    values = dict(stated.locked)
    for name, value in values.items():
        if name not in joints:
            moving = (n for n, j in joints.items() if j.get("type") in MOVING)
            raise unknown_name(path, "locked_joints", "joint", name, moving)
        slides = joints[name].get("type") == "prismatic"
        check_range(name, (value,), slides, f"locked_joints.{name}", path)
    followers = {}
    for name, joint in joints.items():
        mimic = joint.find("mimic")
        if mimic is not None and joint.get("type") != "fixed" and name not in values:
            followers[name] = mimic.get("joint", ""), *read_mimic(mimic, path, f"joint {name!r}/mimic")
    while held := [name for name, (master, *_) in followers.items() if master in values]:
        for name in held:
            master, factor, offset = followers.pop(name)
            values[name] = factor * values[master] + offset
    for name, value in values.items():
        for mimic in joints[name].findall("mimic"):
            joints[name].remove(mimic)
        _fix_joint(joints[name], value, path)


def read_mimic(mimic: Element, path: Path, where: str) -> tuple[float, float]:
    """Multiplier and offset of a ``<mimic>``; raises RobotError."""
    factor = read_number(mimic, "multiplier", path, where, default="1")
    return factor, read_number(mimic, "offset", path, where, default="0")


def _fix_joint(joint: Element, value: float, path: Path) -> None:
    """Turn a moving joint into a fixed one at ``value``."""
    where = f"joint {joint.get('name')!r}"
    if joint.get("type") == "fixed":
        raise robot_error(path, where, "is fixed already", "remove it from locked_joints")
    pose, axis = read_origin(joint, path, where), joint.find("axis")
    direction = np.array([1.0, 0.0, 0.0] if axis is None else read_numbers(axis, "xyz", 3, path, where))
    step = value * direction / np.linalg.norm(direction)
    slides = joint.get("type") == "prismatic"
    pose = pose * (pin.SE3(np.eye(3), step) if slides else pin.SE3(pin.exp3(step), np.zeros(3)))
    for origin in joint.findall("origin"):
        joint.remove(origin)
    write_origin(joint, pose)
    joint.set("type", "fixed")


def _one_coordinate(joint: Element, stated: Stated, path: Path) -> None:
    """Make a continuous joint revolute and give every moving joint a complete ``limit`` element."""
    name, kind, limit = joint.get("name", ""), joint.get("type"), joint.find("limit")
    if kind not in MOVING:
        # Which need none: the parser refuses a whole model for an incomplete one.
        for needless in joint.findall("limit"):
            joint.remove(needless)
        return
    where, has_limits = f"joint {name!r}/limit", limit is not None and {"lower", "upper"} <= set(limit.attrib)
    if name not in stated.limits and (kind == "continuous" or not has_limits):
        what = "turns without end" if kind == "continuous" else "has no position limits"
        raise robot_error(path, where, what, f"state limits.position.joints.{name} in robot.yaml")
    if limit is None:
        limit = SubElement(joint, "limit")
    joint.set("type", "revolute" if kind == "continuous" else str(kind))
    lower, upper = stated.limits.get(name) or (
        read_number(limit, side, path, where) for side in ("lower", "upper")
    )
    # Absent or 0: refused later unless robot.yaml states them.
    largest = {key: limit.get(key, "0") for key in ("effort", "velocity")}
    limit.attrib.update(lower=repr(lower), upper=repr(upper), **largest)


# What wheels of ROS packages brought along.
_WHEELS = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix"


def absolute_meshes(root: Element, path: Path) -> list[str]:
    """Give meshes below an element their whole path where they are found; the names of those that are not there."""
    lost = []
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "").strip()
        found = find_mesh(name, path)
        mesh.set("filename", name if found is None else str(found))
        lost += [name] if found is None else []
    return lost


def find_mesh(name: str, urdf: Path) -> Path | None:
    """File that a mesh's ``filename`` means, or None if there is none.

    ``package://NAME/…`` is looked for in the folders above the URDF, in ``$ROS_PACKAGE_PATH``, among the packages of
    ``$AMENT_PREFIX_PATH`` and among those that wheels brought along, at last below the folders above the URDF whatever
    these are called; other names are relative to the URDF.
    """
    folder = urdf.resolve().parent
    if "\0" in name:
        return None
    if not name.startswith("package://"):
        file = folder / name.removeprefix("file://")
        # Also what is no file, whose reader says so.
        return file.resolve() if name and os.path.exists(file) else None
    package, *inside = Path(name.removeprefix("package://").lstrip("/")).parts or ("",)
    above = (folder, *folder.parents)
    # $ROS_PACKAGE_PATH may name the package's own folder.
    places = (
        root.joinpath(*own, *inside)
        for root in (*above, *_package_folders())
        for own in ([package], *([[]] if root.name == package else []))
    )
    # A package that was copied under another name; one file's name alone may be anything's.
    renamed = (root.joinpath(*inside) for root in above if len(inside) > 1)
    return next((place.resolve() for place in chain(places, renamed) if os.path.isfile(place)), None)


def _package_folders() -> list[Path]:
    """Folders in which ROS packages lie: those that the environment names, and that of wheels of ROS packages."""
    packages, prefixes = (
        [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
        for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
    )
    return [*packages, *(prefix / "share" for prefix in (*prefixes, _WHEELS))]


# The pinocchio model of a URDF that was checked, built from what is dynamics in it.

# What the parser reads beside these (geometry, colours, transmissions, sensors) is not the model's, and whatever is
# wrong there the parser prints line by line.
_KEPT = {
    "link": ("inertial",),
    "joint": ("parent", "child", "origin", "axis", "limit", "dynamics"),
}


def urdf_model(root: Element, path: Path, *, floating: bool = False) -> pin.Model:
    """The model of a ``robot`` element that passed :func:`~excite.robot.urdf.tree.check_tree`.

    Args:
        root: the element; it is not changed.
        path: its file, for the error.
        floating: whether a free-flyer carries the root link.

    Raises:
        RobotError: pinocchio refuses it.
    """
    if floating and any(joint.get("name") == "root_joint" for joint in root.findall("joint")):
        what, remedy = "is called as readers call a free base's joint", "rename the joint"
        raise robot_error(path, "joint 'root_joint'", what, remedy)
    model = Element("robot", name=root.get("name", ""))
    for element in root:
        if element.tag not in _KEPT:
            continue
        copy = SubElement(model, element.tag, element.attrib)
        for tag in _KEPT[element.tag]:
            found = element.find(tag)
            if found is not None:
                # The parser refuses a whole model for a limit without effort or velocity.
                stated = {"effort": "0", "velocity": "0", **found.attrib}
                copy.append(Element("limit", stated) if tag == "limit" else found)
    text, base = tostring(model, encoding="unicode"), [pin.JointModelFreeFlyer()] * floating
    try:
        return pin.buildModelFromXML(text, *base)
    except (RuntimeError, ValueError) as error:
        what = f"pinocchio refuses it ({' '.join(str(error).split())})"
        raise robot_error(path, None, what, "check the file with check_urdf") from error
