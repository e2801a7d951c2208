"""The part of a MuJoCo model that its inverse dynamics depends on: without shapes, it compiles in a millisecond."""

from __future__ import annotations

from xml.etree import ElementTree

from defusedxml.ElementTree import fromstring

# What no inverse dynamics without contacts, limits and drives depends on. Tendons go too where nothing of theirs acts.
_ASIDE = (
    "asset",
    "contact",
    "sensor",
    "actuator",
    "keyframe",
    "visual",
    "statistic",
    "custom",
    "equality",
    "extension",
)
_SHAPES = ("geom", "site", "camera", "light")
# Elements that stand for others, whose text is not here.
_ELSEWHERE = ("include", "plugin", "attach", "replicate", "composite", "flexcomp")
# A tendon that acts without being driven.
_ACTS = ("stiffness", "damping", "armature")


def physics_alone(content: bytes) -> bytes | None:
    """A MuJoCo text of bodies, joints and inertials alone; None where its dynamics depend on more than its own text.

    That is so where it includes others, where a body's inertia follows from its shapes, or a tendon acts.
    """
    root = fromstring(content)
    if _depends_on_more(root):
        return None
    for tag in (*_ASIDE, "tendon", "deformable"):
        _remove_elements(root, tag)
    for world in root.findall("worldbody"):
        for parent in [world, *world.iter("body"), *world.iter("frame")]:
            for tag in _SHAPES:
                _remove_elements(parent, tag)
    for default in root.iter("default"):
        for element in list(default):
            if element.tag not in ("default", "joint"):
                default.remove(element)
    return ElementTree.tostring(root)


def _depends_on_more(root: ElementTree.Element) -> bool:
    if any(element.tag in _ELSEWHERE for element in root.iter()):
        return True
    if any("inertiafromgeom" in compiler.attrib for compiler in root.iter("compiler")):
        return True
    tendons = [tendon for group in root.iter("tendon") for tendon in group]
    if any(attribute in tendon.attrib for tendon in tendons for attribute in _ACTS):
        return True
    return any(_weighs_by_shape(world, moves=False) for world in root.iter("worldbody"))


def _weighs_by_shape(parent: ElementTree.Element, *, moves: bool) -> bool:
    """Whether a body in it that moves has the inertia of its shapes; what stands still weighs nothing in torques."""
    for child in parent:
        if child.tag not in ("body", "frame"):
            continue
        driven = moves or child.find("joint") is not None or child.find("freejoint") is not None
        by_shape = child.tag == "body" and child.find("inertial") is None and child.find("geom") is not None
        if (driven and by_shape) or _weighs_by_shape(child, moves=driven):
            return True
    return False


def _remove_elements(parent: ElementTree.Element, tag: str) -> None:
    for element in parent.findall(tag):
        parent.remove(element)
