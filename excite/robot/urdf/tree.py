"""Links and joints of a URDF: names, types, axes and limits, and that they form one tree."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from excite.finding import first_names
from excite.formats.documents import all_alike
from excite.robot.joint_values import check_range
from excite.robot.quantities import MAX_ANGLE, MAX_STAND_IN, MAX_TRAVEL_STAND_IN
from excite.robot.refusal import robot_error
from excite.robot.urdf.inertia import GEOMETRY, check_geometry
from excite.robot.urdf.numbers import read_number, read_numbers, read_origin, shorten_text

MOVING = ("revolute", "continuous", "prismatic")
MAX_LINKS = 2000
MAX_DEPTH = 200
# Names become parts of columns, file names and lines of text.
MAX_NAME = 200
# Readers take the first or the last of what stands twice, each its own: it has to be the same.
_ONCE = {
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic", "dynamics"),
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "collision": ("origin", "geometry"),
    "visual": ("origin", "geometry"),
}


def check_tree(root: Element, path: Path) -> dict[str, Element]:
    """Check links and joints of a ``robot`` element.

    Returns:
        The joints by name, in the file's order.

    Raises:
        RobotError: duplicated or missing names, unknown links or joint types, an impossible axis, origin
            or limit, several roots, closed loops, or a tree too large or too deep.
    """
    _check_counts(root, path)
    _check_name(root, "robot", path)
    links = _named_elements(root, "link", path)
    joints = _named_elements(root, "joint", path)
    if not links:
        raise robot_error(path, "robot", "has no <link>", "describe at least one")
    for element in (*links.values(), *joints.values()):
        _check_once(element, f"{element.tag} {element.get('name')!r}", path)
    carriers: dict[str, Element] = {}
    for name, joint in joints.items():
        for end in ("parent", "child"):
            where, link = f"joint {name!r}/{end}", link_at(joint, end)
            if link not in links:
                remedy = f"define the link {link!r}" if link else f"name the {end} link"
                raise robot_error(path, where, f"unknown link {link!r}", remedy)
        if link in carriers:
            both = f"{carriers[link].get('name')!r} and {name!r}"
            what = f"is the child of two joints, {both}: a closed loop"
            remedy = "cut the loop by removing one of them; closed loops are not modelled"
            raise robot_error(path, f"link {link!r}", what, remedy)
        carriers[link] = joint
        _check_joint(joint, f"joint {name!r}", path)
    _check_roots(list(links), LinkTree(joints), path)
    for link, element in links.items():
        check_geometry(element, link, path)
    return joints


def _check_counts(root: Element, path: Path) -> None:
    joints = root.findall("joint")
    counts = {
        "links": (len(root.findall("link")), MAX_LINKS),
        "joints": (len(joints), MAX_LINKS),
        # The largest known, a mobile robot with two arms and hands, has 101 and 112; every solid is compared with every
        # other one, in 100 postures: these bounds keep that below half a minute.
        "joints that move": (sum(joint.get("type") in MOVING for joint in joints), 200),
        **{f"{kind} elements": (len(root.findall(f"link/{kind}")), 400) for kind in GEOMETRY},
    }
    for what, (number, most) in counts.items():
        if number > most:
            raise robot_error(path, "robot", f"has {number} {what}, more than {most}", "reduce the model")


def link_at(joint: Element, end: str) -> str:
    """Name of the link at a joint's ``end``, ``parent`` or ``child``; empty where the joint names none."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


class LinkTree:
    """Which joints of a URDF lie between its links and its root.

    Args:
        joints: elements by name.

    Attributes:
        ends: links before and beyond each joint.
        carriers: the joint that carries a link, by link.
    """

    def __init__(self, joints: Mapping[str, Element]) -> None:
        self.ends = {name: (link_at(one, "parent"), link_at(one, "child")) for name, one in joints.items()}
        self.carriers = {child: name for name, (_, child) in self.ends.items()}

    @property
    def root(self) -> str:
        """The first link that a joint hangs on and none carries; empty where there is none."""
        return next((parent for parent, _ in self.ends.values() if parent not in self.carriers), "")

    def above(self, link: str) -> list[str]:
        """Joints between a link and the root, the link's own first; of a circle each once."""
        found: dict[str, None] = {}
        while link in self.carriers and (joint := self.carriers[link]) not in found:
            found[joint], link = None, self.ends[joint][0]
        return list(found)

    def below(self, link: str) -> list[str]:
        """Joints that hang on a link."""
        return [name for name, (parent, _) in self.ends.items() if parent == link]


