"""Links and joints of a URDF: names, types, axes and limits, and that they form one tree."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from excite.errors import RobotError
from excite.formats.documents import all_alike
from excite.robot.joint_values import check_range
from excite.robot.quantities import MAX_ANGLE, MAX_STAND_IN, MAX_TRAVEL_STAND_IN
from excite.robot.refusal import robot_error
from excite.robot.urdf.inertia import check_geometry, check_origin
from excite.robot.urdf.numbers import read_numbers, shorten_text

MOVING = ("revolute", "continuous", "prismatic")
MAX_LINKS = 2000
# The largest known, a mobile robot with two arms and hands, has 101 and 112; every solid is compared with every
# other one, in 100 postures: these bounds keep that below half a minute.
MAX_MOVING = 200
MAX_SOLIDS = 400
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


def check_tree(root: ElementTree.Element, path: Path) -> dict[str, ElementTree.Element]:
    """Check links and joints of a ``robot`` element.

    Returns:
        The joints by name, in the file's order.

    Raises:
        RobotError: duplicated or missing names, unknown links or joint types, an impossible axis, origin
            or limit, several roots, closed loops, or a tree too large or too deep.
    """
    if not root.get("name", "").strip():
        raise robot_error(path, "robot@name", "is missing", "name the robot")
    _check_name(root.get("name", ""), "robot@name", path)
    links = _named_elements(root, "link", path)
    joints = _named_elements(root, "joint", path)
    if not links:
        raise robot_error(path, "robot", "has no <link>", "describe at least one")
    if len(links) > MAX_LINKS:
        what = f"has {len(links)} links, more than {MAX_LINKS}"
        raise robot_error(path, "robot", what, "reduce the model")
    for kind, elements in (("link", links), ("joint", joints)):
        for name, element in elements.items():
            _check_once(element, f"{kind} {name!r}", path)
            _check_flat(element, f"{kind} {name!r}", path)
    parents: dict[str, str] = {}
    carriers: dict[str, str] = {}
    for name, joint in joints.items():
        parent, child = (_joint_end(joint, name, end, links, path) for end in ("parent", "child"))
        if child in carriers:
            raise robot_error(
                path,
                f"link {child!r}",
                f"is the child of two joints, {carriers[child]!r} and {name!r}: a closed loop",
                "cut the loop by removing one of them; closed loops are not modelled",
            )
        parents[child], carriers[child] = parent, name
        _check_joint(joint, name, path)
    _check_roots(links, parents, path)
    _check_count(root, path)
    for name, link in links.items():
        check_geometry(link, name, path)
    return joints


def link_at(joint: ElementTree.Element, end: str) -> str:
    """Name of the link at a joint's ``end``, ``parent`` or ``child``; empty where the joint names none."""
    element = joint.find(end)
    return "" if element is None else str(element.get("link"))


def _named_elements(root: ElementTree.Element, tag: str, path: Path) -> dict[str, ElementTree.Element]:
    found: dict[str, ElementTree.Element] = {}
    for number, element in enumerate(root.findall(tag)):
        name = element.get("name", "")
        if not name.strip():
            raise robot_error(path, f"{tag} {number}", "has no name", "name it")
        _check_name(name, f"{tag} {number}", path)
        if name in found:
            raise robot_error(path, f"{tag} {name!r}", "occurs twice", "rename one of them")
        found[name] = element
    return found


def _check_count(root: ElementTree.Element, path: Path) -> None:
    moving = sum(joint.get("type") in MOVING for joint in root.findall("joint"))
    solids = {kind: len(root.findall(f"link/{kind}")) for kind in ("collision", "visual")}
    for what, number, most in (
        ("joints that move", moving, MAX_MOVING),
        *((f"{kind} elements", number, MAX_SOLIDS) for kind, number in solids.items()),
    ):
        if number > most:
            what = f"has {number} {what}, more than {most}"
            raise robot_error(path, "robot", what, "reduce the model")


def _check_name(name: str, where: str, path: Path) -> None:
    if len(name) > MAX_NAME or not name.isprintable():
        what = f"has the name {shorten_text(name)!r}"
        remedy = f"give it a name of at most {MAX_NAME} printable characters"
        raise robot_error(path, where, what, remedy)


def _check_once(element: ElementTree.Element, where: str, path: Path) -> None:
    for tag in _ONCE.get(element.tag, ()):
        found = element.findall(tag)
        # Published models of real arms have a mount with two: where that stands changes no torque.
        mount = tag == "origin" and element.tag == "joint" and element.get("type") == "fixed"
        if not mount and not all_alike(found):
            raise robot_error(path, f"{where}/{tag}", "occurs twice", "keep one")
    for child in element:
        if child.tag in _ONCE:
            _check_once(child, f"{where}/{child.tag}", path)
        elif child.tag == "geometry" and len(child) - len(child.findall("material")) > 1:
            raise robot_error(
                path,
                f"{where}/geometry",
                f"holds {len(child)} solids",
                f"give each a <{element.tag}> of its own",
            )


def _check_flat(element: ElementTree.Element, where: str, path: Path) -> None:
    """Readers pass over a link or joint inside another one."""
    for inside in element.iter():
        if inside is not element and inside.tag in {"link", "joint"}:
            what = f"holds the {inside.tag} {shorten_text(inside.get('name', ''))!r}"
            raise robot_error(path, where, what, "put it beside, not inside")


