"""First guesses about a robot from its URDF alone, for a person to confirm."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.display import count
from excite.finding import first_names
from excite.results import Assumed
from excite.robot.init_robot.assumptions import assume
from excite.robot.init_robot.model_metadata import link_mass
from excite.robot.robot import Robot
from excite.robot.shapes.link_shapes import numbers_of
from excite.robot.urdf.inertia import GEOMETRY
from excite.robot.urdf.numbers import read_number, read_origin
from excite.robot.urdf.tree import MOVING, LinkTree, link_at

_LETTERS = re.compile(r"(?<![A-Za-z])([lL])(?![a-z])|(?<=[a-z0-9])(L)(?![a-z])")


@dataclass(frozen=True)
class JointGuess:
    """A joint that moves, as the URDF has it.

    Attributes:
        name: its name.
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
    position: tuple[float, float] | None
    velocity: float | None
    torque: float | None
    follows: str | None
    blocked: float | None
    effortless: bool
    acceleration: float | None
    jerk: float | None


def guess_joints(joints: dict[str, Element], path: Path) -> tuple[JointGuess, ...]:
    """Moving joints of a URDF with the limits that it states."""
    guesses = []
    for name, joint in joints.items():
        if joint.get("type") not in MOVING:
            continue
        limit, mimic = joint.find("limit"), joint.find("mimic")
        stated = {} if limit is None else limit.attrib
        found = {
            key: read_number(limit, key, path, f"joint {name!r}/limit")
            for key in ("lower", "upper", "velocity", "effort", "acceleration", "jerk")
            if limit is not None and key in stated
        }
        continuous, ends, blocked = joint.get("type") == "continuous", None, None
        if not continuous and {"lower", "upper"} <= set(found):
            ends = found["lower"], found["upper"]
            # A joint that turns less is a stop, a clutch or an exporter's zero [rad or m]: no motion fits in it, of
            # which planning keeps 1e-3 at either end. Wrists of ±0.001 refused all of an Atlas's candidates.
            blocked = 0.5 * sum(ends) if abs(ends[1] - ends[0]) <= 4e-3 else None
        velocity = found.get("velocity", 0.0)
        # Velocities that stand for no limit: in the models of robots that were looked at limits end at 111 rad/s, and
        # 1000, 50000 and 1e9 are what exporters write.
        guesses.append(
            JointGuess(
                name=name,
                position=ends if ends is not None and blocked is None and ends[0] < ends[1] else None,
                velocity=velocity if 0.0 < velocity < 1e3 else None,
                torque=found.get("effort") or None,
                follows=None if mimic is None else mimic.get("joint", ""),
                blocked=blocked,
                effortless=found.get("effort") == 0.0,
                acceleration=found.get("acceleration") or None,
                jerk=found.get("jerk") or None,
            )
        )
    return tuple(guesses)


