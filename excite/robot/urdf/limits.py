"""Limits of joints that stand elsewhere than in a URDF's ``<limit>``: in its own elements, and in MoveIt's file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from excite.errors import RobotError, raised_as
from excite.finding import first_names
from excite.formats.documents import check_content, read_yaml
from excite.results import Assumed
from excite.robot.description import PositionTable
from excite.robot.quantities import MAX_ANGLE
from excite.robot.refusal import robot_error
from excite.robot.urdf.numbers import read_number

SOFT, CONTROL = "<safety_controller>", "<ros2_control>"
_FILE = "joint_limits.yaml"
# Wider than this is a whole turn, as no range is written: ±3.14 is one less 0.05 % [rad].
_TURN = 0.99 * 2.0 * math.pi
# Attributes of <limit> beside lower and upper; MoveIt's file calls the second effort, too.
LARGEST = ("velocity", "effort", "acceleration", "jerk")
# Keys of a joint in MoveIt's and ros2_control's files, by what they bound; each has a switch of its quantity.
_BOUNDS = {
    **{"min_position": "lower", "max_position": "upper"},
    **{"soft_lower_limit": "lower", "soft_upper_limit": "upper", "max_deceleration": "acceleration"},
    **{f"max_{quantity}": quantity for quantity in LARGEST},
}


Limits = dict[str, dict[str, Any]]
"""By joint what is stated of it: ``position`` a range [rad or m], the rest the largest magnitude [SI]."""


def stated_ranges(root: Element, path: Path) -> list[str]:
    """Joints that are ``continuous`` and yet state a range of less than a turn.

    The format has no limits for such joints and readers ignore them, but Cassie's and Digit's state where their knees
    end. Equal limits, such as exporters' zeros, and those of a turn or more are none.

    Args:
        root: the ``robot`` element.
        path: its file, for the error.

    Raises:
        RobotError: a limit is no finite number.
    """
    found = []
    for joint in root.findall("joint"):
        where, limit = f"joint {joint.get('name')!r}/limit", joint.find("limit")
        if (
            joint.get("type") == "continuous"
            and limit is not None
            and {"lower", "upper"} <= set(limit.attrib)
        ):
            lower, upper = (read_number(limit, side, path, where) for side in ("lower", "upper"))
            if 0.0 < upper - lower < _TURN:
                found.append(joint.get("name", ""))
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
    ranged, found = stated_ranges(root, path), {SOFT: Limits(), CONTROL: Limits()}
    for joint in root.findall("joint"):
        name, soft = joint.get("name", ""), joint.find("safety_controller")
        if name in ranged:
            joint.set("type", "revolute")
        keys = ("soft_lower_limit", "soft_upper_limit")
        both = None if soft is None else _range_of(soft, keys, path, f"joint {name!r}/safety_controller")
        if both is not None:
            found[SOFT][name] = {"position": both}
    for joint in root.iterfind("ros2_control/joint"):
        name = joint.get("name", "")
        for command in joint.findall("command_interface"):
            kind = command.get("name", "")
            texts = {param.get("name", ""): (param.text or "").strip() for param in command.findall("param")}
            ends = Element("param", {end: text for end, text in texts.items() if text})
            where = f"ros2_control joint {name!r}/{kind}"
            if kind in {"position", *LARGEST}:
                both = _range_of(ends, ("min", "max"), path, where)
                if both is not None:
                    most = both if kind == "position" else symmetric_limit(*both)
                    found[CONTROL].setdefault(name, {})[kind] = most
    tightened = {said: tighten_limits(root, limits, path, said) for said, limits in found.items()}
    return {said: joints for said, joints in tightened.items() if joints}


def _range_of(element: Element, keys: tuple[str, str], path: Path, where: str) -> tuple[float, float] | None:
    """The range between two attributes of which one may be absent; None where both are, or nothing is in between."""
    lower, upper = (
        read_number(element, key, path, where) if key in element.attrib else end
        for key, end in zip(keys, (-math.inf, math.inf), strict=True)
    )
    return (lower, upper) if lower < upper and math.isfinite(max(lower, -upper)) else None


def tighten_limits(root: Element, limits: Limits, path: Path, said: str) -> dict[str, list[str]]:
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
        name, limit = joint.get("name", ""), joint.find("limit")
        if name not in limits or joint.get("type") not in {"revolute", "continuous", "prismatic"}:
            continue
        limit = SubElement(joint, "limit") if limit is None else limit
        stated = limits[name]
        if "position" in stated and _narrow_range(joint, limit, stated["position"], path, said):
            changed.setdefault("position", []).append(name)
        where = f"joint {name!r}/limit"
        own = {key: read_number(limit, key, path, where, default="0") for key in LARGEST}
        for key, value in tighter_limits(stated, own).items():
            limit.set(key, repr(value))
            changed.setdefault(key, []).append(name)
    return changed


def tighter_limits(stated: Mapping[str, Any], own: Mapping[str, float]) -> dict[str, float]:
    """The largest magnitudes that are stated elsewhere and are tighter than a joint's own, of which 0 is none."""
    found = {key: stated[key] for key in own if key in stated}
    return {key: value for key, value in found.items() if value > 0.0 and not 0.0 < own[key] <= value}


