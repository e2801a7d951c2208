"""Limits of joints that stand elsewhere than in a URDF's ``<limit>``: in its own elements, and in MoveIt's file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from excite.errors import RobotError
from excite.finding import first_names
from excite.formats.documents import check_content, read_yaml
from excite.results import Assumed
from excite.robot.description import PositionTable
from excite.robot.quantities import MAX_ANGLE
from excite.robot.refusal import robot_error
from excite.robot.urdf.numbers import read_numbers

SOFT, CONTROL = "<safety_controller>", "<ros2_control>"
_FILE = "joint_limits.yaml"
# Wider than this is a whole turn, as no range is written: ±3.14 is one less 0.05 % [rad].
_TURN = 0.99 * 2.0 * math.pi
# Attributes of <limit> beside lower and upper; MoveIt's file calls the second effort, too.
_LARGEST = ("velocity", "effort", "acceleration", "jerk")


@dataclass(frozen=True)
class JointLimits:
    """What is stated of one joint; None of what is not.

    Attributes:
        range: of its position [rad or m].
        velocity: [rad/s or m/s]
        effort: [N·m or N]
        acceleration: [rad/s² or m/s²]
        jerk: [rad/s³ or m/s³]
    """

    range: tuple[float, float] | None = None
    velocity: float | None = None
    effort: float | None = None
    acceleration: float | None = None
    jerk: float | None = None


def stated_ranges(root: Element, path: Path) -> dict[str, tuple[float, float]]:
    """Ranges by joint of those that are ``continuous`` and yet state one of less than a turn [rad].

    The format has no limits for such joints and readers ignore them, but Cassie's and Digit's state where their knees
    end. Equal limits, such as exporters' zeros, and those of a turn or more are none.

    Args:
        root: the ``robot`` element.
        path: its file, for the error.

    Raises:
        RobotError: a limit is no finite number.
    """
    found = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if joint.get("type") != "continuous" or limit is None or not {"lower", "upper"} <= set(limit.attrib):
            continue
        where = f"joint {joint.get('name')!r}/limit"
        lower, upper = (read_numbers(limit, side, 1, path, where)[0] for side in ("lower", "upper"))
        if 0.0 < upper - lower < _TURN:
            found[joint.get("name", "")] = (lower, upper)
    return found


def keep_stated_limits(root: Element, path: Path) -> dict[str, dict[str, list[str]]]:
    """Write into ``<limit>`` what other elements of the file say, so that every reader keeps within it.

    Continuous joints that state a range of less than a turn become revolute. The soft limits of a
    ``<safety_controller>``, at which ROS' controllers begin to brake, and the ``min`` and ``max`` of commands in
    ``<ros2_control>`` hold where they are the tighter ones.

    Args:
        root: the ``robot`` element.
        path: its file, for errors.

    Returns:
        Joints by what was tightened (``position``, ``velocity``, ``effort``), by the element that says it.

    Raises:
        RobotError: a limit is no finite number, or leaves no range.
    """
    ranged = stated_ranges(root, path)
    for joint in root.findall("joint"):
        if joint.get("name") in ranged:
            joint.set("type", "revolute")
    found = {SOFT: dict(_soft_limits(root, path)), CONTROL: dict(_command_limits(root, path))}
    tightened = {said: tighten(root, limits, path, said) for said, limits in found.items()}
    return {said: joints for said, joints in tightened.items() if joints}


def tighten(root: Element, limits: Mapping[str, JointLimits], path: Path, said: str) -> dict[str, list[str]]:
    """Write limits into ``<limit>`` where they are tighter than what stands there, or nothing does.

    Args:
        root: the ``robot`` element.
        limits: by joint.
        path: its file, for errors.
        said: where the limits stand.

    Returns:
        Joints by what was tightened.

    Raises:
        RobotError: a limit in the file is no finite number, or nothing is left of a range.
    """
    changed: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        one = limits.get(name)
        if one is None or joint.get("type") not in {"revolute", "continuous", "prismatic"}:
            continue
        limit = joint.find("limit")
        if limit is None:
            limit = SubElement(joint, "limit")
        if one.range is not None and _narrow(joint, limit, one.range, path, said):
            changed.setdefault("position", []).append(name)
        for key in _LARGEST:
            value = getattr(one, key)
            (stated,) = read_numbers(limit, key, 1, path, f"joint {name!r}/limit", default="0")
            if value is not None and value > 0.0 and not 0.0 < stated <= value:
                limit.set(key, repr(value))
                changed.setdefault(key, []).append(name)
    return changed


def _narrow(joint: Element, limit: Element, stated: tuple[float, float], path: Path, said: str) -> bool:
    """Narrow a joint's range to one that is stated elsewhere; whether that changed it."""
    where = f"joint {joint.get('name')!r}/limit"
    lower, upper = stated
    if joint.get("type") == "continuous" or not {"lower", "upper"} <= set(limit.attrib):
        if joint.get("type") != "prismatic":
            # The end that is not stated is a turn away, or half a turn from zero.
            lower = min(-math.pi, upper - math.tau) if math.isinf(lower) else lower
            upper = max(math.pi, lower + math.tau) if math.isinf(upper) else upper
        if max(-lower, upper) > MAX_ANGLE:
            return False
        joint.set("type", "prismatic" if joint.get("type") == "prismatic" else "revolute")
    else:
        low, high = (read_numbers(limit, side, 1, path, where)[0] for side in ("lower", "upper"))
        # What is the wrong way round there is refused where the tree is checked; equal ends are no range.
        if low >= high or (low >= lower and high <= upper):
            return False
        lower, upper = max(low, lower), min(high, upper)
        if lower >= upper:
            what = f"{low:g} … {high:g} has nothing in common with {stated[0]:g} … {stated[1]:g} of {said}"
            remedy = f"correct one of them, or remove that of {said}"
            raise robot_error(path, where, what, remedy)
    limit.set("lower", repr(lower))
    limit.set("upper", repr(upper))
    return True


