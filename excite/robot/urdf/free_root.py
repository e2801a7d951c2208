"""What a URDF's root says of the base: free, or on wheels, by its joint's type, or fixed to a world of its own."""

from __future__ import annotations

from xml.etree import ElementTree

from excite.robot.urdf.tree import link_at

WORLD = "world"


def free_root(root: ElementTree.Element) -> tuple[ElementTree.Element, ElementTree.Element] | None:
    """The floating joint that carries the whole robot, and the bare link that it hangs on; None where there is none.

    Args:
        root: the ``robot`` element.
    """
    return _carrying_joint(root, "floating")


def planar_root(root: ElementTree.Element) -> ElementTree.Element | None:
    """The planar joint on which the whole robot slides and turns, from a bare link; None where there is none."""
    found = _carrying_joint(root, "planar")
    return None if found is None else found[0]


def hold_planar_root(root: ElementTree.Element) -> None:
    """Fix such a joint: it stands for wheels, which are held still as others are."""
    joint = planar_root(root)
    if joint is not None:
        joint.set("type", "fixed")


def _carrying_joint(
    root: ElementTree.Element, kind: str
) -> tuple[ElementTree.Element, ElementTree.Element] | None:
    """The joint of a type that carries the whole robot, and the bare link that it hangs on."""
    joints = root.findall("joint")
    for joint in joints:
        if joint.get("type") != kind:
            continue
        above = link_at(joint, "parent")
        ends = [(link_at(other, "parent"), link_at(other, "child")) for other in joints if other is not joint]
        links = [link for link in root.findall("link") if link.get("name") == above]
        if any(above in pair for pair in ends) or len(links) != 1:
            continue
        if all(links[0].find(part) is None for part in ("inertial", "visual", "collision")):
            return joint, links[0]
    return None


def drop_free_root(root: ElementTree.Element) -> None:
    """Take such a joint and its bare link out: whether the base is free is for a ``robot.yaml`` to say."""
    found = free_root(root)
    if found is not None:
        for element in found:
            root.remove(element)


def declare_world(root: ElementTree.Element) -> bool:
    """Declare the link ``world`` where a robot is fixed to it and the file lacks it: Drake knows it by its name.

    Returns:
        Whether it was lacking.
    """
    links = {link.get("name") for link in root.findall("link")}
    ends = [link_at(joint, "parent") for joint in root.findall("joint") if joint.get("type") == "fixed"]
    if WORLD in links or WORLD not in ends:
        return False
    root.insert(0, ElementTree.Element("link", name=WORLD))
    return True