def _named_elements(root: Element, tag: str, path: Path) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for number, element in enumerate(root.findall(tag)):
        name = _check_name(element, f"{tag} {number}", path)
        if name in found:
            raise robot_error(path, f"{tag} {name!r}", "occurs twice", "rename one of them")
        # Readers pass over a link or joint inside another one.
        for inside in (one for one in element.iter() if one is not element and one.tag in {"link", "joint"}):
            what = f"holds the {inside.tag} {shorten_text(inside.get('name', ''))!r}"
            raise robot_error(path, f"{tag} {name!r}", what, "put it beside, not inside")
        found[name] = element
    return found


def _check_name(element: Element, where: str, path: Path) -> str:
    """An element's name, which it has to have."""
    name = element.get("name", "")
    if not name.strip() or len(name) > MAX_NAME or not name.isprintable():
        remedy = f"give it a name of at most {MAX_NAME} printable characters"
        raise robot_error(path, where, f"has the name {shorten_text(name)!r}", remedy)
    return name


def _check_once(element: Element, where: str, path: Path) -> None:
    for tag in _ONCE.get(element.tag, ()):
        # Published models of real arms have a mount with two: where that stands changes no torque.
        mount = tag == "origin" and element.tag == "joint" and element.get("type") == "fixed"
        if not mount and not all_alike(element.findall(tag)):
            raise robot_error(path, f"{where}/{tag}", "occurs twice", "keep one")
    for child in element:
        if child.tag in _ONCE:
            _check_once(child, f"{where}/{child.tag}", path)
        elif child.tag == "geometry" and len(child) - len(child.findall("material")) > 1:
            what, remedy = f"holds {len(child)} solids", f"give each a <{element.tag}> of its own"
            raise robot_error(path, f"{where}/geometry", what, remedy)


def _check_joint(joint: Element, where: str, path: Path) -> None:
    kind = joint.get("type")
    if kind in {"floating", "planar"}:
        what = f"is {kind}; only joints with one coordinate are modelled"
        raise robot_error(path, where, what, "fix it, or let the base float with base: floating")
    if kind != "fixed" and kind not in MOVING:
        raise robot_error(path, where, f"has the type {kind!r}", "use one of fixed, " + ", ".join(MOVING))
    read_origin(joint, path, where)
    if kind == "fixed":
        return
    if joint.get("name") == "universe":  # pinocchio's first joint, which it finds in its place
        what = "is called as readers call what the robot stands on"
        raise robot_error(path, where, what, "rename the joint")
    for axis in joint.findall("axis"):
        direction = np.array(read_numbers(axis, "xyz", 3, path, f"{where}/axis"))
        if not 1e-6 < np.linalg.norm(direction) < 1e6:
            what = f"is {axis.get('xyz')!r}, which is no direction"
            raise robot_error(path, f"{where}/axis", what, "give a vector of length 1")
    for dynamics in joint.findall("dynamics"):
        for attribute in ("damping", "friction"):
            read_number(dynamics, attribute, path, f"{where}/dynamics", default="0")
    limit = joint.find("limit")
    if limit is not None:
        _check_limit(joint, limit, f"{where}/limit", path)


