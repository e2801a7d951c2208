"""Links and joints of a URDF: names, types, axes and limits, and that they form one tree."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from excite.errors import RobotError
from excite.robot.quantities import ANGLE, GAIN, LENGTH, OFFSET, SCALE, endless, looks_like_degrees
from excite.robot.urdf_numbers import numbers, single

MOVING = ("revolute", "continuous", "prismatic")
MAX_LINKS = 2000
MAX_DEPTH = 200


def check_tree(root: ElementTree.Element, path: Path) -> dict[str, ElementTree.Element]:
    """Check links and joints of a ``robot`` element.

    Returns:
        The joints by name, in the file's order.

    Raises:
        RobotError: duplicated or missing names, unknown links or joint types, an impossible axis, origin
            or limit, several roots, closed loops, or a tree too large or too deep.
    """
    if not root.get("name", "").strip():
        raise RobotError("is missing", source=path, field="robot@name", remedy="name the robot")
    links = _named(root, "link", path)
    joints = _named(root, "joint", path)
    if not links:
        raise RobotError("has no <link>", source=path, field="robot", remedy="describe at least one")
    if len(links) > MAX_LINKS:
        what = f"has {len(links)} links, more than {MAX_LINKS}"
        raise RobotError(what, source=path, field="robot", remedy="reduce the model")
    parents: dict[str, str] = {}
    carriers: dict[str, str] = {}
    for name, joint in joints.items():
        parent, child = (_end(joint, name, end, links, path) for end in ("parent", "child"))
        if child in carriers:
            raise RobotError(
                f"is the child of two joints, {carriers[child]!r} and {name!r}: a closed loop",
                source=path,
                field=f"link {child!r}",
                remedy="cut the loop by removing one of them; closed loops are not modelled",
            )
        parents[child], carriers[child] = parent, name
        _check_joint(joint, name, path)
    _check_roots(links, parents, path)
    for name, link in links.items():
        _check_geometry(link, name, path)
    return joints


def _named(root: ElementTree.Element, tag: str, path: Path) -> dict[str, ElementTree.Element]:
    found: dict[str, ElementTree.Element] = {}
    for number, element in enumerate(root.findall(tag)):
        name = element.get("name", "")
        if not name.strip():
            raise RobotError("has no name", source=path, field=f"{tag} {number}", remedy="name it")
        if name in found:
            raise RobotError(
                "occurs twice", source=path, field=f"{tag} {name!r}", remedy="rename one of them"
            )
        found[name] = element
    return found


def _end(
    joint: ElementTree.Element, name: str, end: str, links: dict[str, ElementTree.Element], path: Path
) -> str:
    element = single(joint, end, path, f"joint {name!r}")
    link = None if element is None else element.get("link")
    where = f"joint {name!r}/{end}"
    if link is None:
        raise RobotError("is missing", source=path, field=where, remedy=f"name the {end} link")
    if link not in links:
        raise RobotError(
            f"unknown link {link!r}", source=path, field=where, remedy=f"define the link {link!r}"
        )
    return link


def _check_joint(joint: ElementTree.Element, name: str, path: Path) -> None:
    where, kind = f"joint {name!r}", joint.get("type")
    if kind in {"floating", "planar"}:
        what = f"is {kind}; only joints with one coordinate are modelled"
        raise RobotError(
            what, source=path, field=where, remedy="fix it, or let the base float with base: floating"
        )
    if kind != "fixed" and kind not in MOVING:
        raise RobotError(
            f"has the type {kind!r}",
            source=path,
            field=where,
            remedy="use one of fixed, " + ", ".join(MOVING),
        )
    _check_origin(joint, where, path)
    if kind == "fixed":
        return
    axis = single(joint, "axis", path, where)
    if axis is not None:
        direction = np.array(numbers(axis, "xyz", 3, path, f"{where}/axis"))
        if not 1e-6 < np.linalg.norm(direction) < 1e6:
            what = f"is {axis.get('xyz')!r}, which is no direction"
            raise RobotError(what, source=path, field=f"{where}/axis", remedy="give a vector of length 1")
    dynamics = single(joint, "dynamics", path, where)
    for attribute in ("damping", "friction"):
        if dynamics is not None:
            numbers(dynamics, attribute, 1, path, f"{where}/dynamics", default="0", quantity=GAIN)
    limit = single(joint, "limit", path, where)
    if limit is not None:
        _check_limit(limit, str(kind), f"{where}/limit", path)


def _check_limit(limit: ElementTree.Element, kind: str, where: str, path: Path) -> None:
    for attribute in ("effort", "velocity"):
        (value,) = numbers(limit, attribute, 1, path, where, default="0")
        if value < 0.0:
            remedy = "give a positive number"
            raise RobotError(f"is {value}", source=path, field=f"{where}@{attribute}", remedy=remedy)
    lower, upper = (numbers(limit, side, 1, path, where, default="0")[0] for side in ("lower", "upper"))
    if lower > upper:
        what = f"lower {lower} is above upper {upper}"
        raise RobotError(what, source=path, field=where, remedy="exchange or correct them")
    if kind == "revolute" and looks_like_degrees(lower, upper):
        raise RobotError(
            f"from {lower:g} to {upper:g} looks like degrees",
            source=path,
            field=where,
            remedy="give radians; make a joint of many turns continuous and state its limits in robot.yaml",
        )
    if kind == "prismatic" and not endless(lower, upper):
        for side in ("lower", "upper"):
            numbers(limit, side, 1, path, where, default="0", quantity=OFFSET)


def _check_origin(element: ElementTree.Element, where: str, path: Path) -> None:
    origin = single(element, "origin", path, where)
    if origin is not None:
        for attribute, quantity in (("xyz", OFFSET), ("rpy", ANGLE)):
            numbers(origin, attribute, 3, path, f"{where}/origin", default="0 0 0", quantity=quantity)


def _check_roots(links: dict[str, ElementTree.Element], parents: dict[str, str], path: Path) -> None:
    depth: dict[str, int] = {}
    for link in links:
        chain: list[str] = []
        seen: set[str] = set()
        while link in parents and link not in depth and link not in seen:
            chain.append(link)
            seen.add(link)
            link = parents[link]
        if link in seen:
            loop = chain[chain.index(link) :]
            names = ", ".join(loop[:5]) + (", …" if len(loop) > 5 else "")
            raise RobotError(
                f"is its own ancestor (closed loop of {names})",
                source=path,
                field=f"link {link!r}",
                remedy="cut the loop; closed loops are not modelled",
            )
        start = depth.setdefault(link, 0)
        for steps, above in enumerate(reversed(chain), start=1):
            depth[above] = start + steps
    roots = [link for link in links if link not in parents]
    if len(roots) > 1:
        raise RobotError(
            f"has {len(roots)} root links: {', '.join(roots[:5])}",
            source=path,
            field="robot",
            remedy="join them by a fixed joint or remove the loose ones",
        )
    deepest = max(depth, key=lambda link: depth[link])
    if depth[deepest] > MAX_DEPTH:
        what = f"lies {depth[deepest]} joints from the root, more than {MAX_DEPTH}"
        raise RobotError(what, source=path, field=f"link {deepest!r}", remedy="shorten the chain")


def _check_geometry(link: ElementTree.Element, name: str, path: Path) -> None:
    for kind in ("collision", "visual"):
        for number, element in enumerate(link.findall(kind)):
            where = f"link {name!r}/{kind} {number}"
            _check_origin(element, where, path)
            for solid in element.iterfind("geometry/*"):
                _check_solid(solid, where, path)


def _check_solid(solid: ElementTree.Element, where: str, path: Path) -> None:
    lengths: dict[str, tuple[tuple[str, int, str | None], ...]] = {
        "box": (("size", 3, None),),
        "sphere": (("radius", 1, None),),
        "cylinder": (("radius", 1, None), ("length", 1, None)),
        "capsule": (("radius", 1, None), ("length", 1, None)),
        "mesh": (("scale", 3, "1 1 1"),),
    }
    where = f"{where}/{solid.tag}"
    for attribute, count, default in lengths.get(solid.tag, ()):
        quantity = SCALE if solid.tag == "mesh" else LENGTH
        values = numbers(solid, attribute, count, path, where, default=default, quantity=quantity)
        # A mesh may be mirrored by a negative scale, and scaled to nothing by none.
        if any(value == 0.0 if solid.tag == "mesh" else value <= 0.0 for value in values):
            what = f"is {solid.get(attribute)!r}"
            raise RobotError(what, source=path, field=f"{where}@{attribute}", remedy="give lengths above 0")