def _soft_limits(root: Element, path: Path) -> Iterator[tuple[str, JointLimits]]:
    for joint in root.findall("joint"):
        soft, name = joint.find("safety_controller"), joint.get("name", "")
        if soft is None:
            continue
        where = f"joint {name!r}/safety_controller"
        both = _range(*(_stated_end(soft, f"soft_{side}_limit", path, where) for side in ("lower", "upper")))
        if both is not None and both[0] < both[1]:
            yield name, JointLimits(both)


def _command_limits(root: Element, path: Path) -> Iterator[tuple[str, JointLimits]]:
    for joint in root.iterfind("ros2_control/joint"):
        name, found = joint.get("name", ""), dict[str, Any]()
        for command in joint.findall("command_interface"):
            kind = command.get("name", "")
            ends = {param.get("name"): (param.text or "").strip() for param in command.findall("param")}
            if kind not in {"position", "velocity", "effort"}:
                continue
            where = f"ros2_control joint {name!r}/{kind}"
            bounds = Element("param", {end: ends[end] for end in ("min", "max") if ends.get(end)})
            both = _range(*(_stated_end(bounds, end, path, where) for end in ("min", "max")))
            if both is not None and both[0] < both[1]:
                found["range" if kind == "position" else kind] = (
                    both if kind == "position" else symmetric(*both)
                )
        if found:
            yield name, JointLimits(**found)


def _stated_end(element: Element, name: str, path: Path, where: str) -> float | None:
    """A number in an attribute, None where there is none; raises RobotError."""
    return read_numbers(element, name, 1, path, where)[0] if name in element.attrib else None


def _range(lower: float | None, upper: float | None) -> tuple[float, float] | None:
    """The range between two ends of which one may not be stated; None where neither is."""
    if lower is None and upper is None:
        return None
    return (-math.inf if lower is None else lower, math.inf if upper is None else upper)


def symmetric(low: float, high: float) -> float:
    """The largest magnitude that is allowed either way; of bounds on one side of zero the larger that is finite."""
    if low < 0.0 < high:
        return min(-low, high)
    return max(abs(end) for end in (low, high) if math.isfinite(end))


def joint_limits_beside(path: Path) -> list[Path]:
    """MoveIt's files of joint limits beside a model: in ``config`` of its package, and of packages of MoveIt beside it.

    Where no ``package.xml`` says where a package begins, it is ``config`` of the model's folder or of the one above.
    """
    above = path.resolve().parents
    package = next((folder for folder in above if (folder / "package.xml").is_file()), None)
    folders = [*above[:2]] if package is None else [package, *sorted(package.parent.glob("*_moveit_config"))]
    files = [folder / "config" / _FILE for folder in folders]
    return [file for file in files if file.is_file()]


