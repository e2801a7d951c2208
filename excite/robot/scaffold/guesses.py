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
from excite.robot.urdf.numbers import read_numbers
from excite.robot.urdf.tree import MOVING

Array = NDArray[np.float64]

_SIDES = (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"))
# A joint that turns less is a stop, a clutch or an exporter's zero [rad or m]: no motion fits in it, of which planning
# keeps 1e-3 at either end. Wrists of ±0.001 refused all of an Atlas's candidates.
_BLOCKED = 4e-3
# Velocities that stand for no limit: in the models of robots that were looked at limits end at 111 rad/s, and 1000,
# 50000 and 1e9 are what exporters write.
_NO_VELOCITY = 1e3
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
        blocked: where its limits leave it no range, the value at which they hold it [rad or m]; else None.
        acceleration: limit [rad/s² or m/s²], or None.
        jerk: limit [rad/s³ or m/s³], or None.
        effortless: whether it states a torque limit of zero: it has no motor, or nobody filled that in.
    """

    name: str
    continuous: bool
    position: tuple[float, float] | None
    velocity: float | None
    torque: float | None
    follows: str | None
    blocked: float | None = None
    effortless: bool = False
    acceleration: float | None = None
    jerk: float | None = None


def guess_joints(joints: dict[str, ElementTree.Element], path: Path) -> tuple[JointGuess, ...]:
    """Moving joints of a URDF with the limits that it states."""
    guesses = []
    for name, joint in joints.items():
        if joint.get("type") not in MOVING:
            continue
        limit, mimic = joint.find("limit"), joint.find("mimic")
        found = {}
        for key in ("lower", "upper", "velocity", "effort", "acceleration", "jerk"):
            if limit is not None and key in limit.attrib:
                found[key] = read_numbers(limit, key, 1, path, f"joint {name!r}/limit")[0]
        continuous = joint.get("type") == "continuous"
        ends = (
            None if continuous or not {"lower", "upper"} <= set(found) else (found["lower"], found["upper"])
        )
        blocked = None if ends is None or abs(ends[1] - ends[0]) > _BLOCKED else 0.5 * sum(ends)
        guesses.append(
            JointGuess(
                name=name,
                continuous=continuous,
                position=ends if ends is not None and blocked is None and ends[0] < ends[1] else None,
                velocity=_guess_velocity(found.get("velocity", 0.0)),
                torque=found.get("effort") or None,
                follows=None if mimic is None else mimic.get("joint", ""),
                blocked=blocked,
                effortless=found.get("effort") == 0.0,
                acceleration=found.get("acceleration") or None,
                jerk=found.get("jerk") or None,
            )
        )
    return tuple(guesses)


def _guess_velocity(stated: float) -> float | None:
    return stated if 0.0 < stated < _NO_VELOCITY else None


def guess_pairs(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Links that are each other's mirror image by name and have about the same mass."""
    masses = {segment.link: robot.nominal_parameters[10 * i] for i, segment in enumerate(robot.segments)}
    pairs = []
    for link, mass in masses.items():
        for mirrored in mirror_names(link):
            if mirrored != link and mirrored in masses and abs(masses[mirrored] - mass) <= 0.2 * mass:
                pairs.append((link, mirrored))
                break
    return tuple(pairs)


def mirror_names(link: str) -> list[str]:
    """Names that the right-hand twin of a left-hand link may have."""
    names = [link.replace(left, right) for left, right in _SIDES if left in link]
    for match in _LETTERS.finditer(link):
        letter = {"l": "r", "L": "R"}[match.group()]
        names.append(link[: match.start()] + letter + link[match.end() :])
    return names


def joint_inertias(robot: Robot, rng: np.random.Generator, n_random: int = 50) -> Array:
    """Largest inertia at each joint, all others held, over random postures, ``(n_joints,)`` [kg·m²]."""
    data = robot.model.createData()
    largest = np.zeros(robot.n_joints)
    for _ in range(n_random):
        q = drawn_posture(robot, rng)
        whole = pin.crba(robot.model, data, q)
        if robot.mechanism is not None:
            maps = robot.mechanism.motion_maps(q[None])[0]
            driven, upper = robot.mechanism.driven, np.triu(whole) + np.triu(whole, 1).T
            whole = np.diag(whole.diagonal().copy())
            whole[driven, driven] = np.einsum("ij,ik,kj->j", maps, upper, maps)
        inertia = np.diag(whole)[robot.n_base_v :]
        largest = np.maximum(largest, inertia)
    return largest


def drawn_posture(robot: Robot, rng: np.random.Generator) -> Array:
    """A random configuration within the limits ``(nq,)``, the base at rest and a mechanism closed."""
    lower, upper = robot.limits.position_lower, robot.limits.position_upper
    if robot.mechanism is not None:
        return np.asarray(robot.mechanism.drawn(rng, lower, upper, 1)[0])
    q = robot.rest.copy()
    q[robot.n_base_q :] = rng.uniform(lower, upper)
    return np.asarray(q)