def _narrow_range(joint: Element, limit: Element, stated: tuple[float, float], path: Path, said: str) -> bool:
    """Narrow a joint's range to one that is stated elsewhere; whether that changed it."""
    where, (lower, upper) = f"joint {joint.get('name')!r}/limit", stated
    if joint.get("type") == "continuous" or not {"lower", "upper"} <= set(limit.attrib):
        if joint.get("type") != "prismatic":
            # The end that is not stated is a turn away, or half a turn from zero.
            lower = min(-math.pi, upper - math.tau) if math.isinf(lower) else lower
            upper = max(math.pi, lower + math.tau) if math.isinf(upper) else upper
        if max(-lower, upper) > MAX_ANGLE:
            return False
        joint.set("type", "prismatic" if joint.get("type") == "prismatic" else "revolute")
    else:
        low, high = (read_number(limit, side, path, where) for side in ("lower", "upper"))
        # What is the wrong way round there is refused where the tree is checked; equal ends are no range.
        if low >= high or (low >= lower and high <= upper):
            return False
        lower, upper = max(low, lower), min(high, upper)
        if lower >= upper:
            what = f"{low:g} … {high:g} has nothing in common with {stated[0]:g} … {stated[1]:g} of {said}"
            raise robot_error(path, where, what, f"correct one of them, or remove that of {said}")
    limit.attrib.update(lower=repr(lower), upper=repr(upper))
    return True


def symmetric_limit(low: float, high: float) -> float:
    """The largest magnitude that is allowed either way; of bounds on one side of zero the larger that is finite."""
    if low < 0.0 < high:
        return min(-low, high)
    return max(abs(end) for end in (low, high) if math.isfinite(end))


def joint_limits_beside(path: Path) -> list[Path]:
    """MoveIt's files of joint limits beside a model: in ``config`` of its package, and of packages of MoveIt beside it.

    Where no ``package.xml`` says where a package begins, it is ``config`` of the model's folder or of the one above. A
    file in the model's own folder counts, too.
    """
    above = path.resolve().parents
    package = next((folder for folder in above if (folder / "package.xml").is_file()), None)
    folders = [*above[:2]] if package is None else [package, *sorted(package.parent.glob("*_moveit_config"))]
    files = [above[0] / _FILE, *(folder / "config" / _FILE for folder in folders)]
    return [file for file in dict.fromkeys(files) if file.is_file()]


@dataclass(frozen=True)
class LimitsFile:
    """What a file of MoveIt's kind, ``joint_limits.yaml``, states of a robot's joints.

    Attributes:
        limits: by joint.
        tables: limits that depend on positions.
        others: joints of the file that the robot does not have, and keys of its joints that are no limit's.
    """

    limits: Limits
    tables: tuple[PositionTable, ...]
    others: tuple[str, ...]