def read_joint_limits(file: Path, names: Iterable[str]) -> dict[str, JointLimits]:
    """Limits of a robot's joints in a file of MoveIt's kind, ``joint_limits.yaml``.

    Joints may be called without the ``_joint`` of their names, and angles tagged ``!degrees``, as in UR's.

    Args:
        file: the file.
        names: of the robot's joints; others do not count.

    Raises:
        RobotError: it is no such file, or a limit is no number, or is the wrong way round.
    """
    content = read_yaml(file, error=RobotError, degrees=True, remedy=f"give MoveIt's {_FILE}")
    joints = content.get("joint_limits", {} if "by_position" in content else None)
    if not isinstance(joints, dict):
        raise robot_error(file, None, "has no mapping joint_limits", f"give MoveIt's {_FILE}")
    found = {}
    for name in names:
        block = joints.get(name, joints.get(name.removesuffix("_joint")))
        if isinstance(block, dict):
            found[name] = _of_block(block, file, name)
    return found


def read_position_tables(file: Path, names: Iterable[str]) -> list[PositionTable]:
    """Limits that depend on positions in such a file: ``by_position``, a list as that of a ``robot.yaml``.

    Args:
        file: the file.
        names: of the robot's joints, which may be called without the ``_joint`` of theirs.

    Raises:
        RobotError: a table is none, or is of a joint that the robot does not have.
    """
    remedy = (
        "write it as limits.by_position of a robot.yaml: joint, quantity, at, and limit or lower and upper"
    )
    blocks = read_yaml(file, error=RobotError, degrees=True, remedy=remedy).get("by_position", [])
    if not isinstance(blocks, list) or not all(isinstance(block, dict) for block in blocks):
        raise RobotError("is no list of tables", source=file, field="by_position", remedy=remedy)
    known, found = {short: name for name in names for short in (name, name.removesuffix("_joint"))}, []
    for block in blocks:
        table = check_content(
            PositionTable, {"source": file.name, **block}, file, remedy=remedy, error=RobotError
        )
        lost = {table.joint, table.over or table.joint} - set(known)
        if lost:
            what, has = f"no joint {min(lost)!r} in the model", ", ".join(names)
            raise RobotError(what, source=file, field="by_position", remedy=f"the model has {has}")
        over = None if table.over is None else known[table.over]
        found.append(table.model_copy(update={"joint": known[table.joint], "over": over}))
    return found


def _of_block(block: Mapping[str, Any], file: Path, name: str) -> JointLimits:
    def value(key: str, has: str) -> float | None:
        if key not in block or block.get(f"has_{has}_limits", True) is False:
            return None
        number = block[key]
        if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
            field = f"joint_limits.{name}.{key}"
            raise robot_error(file, field, f"is {str(number)[:40]!r}, no number", "give one")
        return float(number)

    lower, upper = value("min_position", "position"), value("max_position", "position")
    both = _range(lower, upper)
    if both is not None and both[0] >= both[1]:
        what, remedy = (
            f"min_position {both[0]:g} is not below max_position {both[1]:g}",
            "exchange or correct them",
        )
        raise robot_error(file, f"joint_limits.{name}", what, remedy)
    return JointLimits(both, *(value(f"max_{key}", key) for key in _LARGEST))


def with_tables(tightened: Mapping[str, list[str]], tables: Iterable[PositionTable]) -> dict[str, list[str]]:
    """What was tightened by what, and the joints of tables by the quantity that depends on a position there."""
    found = {what: list(joints) for what, joints in tightened.items()}
    for table in tables:
        joints = found.setdefault(f"{table.quantity} by position", [])
        joints += [table.joint] if table.joint not in joints else []
    return found


def assumed_limits(tightened: Mapping[str, Mapping[str, list[str]]]) -> tuple[Assumed, ...]:
    """What to say of limits that were taken from elsewhere, by where they stand and what was tightened."""
    return tuple(
        Assumed(
            what=f"limits of {said}",
            value="; ".join(f"{what} of {first_names(joints)}" for what, joints in changed.items()),
            consequence="tighter than the model's own, or the only ones: motions stay within them",
        )
        for said, changed in tightened.items()
        if changed
    )