def _joint_end(
    joint: ElementTree.Element, name: str, end: str, links: dict[str, ElementTree.Element], path: Path
) -> str:
    element = joint.find(end)
    link = None if element is None else element.get("link")
    where = f"joint {name!r}/{end}"
    if link is None:
        raise robot_error(path, where, "is missing", f"name the {end} link")
    if link not in links:
        raise robot_error(path, where, f"unknown link {link!r}", f"define the link {link!r}")
    return link


def _check_joint(joint: ElementTree.Element, name: str, path: Path) -> None:
    where, kind = f"joint {name!r}", joint.get("type")
    if kind in {"floating", "planar"}:
        what = f"is {kind}; only joints with one coordinate are modelled"
        raise robot_error(path, where, what, "fix it, or let the base float with base: floating")
    if kind != "fixed" and kind not in MOVING:
        raise robot_error(path, where, f"has the type {kind!r}", "use one of fixed, " + ", ".join(MOVING))
    check_origin(joint, where, path)
    if kind == "fixed":
        return
    if name == "universe":  # pinocchio's first joint, which it finds in its place
        what, remedy = "is called as readers call what the robot stands on", "rename the joint"
        raise robot_error(path, where, what, remedy)
    axis = joint.find("axis")
    if axis is not None:
        direction = np.array(read_numbers(axis, "xyz", 3, path, f"{where}/axis"))
        if not 1e-6 < np.linalg.norm(direction) < 1e6:
            what = f"is {axis.get('xyz')!r}, which is no direction"
            raise robot_error(path, f"{where}/axis", what, "give a vector of length 1")
    dynamics = joint.find("dynamics")
    if dynamics is not None:
        for attribute in ("damping", "friction"):
            read_numbers(dynamics, attribute, 1, path, f"{where}/dynamics", default="0")
    limit = joint.find("limit")
    if limit is not None:
        _check_limit(joint, limit, f"{where}/limit", path)


def _check_limit(joint: ElementTree.Element, limit: ElementTree.Element, where: str, path: Path) -> None:
    for attribute in ("effort", "velocity"):
        (value,) = read_numbers(limit, attribute, 1, path, where, default="0")
        if 0.0 < value < 1.0 / MAX_STAND_IN:
            fault = {
                "field": f"{where}@{attribute}",
                "remedy": "check its exponent, or leave it out where none is known",
            }
            raise RobotError(f"is {value:g}, less than any drive gives", source=path, **fault)
        if value == -1.0:  # how some say that there is none, as of the EVE
            limit.attrib.pop(attribute)
        elif value < 0.0:
            fault = {"field": f"{where}@{attribute}", "remedy": "give a positive number"}
            raise RobotError(f"is {value}", source=path, **fault)
    lower, upper = (read_numbers(limit, side, 1, path, where, default="0")[0] for side in ("lower", "upper"))
    if lower > upper:
        fault = {"field": where, "remedy": f'exchange them: lower="{upper}" upper="{lower}", or correct them'}
        raise RobotError(f"lower {lower} is above upper {upper}", source=path, **fault)
    if joint.get("type") == "continuous":
        return
    if joint.get("type") == "revolute" and max(-lower, upper) > MAX_ANGLE:
        # How exporters say that it turns without end.
        joint.set("type", "continuous")
    elif joint.get("type") == "prismatic" and max(-lower, upper) > MAX_TRAVEL_STAND_IN:
        # How they say it of a slide, such as the wheels of a mobile base make.
        for side in ("lower", "upper"):
            limit.attrib.pop(side, None)
    else:
        check_range(joint.get("name", ""), (lower, upper), joint.get("type") == "prismatic", where, path)


def _check_roots(links: dict[str, ElementTree.Element], parents: dict[str, str], path: Path) -> None:
    depth: dict[str, int] = {}
    for link in links:
        chain, seen = list[str](), set[str]()
        while link in parents and link not in depth and link not in seen:
            chain.append(link)
            seen.add(link)
            link = parents[link]
        if link in seen:
            loop = chain[chain.index(link) :]
            names = ", ".join(loop[:5]) + (", …" if len(loop) > 5 else "")
            raise robot_error(
                path,
                f"link {link!r}",
                f"is its own ancestor (closed loop of {names})",
                "cut the loop; closed loops are not modelled",
            )
        start = depth.setdefault(link, 0)
        for steps, above in enumerate(reversed(chain), start=1):
            depth[above] = start + steps
    roots = [link for link in links if link not in parents]
    if len(roots) > 1:
        raise robot_error(
            path,
            "robot",
            f"has {len(roots)} root links: {', '.join(roots[:5])}",
            "join them by a fixed joint or remove the loose ones",
        )
    deepest = max(depth, key=lambda link: depth[link])
    if depth[deepest] > MAX_DEPTH:
        what = f"lies {depth[deepest]} joints from the root, more than {MAX_DEPTH}"
        raise robot_error(path, f"link {deepest!r}", what, "shorten the chain")


# What a URDF's root says of the base: free, or on wheels, by its joint's type, or fixed to a world of its
# own.

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
