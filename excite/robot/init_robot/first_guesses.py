"""First guesses about a robot from its URDF alone, for a person to confirm."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.display import count
from excite.finding import first_names
from excite.results import Assumed
from excite.robot.init_robot.limbs import Figure
from excite.robot.init_robot.rest import Rest
from excite.robot.robot import Robot
from excite.robot.shapes.collision import links_below
from excite.robot.shapes.link_shapes import numbers_of, origin_of
from excite.robot.shapes.shape import shape_points
from excite.robot.urdf.numbers import read_numbers
from excite.robot.urdf.tree import MOVING, link_at

# What can be guessed about a robot from its URDF alone, for a person to confirm.

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


# Joints of a bare model that a first description holds still: wheels, fingers, coupled, blocked and empty
# ones.

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
        turn = turn @ origin_of(joint.find("origin")).rotation
        axis = joint.find("axis")
        along = turn @ numbers_of("1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
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
    carriers = {child: (name, parent) for name, (parent, child) in _joint_ends(joints).items()}
    masses = dict.fromkeys(joints, 0.0)
    for link in root.findall("link"):
        here, mass = link.get("name", ""), _link_mass(link.find("inertial/mass"))
        while here in carriers:
            name, here = carriers[here]
            masses[name] += mass
    return masses


def _link_mass(mass: ElementTree.Element | None) -> float:
    """A link's mass [kg]; zero of what is none, which is refused where inertials are checked."""
    try:
        return 0.0 if mass is None else float(mass.get("value", "0"))
    except ValueError:
        return 0.0


# What a first description assumed about a robot's build, by consequence.

FRICTION = 0.5
"""Friction of soles that nobody stated: rubber on a dusty floor has 0.5 … 0.8."""


def assumed_structure(
    held: dict[str, Held],
    faults: dict[str, str],
    geometry: str | None,
    rest: Rest,
    ground: float | None,
    figure: Figure,
    ranged: tuple[str, ...] = (),
    unlimited: tuple[str, ...] = (),
) -> list[Assumed]:
    """Joints held or kept in a range, inertia, geometry and ground (or soles' friction) as they were assumed."""
    found = held_still(held)
    if ranged:
        found.append(
            Assumed(
                what="joints called continuous that do not turn on and on",
                value=first_names(ranged),
                consequence="the limits that the model states of them are kept: state limits.position if they are none",
            )
        )
    if unlimited:
        found.append(
            Assumed(
                what="position limits of joints that turn without end",
                value=f"half a turn either way: {first_names(unlimited)}",
                consequence="nothing stops the joint there: state limits.position, and wider ones if cables allow",
            )
        )
    if faults:
        found.append(
            Assumed(
                what="inertia as the model has it",
                value=first_names(list(faults)),
                consequence="missing or impossible there: torques predicted for them are a guess",
            )
        )
    block = figure.robot.description.collision
    boxes = [shape.link for shape in block.shapes if shape.link in block.stand_ins]
    if boxes:
        why = f" ({geometry[:150]})" if geometry else ""
        found.append(
            Assumed(
                what=f"geometry of {count(len(boxes), 'link')}",
                value=f"boxes of their own inertia, as large as their mass: {first_names(boxes)}",
                consequence=f"collisions of these are checked roughly: theirs is not there or cannot be used{why}; "
                "give --package-path FOLDER, where meshes are, or collision.shapes",
            )
        )
    if spread := _spread_links(figure):
        found.append(
            Assumed(
                what="moments of inertia that no body of a link's size has",
                value=first_names(
                    [f"{link} ({gyration:.3g} m, {reach:.3g} m)" for link, gyration, reach in spread]
                ),
                consequence=(
                    "radius of gyration, and how far its shapes reach from its centre of mass: with moments in another "
                    "unit, torques and acceleration limits are far off; correct the model"
                ),
            )
        )
    shaped = {shape.joint for shape in figure.shapes}
    bare = [segment.link for segment in figure.robot.segments if segment.joint not in shaped]
    if bare:
        found.append(
            Assumed(
                what="links without geometry",
                value=first_names(bare),
                consequence="nothing checks what they touch: give them <collision>, or collision.shapes",
            )
        )
    if ground is not None:
        margin = figure.robot.description.collision.margin
        below = links_below(figure.model, figure.shapes, rest.q, ground, margin)
        more = f"; excepted: {', '.join(below)}" if below else ""
        found.append(
            Assumed(
                what="ground",
                value=f"a plane at {ground:.3f} m of the base's frame",
                consequence=(
                    f"hold the robot so high that this is its floor: nothing it may reach touches it{more}"
                    if rest.base == "held"
                    else f"motions stay above it: state collision.table_height if it is elsewhere{more}"
                ),
            )
        )
    else:
        found.append(
            Assumed(
                what="friction of soles",
                value=f"{FRICTION}",
                consequence="feet may slip on a floor that is smoother",
            )
        )
    return found


def _spread_links(figure: Figure) -> list[tuple[str, float, float]]:
    """Links whose radius of gyration is larger than the farthest of their shapes is from their centre of mass [m].

    Wherever within its shapes a body's mass lies, no moment is more than the mass times that distance squared. Of 405
    links of 33 published models 393 keep that, 380 with less than 0.8 of the distance; eight break it by up to 2.4, and
    the four of a pair of hands that stands in kg·cm² by 23 to 37.
    """
    found = []
    for segment, ten in zip(
        figure.robot.segments, figure.robot.nominal_parameters.reshape(-1, 10), strict=True
    ):
        own = [shape for shape in figure.shapes if shape.joint == segment.joint]
        if any(shape.link in figure.robot.description.collision.stand_ins for shape in own):
            continue
        corners = [shape_points(shape) for shape in own]
        body = pin.Inertia.FromDynamicParameters(ten)
        if not corners or body.mass <= 0.0:
            continue
        reach = float(np.linalg.norm(np.vstack(corners) - body.lever, axis=1).max())
        gyration = float(np.sqrt(max(np.linalg.eigvalsh(body.inertia)[-1], 0.0) / body.mass))
        if gyration > reach:
            found.append((segment.link, gyration, reach))
    return sorted(found, key=lambda one: one[1] / one[2], reverse=True)


def held_still(held: dict[str, Held]) -> list[Assumed]:
    """Joints that do not move, those of one reason together."""
    found = []
    for why in sorted({one.why for one in held.values()}):
        names = [name for name, one in held.items() if one.why == why]
        found.append(
            Assumed(
                what=f"{len(names)} joint{'s' * (len(names) > 1)} held still ({why})",
                value=first_names(names),
                consequence="their links count as part of what carries them; hold them so at the robot",
            )
        )
    return found