@raised_as(RobotError)
def read_limits_file(file: Path, names: Sequence[str], *, given: bool = True) -> LimitsFile:
    """Limits of a robot's joints: ``joint_limits`` as MoveIt has them, ``by_position`` as a ``robot.yaml`` has.

    Joints may be called without the ``_joint`` of their names, and angles tagged ``!degrees``, as in UR's. Names of
    nodes and groups of parameters may stand around ``joint_limits``, as in files of ROS parameters.

    Args:
        names: of the robot's joints; limits of others do not count.
        given: whether a person named the file, which then has to be of the robot.

    Raises:
        RobotError: it is no such file, or a limit is no number, or is the wrong way round; a table is none, or is of a
            joint that the robot does not have; nothing is of the robot's, or a key of its joints is no limit's.
    """
    remedy = f"give MoveIt's {_FILE}"
    content = read_yaml(file, degrees=True, remedy=remedy)
    joints = _find_block(content, {} if "by_position" in content else None)
    if not isinstance(joints, dict):
        raise robot_error(file, None, "has no mapping joint_limits", remedy)
    stated = {name: joints.get(name, joints.get(name.removesuffix("_joint"))) for name in names}
    limits = {name: _of_block(block, file, name) for name, block in stated.items() if isinstance(block, dict)}
    remedy = (
        "write it as limits.by_position of a robot.yaml: joint, quantity, at, and limit or lower and upper"
    )
    blocks, tables = content.get("by_position", []), []
    if not isinstance(blocks, list) or not all(isinstance(block, dict) for block in blocks):
        raise robot_error(file, "by_position", "is no list of tables", remedy)
    known = {short: name for name in names for short in (name, name.removesuffix("_joint"))}
    for block in blocks:
        said = {"source": file.name, **block}
        table = check_content(PositionTable, said, file, remedy=remedy)
        lost = {table.joint, table.over or table.joint} - set(known)
        if lost:
            raise robot_error(
                file,
                "by_position",
                f"no joint {min(lost)!r} in the model",
                "the model has " + ", ".join(names),
            )
        over = None if table.over is None else known[table.over]
        tables.append(table.model_copy(update={"joint": known[table.joint], "over": over}))
    if given and not limits and not tables:
        has = "the model has " + ", ".join(names)
        raise robot_error(file, "joint_limits", "names no joint of the robot", has)
    strange = [
        f"{name}.{key}"
        for name, block in stated.items()
        for key in (block if isinstance(block, dict) else ())
        if key not in _BOUNDS and not str(key).startswith(("has_", "k_", "angle_wraparound"))
    ]
    if given and strange:
        raise robot_error(
            file, f"joint_limits.{strange[0]}", "is no limit", f"write one of {', '.join(_BOUNDS)}"
        )
    others = [name for name in joints if name not in known] if limits else []
    return LimitsFile(limits, tuple(tables), (*others, *strange))


def _find_block(content: Mapping[str, Any], default: Any = None) -> Any:
    """What stands under ``joint_limits``, within whatever mappings."""
    if "joint_limits" in content:
        return content["joint_limits"]
    inner = (_find_block(part) for part in content.values() if isinstance(part, dict))
    return next((block for block in inner if block is not None), default)


def _of_block(block: Mapping[str, Any], file: Path, name: str) -> dict[str, Any]:
    found: dict[str, float] = {"lower": -math.inf, "upper": math.inf}
    for key, quantity in _BOUNDS.items():
        switch = key.split("_")[not key.startswith("soft")]
        # The quantity of which a file says that it has no limits has none.
        if key in block and block.get(f"has_{switch}_limits", True) is not False:
            number = block[key]
            if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
                what = f"is {str(number)[:40]!r}, no number"
                raise robot_error(file, f"joint_limits.{name}.{key}", what, "give one")
            size = number if quantity == "upper" else abs(number)
            found[quantity] = (
                max(found["lower"], number)
                if quantity == "lower"
                else min(found.get(quantity, math.inf), size)
            )
    lower, upper = found.pop("lower"), found.pop("upper")
    if lower >= upper:
        what = f"min_position {lower:g} is not below max_position {upper:g}"
        raise robot_error(file, f"joint_limits.{name}", what, "exchange or correct them")
    return {**({"position": (lower, upper)} if math.isfinite(max(lower, -upper)) else {}), **found}


def with_tables(tightened: Mapping[str, list[str]], file: LimitsFile) -> dict[str, list[str]]:
    """What a file tightened, the joints of its tables by the quantity that depends on a position, and what is left."""
    found = {what: list(joints) for what, joints in tightened.items()}
    if file.others:
        found["no use, as no joint or limit is called so,"] = list(file.others)
    for table in file.tables:
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
