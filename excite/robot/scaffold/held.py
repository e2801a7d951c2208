"""Joints of a bare model that a first description holds still: wheels, fingers, coupled, blocked and empty ones."""

from __future__ import annotations

import re
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.scaffold.guesses import JointGuess
from excite.robot.urdf.tree import MOVING, link_at

_WHEEL = re.compile(r"wheel|caster|castor|roller|rotor|propell", re.IGNORECASE)
_FINGER = re.compile(r"finger|thumb|gripper|knuckle|jaw|pinky", re.IGNORECASE)
# A joint of the arm though the link that it turns is called a gripper's: the last one of a ViperX.
_LIMB = re.compile(r"wrist|forearm|elbow|shoulder", re.IGNORECASE)

UNDRIVEN = "no motor drives it"
MASSLESS = "nothing with mass moves with it"
TOO_WEAK = (
    "the torque limit that the model states cannot hold what it carries: state the drive's, if it gives more"
)
# Directions at right angles have a smaller cosine, however few digits their angles were typed with.
_ACROSS = 0.01
# Hands have three fingers or more, which weigh a twentieth of what the heaviest joint of a robot moves.
_FINGERS, _HAND = 3, 0.05


@dataclass(frozen=True)
class Held:
    """A joint held still at ``value`` [rad or m], and why, in a word or two."""

    value: float
    why: str


def held_joints(
    root: ElementTree.Element,
    joints: dict[str, ElementTree.Element],
    guesses: tuple[JointGuess, ...],
    tied: frozenset[str] = frozenset(),
    closing: frozenset[str] = frozenset(),
) -> dict[str, Held]:
    """Joints to hold still, by name; where nothing else would move, wheels and fingers are left free.

    Joints that mimic a held one follow it and do not stand here; those of a hand hold the one that they follow. Joints
    in ``tied`` close loops or are coupled and need no mass beyond them; those of loops, ``closing``, no limits either.
    """
    masses = _masses_beyond(root, joints)
    of_hands, rolling = _of_hands(joints, masses), _planar_base(root, joints)
    driven = _with_drives(root) & set(joints)
    hard: dict[str, Held] = {}
    soft: dict[str, Held] = {}
    for guess in guesses:
        if guess.follows is not None and guess.follows not in joints:
            hard[guess.name] = Held(
                nearest_to_zero(guess), f"it follows {guess.follows}, which the model does not have"
            )
            continue
        if guess.follows is not None:
            continue
        called = f"{guess.name} {link_at(joints[guess.name], 'child')}"
        called = " ".join([called, *(one.name for one in guesses if one.follows == guess.name)])
        slides = joints[guess.name].get("type") == "prismatic"
        if masses[guess.name] <= 0.0 and guess.name not in tied:
            hard[guess.name] = Held(nearest_to_zero(guess), MASSLESS)
        elif guess.blocked is not None:
            hard[guess.name] = Held(guess.blocked, "its limits leave it no range: correct them if it moves")
        elif driven and guess.effortless and guess.name not in driven | tied:
            hard[guess.name] = Held(nearest_to_zero(guess), UNDRIVEN)
        elif slides and guess.position is None and guess.name not in closing:
            hard[guess.name] = Held(0.0, "a slide without limits")
        elif guess.name in rolling:
            soft[guess.name] = Held(nearest_to_zero(guess), "what its wheels or legs do: it has no drive")
        elif why := _wheel_or_hand(guess.name, called, of_hands):
            soft[guess.name] = Held(nearest_to_zero(guess), why)
    moving = [g for g in guesses if g.follows is None and g.name not in hard]
    return hard if all(g.name in soft for g in moving) else {**hard, **soft}


def _wheel_or_hand(name: str, called: str, of_hands: set[str]) -> str:
    """Why a joint, whose own and its link's names are ``called`` so, is none of a limb; empty where it is one."""
    if _WHEEL.search(called):
        return "a wheel"
    finger = _FINGER.search(called) and not _LIMB.search(name)
    return "of a hand or gripper" if finger or name in of_hands else ""


def _with_drives(root: ElementTree.Element) -> set[str]:
    """Names of joints that the file gives a drive: by a transmission, or by a command of ros2_control.

    A torque limit of zero alone does not tell joints without one. It is what the springs of Cassie and the rods of
    Digit state, but also driven joints of the Vega (lift), the RM75 (six of seven) and the Dex5 (16 of 20).
    """
    moved = {str(joint.get("name")) for joint in root.iterfind("transmission/joint")}
    commanded = root.iterfind("ros2_control/joint[command_interface]")
    return moved | {str(joint.get("name")) for joint in commanded}


