"""A bare model as its files tell it: which joints are left to move, which are held still, and its geometry."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from excite.errors import RobotError, raised_as
from excite.formats.documents import check_content, read_xml, read_yaml
from excite.robot.description import RobotDescription
from excite.robot.init_robot.first_guesses import (
    MASSLESS,
    TOO_WEAK,
    Held,
    JointGuess,
    guess_joints,
    held_joints,
    nearest_to_zero,
)
from excite.robot.init_robot.limbs import Figure
from excite.robot.loading import build_robot
from excite.robot.mechanisms.closures import join_overlapping
from excite.robot.refusal import robot_error
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_shapes, robot_reach
from excite.robot.shapes.stand_ins import box_shapes, links_lacking_geometry, links_without_shape
from excite.robot.urdf.converted import Said
from excite.robot.urdf.inertia import GEOMETRY, check_weights, inertial_faults
from excite.robot.urdf.limits import stated_ranges
from excite.robot.urdf.reading import MAX_NESTING, prepare_urdf
from excite.robot.urdf.tree import MOVING, LinkTree, check_tree

# A robot whose description is not complete yet, built with stand-ins for what only a person can say.

# Distance that links keep [m]: what hulls of a hundredth more than their meshes leave of clearances in arms of 1 m.
APART = 0.01


@dataclass(frozen=True, eq=False)
class WithGeometry:
    """A robot, and what collision geometry could be built.

    Attributes:
        robot: the robot.
        kind: ``collision``, ``visual``, or ``either`` where some links have the second alone; None where nothing
            can be built.
        fault: why not of all links, None where one can.
        lacking: links whose geometry cannot be built in whole or in part.
    """

    robot: Robot
    kind: str | None
    fault: str | None
    lacking: tuple[str, ...] = ()


@dataclass(frozen=True)
class StandIn:
    """Builds a robot with stand-ins for what a person has not said yet.

    Its loops are closed from ``posture``, the model's own [rad or m]: where all joints are at zero they may fold or
    stretch, and no motor determines what they do.
    """

    path: Path
    free: tuple[JointGuess, ...]
    locked: dict[str, float]
    faults: tuple[str, ...]
    margin: float
    tied: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    apart: float = APART
    posture: Mapping[str, float] = field(default_factory=dict)

    def with_geometry(self) -> WithGeometry:
        """The robot with the first kind of geometry that can be built, else each link with what can be built of it."""
        reasons = []
        for kind in GEOMETRY:
            robot = self.build_stand_in(kind)
            try:
                shapes = collision_shapes(robot)
            except RobotError as error:
                file = self.path.name if error.source is None else Path(str(error.source)).name
                of_mesh = "" if file == self.path.name else f"{file}: "
                reasons.append(f"{kind}: {of_mesh}{error.what}")
                continue
            if not any(shape.joint for shape in shapes):
                # Nothing would be checked: no shape moves.
                reasons.append(f"{kind}: none on a link that moves")
                continue
            # With what is drawn of links that have no ``collision``, if it can be built.
            more = self.build_stand_in("either")
            with suppress(RobotError):
                if kind == "collision" and len(collision_shapes(more)) > len(shapes):
                    return WithGeometry(more, "either", None)
            return WithGeometry(robot, kind, None)
        fault, lacking = "; ".join(reasons), links_lacking_geometry(self.build_stand_in("either"))
        robot = self.build_stand_in("either", stand_ins=lacking)
        try:
            collision_shapes(robot)
        except RobotError:
            return WithGeometry(self.build_stand_in("authored"), None, fault)
        return WithGeometry(robot, "either", fault, lacking)

    def _rest_of_model(self) -> dict[str, float]:
        """The model's own posture, as far as its limits let it."""
        ends = {g.name: g.position or (-np.inf, np.inf) for g in self.free if g.name in self.posture}
        return {
            name: float(np.clip(self.posture[name], low + self.margin, high - self.margin))
            for name, (low, high) in ends.items()
        }

    def build_stand_in(
        self, geometry: str, shapes: Sequence[dict[str, Any]] = (), stand_ins: Sequence[str] = ()
    ) -> Robot:
        """The robot with geometry of one kind, and authored ``shapes``, those of links in ``stand_ins`` for theirs."""
        content = read_yaml(Path(__file__).with_name("stand_in.yaml"))
        acknowledged, limits = dict.fromkeys(self.faults, "stand-in"), content["limits"]
        content |= {"locked_joints": self.locked, **self.tied}
        content["model"] |= {"path": str(self.path.resolve()), "acknowledged": acknowledged}
        content["posture"] |= {"joints": self._rest_of_model() if self.tied else {}}
        endless = {g.name: (-np.pi, np.pi) for g in self.free if g.position is None}
        limits["position"] |= {"joints": endless, "margin": self.margin}
        # A joint without a torque limit is given one later that carries its load in any posture.
        limits["torque"] |= {"joints": {g.name: g.torque or 1e9 for g in self.free}}
        own = {"geometry": geometry, "shapes": list(shapes), "stand_ins": list(stand_ins)}
        content["collision"] |= {**own, "margin": self.apart}
        mend = "correct the model, or rename its file"
        return build_robot(check_content(RobotDescription, content, self.path, remedy=mend), self.path)


