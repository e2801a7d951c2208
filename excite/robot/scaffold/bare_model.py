"""A bare model as its files tell it: which joints are left to move, which are held still, and its geometry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from excite.errors import RobotError
from excite.reading.xml_document import read_xml
from excite.robot.robot import Robot
from excite.robot.scaffold.guesses import JointGuess, guess_joints
from excite.robot.scaffold.held import MASSLESS, TOO_WEAK, Held, held_joints
from excite.robot.scaffold.limbs import Figure
from excite.robot.scaffold.said import Said
from excite.robot.scaffold.stand_in import APART, StandIn, WithGeometry
from excite.robot.scaffold.tied import tied_blocks
from excite.robot.shapes.collision import collision_shapes
from excite.robot.shapes.ground import robot_reach
from excite.robot.shapes.stand_ins import box_shapes, links_without_shape
from excite.robot.urdf.inertia import inertial_faults
from excite.robot.urdf.limits import stated_ranges
from excite.robot.urdf.reading import MAX_NESTING, parse_urdf
from excite.robot.urdf.tree import check_tree
from excite.robot.weights import check_weights

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
    def locked(self) -> dict[str, float]:
        """Where joints are held [rad or m]."""
        return {name: one.value for name, one in self.held.items()}


def bare_model(path: Path, said: Said, weak: Mapping[str, float]) -> BareModel:
    """Read a URDF without a description.

    Args:
        path: the URDF.
        said: what another format said beside it.
        weak: joints that are held still because their drives are too weak, and where [rad or m].

    Raises:
        RobotError: the URDF is missing or absurd in a way that no description can mend, or nothing in it moves.
    """
    root = parse_urdf(path)
    ranges = stated_ranges(read_xml(path, error=RobotError, max_depth=MAX_NESTING), path)
    joints = check_tree(root, path)
    guesses = guess_joints(joints, path)
    together = tied_blocks(joints, said.loops, said.couplings)
    held = held_joints(root, joints, guesses, together.joints, together.closing)
    held |= {name: Held(value, TOO_WEAK) for name, value in weak.items()}
    held |= together.holding(held, guesses)
    still_names = _with_followers(held, guesses)
    free = tuple(guess for guess in guesses if guess.name not in still_names)
    if not free:
        raise _nothing_moves(held, path)
    for name, joint in joints.items():
        # As they will be read: what is held moves nothing, and no fault of its inertia matters.
        if name in still_names:
            joint.set("type", "fixed")
    faults = {floating: _inertial_faults(root, joints, floating, path) for floating in (False, True)}
    locked = {name: one.value for name, one in held.items()}
    moving, margin = together.moving(held), _position_margin(free)
    stand_in = StandIn(path, free, locked, tuple(faults[False]), margin, moving, posture=said.posture or {})
    geometry = stand_in.with_geometry()
    apart = _link_distance(geometry.robot)
    if apart < stand_in.apart:
        stand_in = replace(stand_in, apart=apart)
        geometry = stand_in.with_geometry()
    robot = geometry.robot
    check_weights(robot.model, robot.model.effortLimit[-robot.n_joints :], path)
    order = {name: index for index, name in enumerate(robot.joint_names)}
    free = tuple(sorted(free, key=lambda guess: order[guess.name]))
    lacking = tuple(dict.fromkeys((*geometry.lacking, *links_without_shape(robot))))
    authored = box_shapes(robot, lacking)
    if lacking:
        robot = stand_in.robot(geometry.kind or "authored", authored, lacking)
    figure = Figure(robot)
    ranged = tuple(guess.name for guess in free if guess.name in ranges)
    return BareModel(
        path, root, joints, free, held, moving, margin, geometry, authored, figure, faults, ranged
    )


def _nothing_moves(held: dict[str, Held], path: Path) -> RobotError:
    """What to say of a model none of whose joints is left to move."""
    if held and all(one.why == MASSLESS for one in held.values()):
        what, remedy = (
            "states no masses, and has no geometry at hand to guess them from",
            "add <inertial> to its links, or give --package-path FOLDER, where its meshes are",
        )
        return RobotError(what, source=path, remedy=remedy)
    named = ", ".join(list(held)[:3])
    remedy = f"state limits that let {named} move" if held else "describe at least one"
    return RobotError("has no joint that moves", source=path, remedy=remedy)


def _with_followers(held: Mapping[str, Held], guesses: tuple[JointGuess, ...]) -> set[str]:
    """Names of joints that are held, and of those that follow them."""
    names = set(held)
    while more := {guess.name for guess in guesses if guess.follows in names} - names:
        names |= more
    return names


def _inertial_faults(root: Any, joints: dict[str, Any], floating: bool, path: Path) -> dict[str, str]:
    return {name: error.what for name, error in inertial_faults(root, joints, floating, path).items()}


def _position_margin(free: tuple[JointGuess, ...]) -> float:
    """Margin to the position limits, small against the shortest range [rad or m]."""
    shortest = min((g.position[1] - g.position[0] for g in free if g.position), default=1.0)
    return min(0.03, float(f"{0.05 * shortest:.1g}"))


def _link_distance(robot: Robot) -> float:
    """Distance that links keep, small against the longest limb [m]."""
    shapes = collision_shapes(robot) if robot.description.collision.geometry != "authored" else ()
    longest = robot_reach(robot.model, shapes, from_base=False)
    return min(APART, float(f"{_APART_SHARE * longest:.1g}")) if longest > 0.0 else APART