def _planar_base(root: ElementTree.Element, joints: dict[str, ElementTree.Element]) -> set[str]:
    """Joints between the root and the first link with geometry that stand for a base's wheels.

    They are a hinge and one or two slides across its axis, with links in between of which nothing is seen or touched.
    """
    solid = {
        str(link.get("name"))
        for link in root.findall("link")
        if link.find("visual/geometry") is not None or link.find("collision/geometry") is not None
    }
    ends = _joint_ends(joints)
    children = {child for _, child in ends.values()}
    here = next((parent for parent, _ in ends.values() if parent not in children), "")
    turn, slides, hinges, found = np.eye(3), dict[str, Array](), dict[str, Array](), set[str]()
    while solid and len(below := [name for name, (parent, _) in ends.items() if parent == here]) == 1:
        (name,) = below
        joint, here = joints[name], ends[name][1]
        turn = turn @ pin.rpy.rpyToMatrix(*_three_numbers(joint.find("origin"), "rpy", "0 0 0"))
        along = turn @ _three_numbers(joint.find("axis"), "xyz", "1 0 0")
        if joint.get("type") in MOVING:
            (slides if joint.get("type") == "prismatic" else hinges)[name] = along
        axes = [*slides.values(), *hinges.values()]
        across = all(abs(float(a @ b)) < _ACROSS for k, a in enumerate(axes) for b in axes[:k])
        if len(hinges) == 1 and len(slides) in {1, 2} and across:
            found = {*slides, *hinges}
        if here in solid:
            break
    return found


def _joint_ends(joints: dict[str, ElementTree.Element]) -> dict[str, tuple[str, str]]:
    """Links before and beyond each joint."""
    return {name: (link_at(joint, "parent"), link_at(joint, "child")) for name, joint in joints.items()}


def _three_numbers(element: ElementTree.Element | None, name: str, default: str) -> Array:
    text = default if element is None else element.get(name, default)
    return np.array([float(part) for part in text.split()])


def _of_hands(joints: dict[str, ElementTree.Element], masses: dict[str, float]) -> set[str]:
    """Joints beyond a link of little mass at which limbs part that have three or more ends."""
    moving = {name for name, joint in joints.items() if joint.get("type") in MOVING}
    ends = _joint_ends(joints)
    whole = max((masses[name] for name in moving), default=0.0)
    found: set[str] = set()

    def beyond(link: str) -> set[str]:
        """Moving joints beyond a link."""
        here = {name for name, (parent, _) in ends.items() if parent == link}
        return (here & moving).union(*(beyond(ends[name][1]) for name in here))

    for name in moving:
        joints_beyond = beyond(ends[name][1])
        further = {one: beyond(ends[one][1]) for one in joints_beyond}
        # A wrist or a forearm has all fingers beyond it, too; they part where no one joint leads to all others.
        part = not any(len(rest) == len(joints_beyond) - 1 for rest in further.values())
        tips = sum(not rest for rest in further.values())
        # Not the palm's own mass: of two hands of one kind a published pair has one palm of 0.7 kg.
        first = joints_beyond - set().union(*further.values())
        if part and tips >= _FINGERS and sum(masses[one] for one in first) < _HAND * whole:
            found |= joints_beyond
    return found


def nearest_to_zero(guess: JointGuess) -> float:
    """The position nearest to zero within a joint's limits [rad or m]."""
    low, high = guess.position or (0.0, 0.0)
    return min(max(0.0, low), high)


def _masses_beyond(root: ElementTree.Element, joints: dict[str, ElementTree.Element]) -> dict[str, float]:
    """Mass of all links beyond each joint [kg]."""
    own: dict[str, float] = {}
    for link in root.findall("link"):
        mass = link.find("inertial/mass")
        own[link.get("name", "")] = _link_mass(mass)
    children: dict[str, list[str]] = {}
    ends: dict[str, str] = {}
    for name, (parent, child) in _joint_ends(joints).items():
        children.setdefault(parent, []).append(child)
        ends[name] = child
    order = list(ends.values())
    below: dict[str, float] = {}

    def mass_of(link: str) -> float:
        if link not in below:
            below[link] = own.get(link, 0.0) + sum(mass_of(child) for child in children.get(link, []))
        return below[link]

    for child in order:
        mass_of(child)
    return {name: below[child] for name, child in ends.items()}


def _link_mass(mass: ElementTree.Element | None) -> float:
    """A link's mass [kg]; zero of what is none, which is refused where inertials are checked."""
    try:
        return 0.0 if mass is None else float(mass.get("value", "0"))
    except ValueError:
        return 0.0
