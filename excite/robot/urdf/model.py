"""The pinocchio model of a URDF that was checked, built from what is dynamics in it."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pinocchio as pin

from excite.robot.refusal import robot_error

# What the parser reads beside these (geometry, colours, transmissions, sensors) is not the model's, and whatever is
# wrong there the parser prints line by line.
_KEPT = {
    "link": ("inertial",),
    "joint": ("parent", "child", "origin", "axis", "limit", "dynamics"),
}


def urdf_model(root: ElementTree.Element, path: Path, *, floating: bool = False) -> pin.Model:
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
    text = ElementTree.tostring(_dynamics_only(root), encoding="unicode")
    try:
        if floating:
            return pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
        return pin.buildModelFromXML(text)
    except (RuntimeError, ValueError) as error:
        what = f"pinocchio refuses it ({' '.join(str(error).split())})"
        raise robot_error(path, None, what, "check the file with check_urdf") from error


def _complete_limit(limit: ElementTree.Element) -> ElementTree.Element:
    """A joint's limits with zeros where effort or velocity is not stated: the parser refuses the whole model else."""
    return ElementTree.Element("limit", {"effort": "0", "velocity": "0", **limit.attrib})


def _dynamics_only(root: ElementTree.Element) -> ElementTree.Element:
    model = ElementTree.Element("robot", name=root.get("name", ""))
    for element in root:
        if element.tag not in _KEPT:
            continue
        copy = ElementTree.SubElement(model, element.tag, element.attrib)
        for tag in _KEPT[element.tag]:
            found = element.find(tag)
            if found is not None:
                copy.append(_complete_limit(found) if tag == "limit" else found)
    return model
