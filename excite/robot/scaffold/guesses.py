"""What can be guessed about a robot from its URDF alone, for a person to confirm."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_shapes
from excite.robot.shapes.shape import shape_points
from excite.robot.urdf.numbers import numbers
from excite.robot.urdf.tree import MOVING

Array = NDArray[np.float64]

_FOOT = re.compile(r"foot|sole|ankle|toe", re.IGNORECASE)
_SIDES = (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"))
_LETTERS = re.compile(r"(?<![A-Za-z])([lL])(?![a-z])|(?<=[a-z0-9])(L)(?![a-z])")


@dataclass(frozen=True)
class JointGuess:
    """A joint that moves, as the URDF has it.

    Attributes:
        name: its name.
        continuous: whether it turns without end.
        position: limits [rad or m], or None where the URDF has none.
        velocity: limit [rad/s or m/s], or None.
        torque: limit [N·m or N], or None.
        follows: joint that it mimics, or None.
    """

    name: str
    continuous: bool
    position: tuple[float, float] | None
    velocity: float | None
    torque: float | None
    follows: str | None


@dataclass(frozen=True)
class FootGuess:
    """A link that may be a foot; ``sole`` holds corners in its frame [m], anticlockwise from above."""

    link: str
    sole: tuple[tuple[float, float, float], ...]


def guess_joints(joints: dict[str, ElementTree.Element], path: Path) -> tuple[JointGuess, ...]:
    """Moving joints of a URDF with the limits that it states."""
    guesses = []
    for name, joint in joints.items():
        if joint.get("type") not in MOVING:
            continue
        limit, mimic = joint.find("limit"), joint.find("mimic")
        found = {}
        for key in ("lower", "upper", "velocity", "effort"):
            if limit is not None and key in limit.attrib:
                found[key] = numbers(limit, key, 1, path, f"joint {name!r}/limit")[0]
        continuous = joint.get("type") == "continuous"
        stated = not continuous and "lower" in found and "upper" in found and found["lower"] < found["upper"]
        guesses.append(
            JointGuess(
                name=name,
                continuous=continuous,
                position=(found["lower"], found["upper"]) if stated else None,
                velocity=found.get("velocity") or None,
                torque=found.get("effort") or None,
                follows=None if mimic is None else mimic.get("joint", ""),
            )
        )
    return tuple(guesses)


def guess_floating(root: ElementTree.Element, joints: dict[str, ElementTree.Element]) -> bool:
    """Whether the base is likely free: two or more limbs of at least three joints leave a root with mass."""
    children: dict[str, list[tuple[str, bool]]] = {}
    below = set()
    for joint in joints.values():
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:
            continue
        moves = joint.get("type") in MOVING
        children.setdefault(str(parent.get("link")), []).append((str(child.get("link")), moves))
        below.add(str(child.get("link")))
    links = {link.get("name", ""): link for link in root.findall("link")}
    body = [next(name for name in links if name not in below)]
    for name in body:
        body += [child for child, moves in children.get(name, []) if not moves]
    if not any(links[name].find("inertial") is not None for name in body):
        return False

    def length(link: str) -> int:
        return max((moves + length(child) for child, moves in children.get(link, [])), default=0)

    limbs = [1 + length(child) for name in body for child, moves in children.get(name, []) if moves]
    return sum(limb >= 3 for limb in limbs) >= 2


def guess_pairs(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Links that are each other's mirror image by name and have about the same mass."""
    masses = {segment.link: robot.nominal_parameters[10 * i] for i, segment in enumerate(robot.segments)}
    pairs = []
    for link, mass in masses.items():
        for mirrored in _mirror_names(link):
            if mirrored != link and mirrored in masses and abs(masses[mirrored] - mass) <= 0.2 * mass:
                pairs.append((link, mirrored))
                break
    return tuple(pairs)


def _mirror_names(link: str) -> list[str]:
    """Names that the right-hand twin of a left-hand link may have."""
    names = [link.replace(left, right) for left, right in _SIDES if left in link]
    for match in _LETTERS.finditer(link):
        letter = {"l": "r", "L": "R"}[match.group()]
        names.append(link[: match.start()] + letter + link[match.end() :])
    return names


def guess_feet(robot: Robot, tolerance: float = 0.01) -> tuple[FootGuess, ...]:
    """Links at the ends of limbs that are named like feet and reach lowest.

    Judged with all joints at zero, where most models stand with flat feet. The sole is the rectangle, along
    the base's axes, about the geometry within ``tolerance`` [m] of the lowest point, less a twentieth of its
    length, by which the hulls may be larger than the meshes.
    """
    model = robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    inner = set(model.parents)
    clouds: dict[str, Array] = {}
    for shape in collision_shapes(robot):
        if shape.joint and shape.joint not in inner:
            link = robot.segments[shape.joint - 1].link
            points = shape_points(shape)
            world = points @ data.oMi[shape.joint].rotation.T + data.oMi[shape.joint].translation
            clouds[link] = np.vstack([clouds[link], world]) if link in clouds else world
    if not clouds:
        return ()
    ground = min(cloud[:, 2].min() for cloud in clouds.values())
    low = [link for link, cloud in clouds.items() if cloud[:, 2].min() < ground + 0.05]
    chosen = [link for link in low if _FOOT.search(link)] or low
    feet = []
    for link in chosen:
        cloud = clouds[link]
        near = cloud[cloud[:, 2] < cloud[:, 2].min() + tolerance]
        middle, half = 0.5 * (near.max(axis=0) + near.min(axis=0)), 0.475 * np.ptp(near, axis=0)
        (x0, y0, _), (x1, y1, _), z = middle - half, middle + half, cloud[:, 2].min()
        pose = data.oMi[next(segment.joint for segment in robot.segments if segment.link == link)]
        corners = [
            pose.actInv(np.array(corner)) for corner in ((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))
        ]
        sole = [tuple(round(float(value), 4) + 0.0 for value in corner) for corner in corners]
        feet.append(FootGuess(link, tuple((x, y, z) for x, y, z in sole)))
    return tuple(feet)


def joint_inertias(robot: Robot, rng: np.random.Generator, n_random: int = 50) -> Array:
    """Largest inertia at each joint, all others held, over random postures, ``(n_joints,)`` [kg·m²]."""
    data = robot.model.createData()
    largest = np.zeros(robot.n_joints)
    for _ in range(n_random):
        q = robot.rest.copy()
        q[robot.n_base_q :] = rng.uniform(robot.limits.position_lower, robot.limits.position_upper)
        inertia = np.diag(pin.crba(robot.model, data, q))[robot.n_base_v :]
        largest = np.maximum(largest, inertia)
    return largest