# Distance that links keep, of the longest limb's length: 10 mm in arms of a third of a metre and more. Where servos
# give way as much as a first description assumes, links come nearer to each other than planned by 0.04 to 2.3 % of that
# length: replays of chosen motions of 13 robots with limbs of 0.17 to 2.8 m (Allegro, SO-101, Minitaur, Bolt, UR5,
# Romeo, …) that weigh 15 % more than their models. The 10 mm are what the bundled arms keep, not what these replays ask
# for: pairs of links came up to 16 mm (UR5) and 39 mm (Alexander) nearer, wherever they were.
_APART_SHARE = 0.03


@dataclass(frozen=True, eq=False)
class BareModel:
    """A model without a description.

    Attributes:
        path: the URDF.
        root: its XML.
        joints: its joints' XML by name; those that are held are fixed there.
        free: joints left to move, in the robot's order.
        held: joints that are held still, by name.
        moving: blocks ``loops`` and ``couplings`` of which no joint is held.
        margin: to the position limits [rad or m].
        geometry: which collision geometry could be built.
        authored: boxes in place of that of links where none could.
        figure: the robot, with stand-ins for what a person has to say.
        faults: what is wrong with links' inertia, on a base that is free (True) or not.
        ranged: joints left to move that the file calls continuous, though it states their range.
    """

    path: Path
    root: Any
    joints: dict[str, Any]
    free: tuple[JointGuess, ...]
    held: dict[str, Held]
    moving: dict[str, list[dict[str, Any]]]
    margin: float
    geometry: WithGeometry
    authored: list[dict[str, Any]]
    figure: Figure
    faults: dict[bool, dict[str, str]]
    ranged: tuple[str, ...]

    @property
    def robot(self) -> Robot:
        """The robot of ``figure``."""
        return self.figure.robot

    @property
    def base_link(self) -> str:
        """The link that no joint carries."""
        return LinkTree(self.joints).root

    @property
    def locked(self) -> dict[str, float]:
        """Where joints are held [rad or m]."""
        return {name: one.value for name, one in self.held.items()}