def guess_pairs(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Links that are each other's mirror image by name and have about the same mass."""
    masses = dict(
        zip((segment.link for segment in robot.segments), robot.nominal_parameters[::10], strict=True)
    )
    pairs = []
    for link, mass in masses.items():
        twins = [name for name in mirror_names(link) if name != link and name in masses]
        pairs += [(link, twin) for twin in twins if abs(masses[twin] - mass) <= 0.2 * mass][:1]
    return tuple(pairs)


def mirror_names(link: str) -> list[str]:
    """Names that the right-hand twin of a left-hand link may have."""
    names = [
        link.replace(left, right)
        for left, right in (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"))
        if left in link
    ]
    for match in _LETTERS.finditer(link):
        letter = {"l": "r", "L": "R"}[match.group()]
        names.append(link[: match.start()] + letter + link[match.end() :])
    return names


def joint_inertias(robot: Robot, rng: np.random.Generator) -> Array:
    """Largest inertia at each joint, all others held, over fifty random postures, ``(n_joints,)`` [kg·m²]."""
    data, largest = robot.model.createData(), np.zeros(robot.n_joints)
    for q in robot.draw_configurations(rng, 50):
        whole = pin.crba(robot.model, data, q)
        inertia = whole.diagonal().copy()
        if robot.mechanism is not None:
            maps, upper = robot.mechanism.motion_maps(q[None])[0], np.triu(whole) + np.triu(whole, 1).T
            inertia[robot.mechanism.driven] = np.einsum("ij,ik,kj->j", maps, upper, maps)
        largest = np.maximum(largest, inertia[robot.n_base_v :])
    return largest


# Joints of a bare model that a first description holds still: wheels, fingers, coupled, blocked and empty
# ones.

_WHEEL = re.compile(r"wheel|caster|castor|roller|rotor|propell", re.IGNORECASE)
_FINGER = re.compile(r"finger|thumb|gripper|knuckle|jaw|pinky", re.IGNORECASE)
# A joint of the arm though the link that it turns is called a gripper's: the last one of a ViperX.
_LIMB = re.compile(r"wrist|forearm|elbow|shoulder", re.IGNORECASE)

MASSLESS = "nothing with mass moves with it"
TOO_WEAK = (
    "the torque limit that the model states cannot hold what it carries: state the drive's, if it gives more"
)


@dataclass(frozen=True)
class Held:
    """A joint held still at ``value`` [rad or m], and why, in a word or two."""

    value: float
    why: str


def held_joints(
    root: Element,
    joints: dict[str, Element],
    guesses: tuple[JointGuess, ...],
    tied: frozenset[str] = frozenset(),
    closing: frozenset[str] = frozenset(),
) -> dict[str, Held]:
    """Joints to hold still, by name; where nothing else would move, wheels and fingers are left free.

    Joints that mimic a held one follow it and do not stand here; those of a hand hold the one that they follow. Joints
    in ``tied`` close loops or are coupled and need no mass beyond them; those of loops, ``closing``, no limits either.
    """
    # Mass of all links beyond each joint [kg].
    tree, masses = LinkTree(joints), dict.fromkeys(joints, 0.0)
    for link in root.findall("link"):
        for name in tree.above(link.get("name", "")):
            masses[name] += link_mass(link)
    of_hands, rolling = _of_hands(joints, masses), _planar_base(root, joints)
    # Names of joints that the file gives a drive: by a transmission, or by a command of ros2_control.
    # A torque limit of zero alone does not tell joints without one. It is what the springs of Cassie and the rods of
    # Digit state, but also driven joints of the Vega (lift), the RM75 (six of seven) and the Dex5 (16 of 20).
    moved = {str(joint.get("name")) for joint in root.iterfind("transmission/joint")}
    commanded = root.iterfind("ros2_control/joint[command_interface]")
    driven = (moved | {str(joint.get("name")) for joint in commanded}) & set(joints)
    hard: dict[str, Held] = {}
    soft: dict[str, Held] = {}
    for guess in guesses:
        name = guess.name
        if guess.follows is not None:
            if guess.follows not in joints:
                why = f"it follows {guess.follows}, which the model does not have"
                hard[name] = Held(nearest_to_zero(guess), why)
            continue
        followers = (one.name for one in guesses if one.follows == name)
        called = " ".join([name, link_at(joints[name], "child"), *followers])
        slides = joints[name].get("type") == "prismatic"
        finger = (_FINGER.search(called) and not _LIMB.search(name)) or name in of_hands
        reasons = {
            MASSLESS: masses[name] <= 0.0 and name not in tied,
            "its limits leave it no range: correct them if it moves": guess.blocked is not None,
            "no motor drives it": driven and guess.effortless and name not in driven | tied,
            "a slide without limits": slides and guess.position is None and name not in closing,
            "what its wheels or legs do: it has no drive": name in rolling,
            "a wheel": _WHEEL.search(called),
            "of a hand or gripper": finger,
        }
        found = [why for why, holds in reasons.items() if holds]
        if found:
            kept = hard if found[0] in list(reasons)[:4] else soft
            at = nearest_to_zero(guess) if guess.blocked is None else guess.blocked
            kept[name] = Held(at, found[0])
    moving = [g for g in guesses if g.follows is None and g.name not in hard]
    return hard if all(g.name in soft for g in moving) else {**hard, **soft}


def _planar_base(root: Element, joints: dict[str, Element]) -> set[str]:
    """Joints between the root and the first link with geometry that stand for a base's wheels.

    They are a hinge and one or two slides across its axis, with links in between of which nothing is seen or touched.
    """
    solid = {
        str(link.get("name"))
        for link in root.findall("link")
        if any(link.find(f"{kind}/geometry") is not None for kind in GEOMETRY)
    }
    tree = LinkTree(joints)
    here, turn, axes, found = tree.root, np.eye(3), dict[str, Array](), set[str]()
    while solid and len(below := tree.below(here)) == 1:
        (name,) = below
        joint, here = joints[name], tree.ends[name][1]
        turn = turn @ read_origin(joint).rotation
        axis = joint.find("axis")
        if joint.get("type") in MOVING:
            axes[name] = turn @ numbers_of("1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
        hinges = sum(joints[one].get("type") != "prismatic" for one in axes)
        pairs = itertools.combinations(axes.values(), 2)
        # Directions at right angles have a smaller cosine, however few digits their angles were typed with.
        if hinges == 1 and len(axes) in {2, 3} and all(abs(float(a @ b)) < 0.01 for a, b in pairs):
            found = set(axes)
        if here in solid:
            break
    return found


def _of_hands(joints: dict[str, Element], masses: dict[str, float]) -> set[str]:
    """Joints beyond a link of little mass at which limbs part that have three or more ends."""
    moving = {name for name, joint in joints.items() if joint.get("type") in MOVING}
    tree, whole = LinkTree(joints), max((masses[name] for name in moving), default=0.0)
    found, further = set[str](), {name: set[str]() for name in moving}
    for name in moving:
        for before in set(tree.above(tree.ends[name][0])) & moving:
            further[before].add(name)
    for joints_beyond in further.values():
        rests = [further[one] for one in joints_beyond]
        # A wrist or a forearm has all fingers beyond it, too; they part where no one joint leads to all others.
        part = not any(len(rest) == len(joints_beyond) - 1 for rest in rests)
        # Not the palm's own mass: of two hands of one kind a published pair has one palm of 0.7 kg.
        first = joints_beyond - set().union(*rests)
        if (
            part
            # Hands have three fingers or more, which weigh a twentieth of what the heaviest joint of a robot moves.
            and sum(not rest for rest in rests) >= 3
            and sum(masses[one] for one in first) < 0.05 * whole
        ):
            found |= joints_beyond
    return found


def nearest_to_zero(guess: JointGuess) -> float:
    """The position nearest to zero within a joint's limits [rad or m]."""
    low, high = guess.position or (0.0, 0.0)
    return min(max(0.0, low), high)


def held_still(held: dict[str, Held]) -> list[Assumed]:
    """Joints that do not move, those of one reason together."""
    found = []
    for why in sorted({one.why for one in held.values()}):
        names = [name for name, one in held.items() if one.why == why]
        found.append(assume("held", joints=count(len(names), "joint"), why=why, names=first_names(names)))
    return found