def _check_limit(joint: Element, limit: Element, where: str, path: Path) -> None:
    for attribute in ("effort", "velocity"):
        value = read_number(limit, attribute, path, where, default="0")
        if 0.0 < value < 1.0 / MAX_STAND_IN:
            remedy = "check its exponent, or leave it out where none is known"
            raise robot_error(
                path, f"{where}@{attribute}", f"is {value:g}, less than any drive gives", remedy
            )
        if value == -1.0:  # how some say that there is none, as of the EVE
            limit.attrib.pop(attribute)
        elif value < 0.0:
            raise robot_error(path, f"{where}@{attribute}", f"is {value}", "give a positive number")
    lower, upper = (read_number(limit, side, path, where, default="0") for side in ("lower", "upper"))
    if lower > upper:
        remedy = f'exchange them: lower="{upper}" upper="{lower}", or correct them'
        raise robot_error(path, where, f"lower {lower} is above upper {upper}", remedy)
    slides, most = joint.get("type") == "prismatic", max(-lower, upper)
    if joint.get("type") == "continuous":
        return
    # How exporters say that a joint has no end, such as the slides that the wheels of a mobile base make.
    if slides and most > MAX_TRAVEL_STAND_IN:
        for side in ("lower", "upper"):
            limit.attrib.pop(side, None)
    elif not slides and most > MAX_ANGLE:
        joint.set("type", "continuous")
    else:
        check_range(joint.get("name", ""), (lower, upper), slides, where, path)


def _check_roots(links: list[str], tree: LinkTree, path: Path) -> None:
    depths: dict[str, int] = {}
    for link in links:
        way = [link, *(tree.ends[joint][0] for joint in tree.above(link))]
        if way[-1] in tree.carriers:
            loop = way[way.index(way[-1]) : -1]
            what = f"is its own ancestor (closed loop of {first_names(loop, 5)})"
            remedy = "cut the loop; closed loops are not modelled"
            raise robot_error(path, f"link {way[-1]!r}", what, remedy)
        depths[link] = len(way) - 1
    roots = [link for link, depth in depths.items() if not depth]
    if len(roots) > 1:
        what = f"has {len(roots)} root links: {', '.join(roots[:5])}"
        raise robot_error(path, "robot", what, "join them by a fixed joint or remove the loose ones")
    deepest = max(links, key=depths.__getitem__)
    if depths[deepest] > MAX_DEPTH:
        what = f"lies {depths[deepest]} joints from the root, more than {MAX_DEPTH}"
        raise robot_error(path, f"link {deepest!r}", what, "shorten the chain")


# What a URDF's root says of the base: free, or on wheels, by its joint's type, or fixed to a world of its
# own.

WORLD = "world"


class RootJoint(NamedTuple):
    """A joint that carries the whole robot, and the bare link that it hangs on."""

    joint: Element
    link: Element


def root_joint(root: Element, kind: str) -> RootJoint | None:
    """The joint of a type, ``floating`` or ``planar``, that carries the whole robot; None where there is none."""
    joints = root.findall("joint")
    for joint in (one for one in joints if one.get("type") == kind):
        above = link_at(joint, "parent")
        ends = {link_at(one, end) for one in joints if one is not joint for end in ("parent", "child")}
        links = [link for link in root.findall("link") if link.get("name") == above]
        bare = all(link.find(part) is None for link in links for part in ("inertial", *GEOMETRY))
        if above not in ends and len(links) == 1 and bare:
            return RootJoint(joint, links[0])
    return None


def settle_root(root: Element) -> None:
    """Take a free base's joint and its bare link out, which is for a ``robot.yaml`` to say, and fix a planar joint.

    That stands for wheels, which are held still as others are.
    """
    for element in root_joint(root, "floating") or ():
        root.remove(element)
    planar = root_joint(root, "planar")
    if planar is not None:
        planar.joint.set("type", "fixed")


def declare_world(root: Element) -> bool:
    """Declare the link ``world`` where a robot is fixed to it and the file lacks it: Drake knows it by its name.

    Returns:
        Whether it was lacking.
    """
    ends = {link_at(joint, "parent") for joint in root.findall("joint") if joint.get("type") == "fixed"}
    lacking = WORLD in ends and root.find(f"link[@name='{WORLD}']") is None
    if lacking:
        root.insert(0, Element("link", name=WORLD))
    return lacking