@raised_as(RobotError)
def bare_model(path: Path, said: Said, weak: Mapping[str, float]) -> BareModel:
    """Read a URDF without a description.

    Args:
        said: what another format said beside it.
        weak: joints that are held still because their drives are too weak, and where [rad or m].

    Raises:
        RobotError: the URDF is missing or absurd in a way that no description can mend, or nothing in it moves.
    """
    root = read_xml(path, max_depth=MAX_NESTING)
    ranges = stated_ranges(root, path)
    prepare_urdf(root, path)
    joints = check_tree(root, path)
    guesses = guess_joints(joints, path)
    ties = read_ties(joints, said)
    closing = _tied_joints(tie for tie in ties if tie.place == "loops")
    held = held_joints(root, joints, guesses, _tied_joints(ties), closing)
    held |= {name: Held(value, TOO_WEAK) for name, value in weak.items()}
    held |= _hold_together(ties, held, guesses)
    still = set(held)
    while more := {guess.name for guess in guesses if guess.follows in still} - still:
        still |= more
    free = tuple(guess for guess in guesses if guess.name not in still)
    if not free:
        raise _nothing_moves(held, path)
    for name in still & joints.keys():
        # As they will be read: what is held moves nothing, and no fault of its inertia matters.
        joints[name].set("type", "fixed")
    faults = {
        floating: {name: fault.what for name, fault in inertial_faults(root, joints, floating, path).items()}
        for floating in (False, True)
    }
    locked, moving = {name: one.value for name, one in held.items()}, dict[str, list[dict[str, Any]]]()
    for tie in ties:
        if not tie.joints & set(held):
            moving.setdefault(tie.place, []).append(dict(tie.block))
    # Small against the shortest range.
    shortest = min((g.position[1] - g.position[0] for g in free if g.position), default=1.0)
    margin = min(0.03, float(f"{0.05 * shortest:.1g}"))
    stand_in = StandIn(path, free, locked, tuple(faults[False]), margin, moving, posture=said.posture or {})
    geometry = stand_in.with_geometry()
    # Small against the longest limb.
    shapes = collision_shapes(geometry.robot) if geometry.kind else ()
    longest = robot_reach(geometry.robot.model, shapes, from_base=False)
    if 0.0 < longest and float(f"{_APART_SHARE * longest:.1g}") < APART:
        stand_in = replace(stand_in, apart=float(f"{_APART_SHARE * longest:.1g}"))
        geometry = stand_in.with_geometry()
    robot = geometry.robot
    check_weights(robot.model, robot.model.effortLimit[-robot.n_joints :], path)
    order = {name: index for index, name in enumerate(robot.joint_names)}
    free = tuple(sorted(free, key=lambda guess: order[guess.name]))
    lacking = tuple(dict.fromkeys((*geometry.lacking, *links_without_shape(robot))))
    authored = box_shapes(robot, lacking)
    if lacking:
        robot = stand_in.build_stand_in(geometry.kind or "authored", authored, lacking)
    ranged = tuple(guess.name for guess in free if guess.name in ranges)
    return BareModel(
        path, root, joints, free, held, moving, margin, geometry, authored, Figure(robot), faults, ranged
    )


def _nothing_moves(held: dict[str, Held], path: Path) -> RobotError:
    """What to say of a model none of whose joints is left to move."""
    what = "has no joint that moves"
    named = ", ".join(list(held)[:3])
    remedy = f"state limits that let {named} move" if held else "describe at least one"
    if held and all(one.why == MASSLESS for one in held.values()):
        what = "states no masses, and has no geometry at hand to guess them from"
        remedy = "add <inertial> to its links, or give --package-path FOLDER, where its meshes are"
    return robot_error(path, None, what, remedy)


# Joints of a bare model that move together: which of its loops and couplings stay when joints are held still.


class Tie(NamedTuple):
    """A loop or coupling: its place in a ``robot.yaml``, its block there, and the joints that it moves."""

    place: str
    block: Mapping[str, Any]
    joints: frozenset[str]


def _tied_joints(ties: Iterable[Tie]) -> frozenset[str]:
    return frozenset().union(*(tie.joints for tie in ties))


def _hold_together(
    ties: Sequence[Tie], held: Mapping[str, Held], guesses: tuple[JointGuess, ...]
) -> dict[str, Held]:
    """What is held besides: of joints that move together all where one is, each where its model rests."""
    together = (group for group in join_overlapping(tie.joints for tie in ties) if group & set(held))
    names = frozenset().union(*together) - set(held)
    rests = {guess.name: nearest_to_zero(guess) for guess in guesses if guess.name in names}
    return {name: Held(rests[name], "it moves with a joint that is held") for name in sorted(rests)}


def read_ties(joints: dict[str, Element], said: Said) -> list[Tie]:
    """What a model ties together in a URDF with these joints."""
    tree = LinkTree(joints)

    def chain_of(end: Mapping[str, Any]) -> set[str]:
        return {name for name in tree.above(end["link"]) if joints[name].get("type") in MOVING}

    loops = (
        Tie("loops", block, frozenset(chain_of(block["ends"][0]) ^ chain_of(block["ends"][1])))
        for block in said.loops
    )
    return [*loops, *(Tie("couplings", block, frozenset(block["joints"])) for block in said.couplings)]
