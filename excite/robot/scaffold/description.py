"""A first ``robot.yaml`` for a URDF of one's own: complete and careful, with what was assumed said in it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from excite.arrays import Array
from excite.errors import RobotError
from excite.robot.robot import Robot
from excite.robot.scaffold import numbers
from excite.robot.scaffold.guesses import JointGuess, guess_joints, guess_pairs
from excite.robot.scaffold.held import MASSLESS, Held, held_joints
from excite.robot.scaffold.limbs import Figure
from excite.robot.scaffold.rest import Rest, find_rest, weak_joints
from excite.robot.scaffold.said import Said
from excite.robot.scaffold.solids import box_shapes
from excite.robot.scaffold.stand_in import APART, StandIn
from excite.robot.scaffold.structure import assumed_structure
from excite.robot.scaffold.tied import tied
from excite.robot.scaffold.values import Values
from excite.robot.shapes.collision import TABLE, collision_shapes
from excite.robot.shapes.ground import ground_height, links_below, reach
from excite.robot.urdf.inertia import inertial_faults
from excite.robot.urdf.reading import parse_urdf
from excite.robot.urdf.tree import MAX_NAME, check_tree
from excite.robot.weights import check_weights

# Distance that links keep, of the longest limb's length: 10 mm in arms of a third of a metre and more.
_APART_SHARE = 0.03


def scaffold_description(
    urdf_path: str | Path,
    folder: str | Path | None = None,
    *,
    seed: int = 0,
    floating: bool | None = None,
    said: Said | None = None,
    absolute: bool = False,
) -> str:
    """Text of a ``robot.yaml`` for a URDF: complete, with what had to be assumed under ``assumed``.

    Args:
        urdf_path: the URDF.
        folder: folder that the text will be written to; the URDF's own by default.
        seed: seed of the random postures behind inertia, rest and collision pairs.
        floating: whether the base is free; found from the limbs where None.
        said: what another format said beside the URDF.
        absolute: whether the URDF is named by its whole path.

    Returns:
        YAML text.

    Raises:
        RobotError: the URDF is missing or absurd in a way that no description can mend.
    """
    content = draft(Path(urdf_path), folder, np.random.default_rng(seed), said or Said(floating))
    if absolute:
        content["model"]["path"] = str(Path(urdf_path).resolve())
    head = (
        "# A first description, derived from the model. What no file said stands under assumed, with what follows\n"
        "# from it; each block says its source. Correct what you know better.\n"
    )
    return head + str(
        yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None)
    )


def _nothing_moves(held: dict[str, Held], path: Path) -> RobotError:
    """What to say of a model none of whose joints is left to move."""
    if held and all(one.why == MASSLESS for one in held.values()):
        what, remedy = (
            "states no masses",
            "add <inertial> to its links: the maker's figures, or a CAD program's",
        )
        return RobotError(what, source=path, remedy=remedy)
    named = ", ".join(list(held)[:3])
    remedy = f"state limits that let {named} move" if held else "describe at least one"
    return RobotError("has no joint that moves", source=path, remedy=remedy)


def draft(
    path: Path,
    folder: str | Path | None,
    rng: np.random.Generator,
    said: Said,
    weak: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The content of a first ``robot.yaml``; arguments and errors as for :func:`scaffold_description`.

    Joints in ``weak`` are held still where it says [rad or m].
    """
    weak = weak or {}
    root = parse_urdf(path)
    joints = check_tree(root, path)
    guesses = guess_joints(joints, path)
    slides = {name for name, joint in joints.items() if joint.get("type") == "prismatic"}
    together = tied(joints, said.loops, said.couplings)
    held = held_joints(root, joints, guesses, together.joints, together.closing)
    held |= {name: Held(value, "its drive cannot hold what it carries") for name, value in weak.items()}
    held |= together.holding(held, guesses)
    still_names = _with_followers(held, guesses)
    free = tuple(guess for guess in guesses if guess.name not in still_names)
    if not free:
        raise _nothing_moves(held, path)
    for name, joint in joints.items():
        # As they will be read: what is held moves nothing, and no fault of its inertia matters.
        if name in still_names:
            joint.set("type", "fixed")
    still, loose = (_faults(root, joints, floating, path) for floating in (False, True))
    locked = {name: one.value for name, one in held.items()}
    stand_in = StandIn(path, free, locked, tuple(still), _margin(free), together.moving(held))
    built = stand_in.with_geometry()
    apart = _apart(built.robot)
    if apart < stand_in.apart:
        stand_in = replace(stand_in, apart=apart)
        built = stand_in.with_geometry()
    robot = built.robot
    check_weights(robot.model, robot.model.effortLimit[-robot.n_joints :], path)
    order = {name: index for index, name in enumerate(robot.joint_names)}
    free = tuple(sorted(free, key=lambda guess: order[guess.name]))
    authored = [] if built.kind else box_shapes(robot)
    if built.kind is None:
        robot = stand_in.robot("authored", authored)
    figure = Figure(robot, guessed=built.kind is None)
    rest = find_rest(figure, _wanted(robot, said.posture), said, rng)
    more_weak = weak_joints(figure, rest)
    if more_weak and len(more_weak) < len(free):
        return draft(path, folder, rng, said, {**weak, **more_weak})
    ground = None
    if rest.base != "floating":
        ground = ground_height(figure.model, figure.shapes, rest.q, held_up=rest.base == "held")
    faults = loose if rest.base == "floating" else still
    made = Values(path, robot, free, rest, figure, rng)
    assumed = [*assumed_structure(held, faults, built.fault, rest, ground, figure), *rest.assumed]
    limits, more = made.limits(slides)
    sensors, noise = numbers.sensors(
        made.torque, _base_link(root, joints) if rest.base == "floating" else None
    )
    margin = _margin(free)
    content: dict[str, Any] = {
        "schema": "excite.robot/1",
        "name": path.stem[:MAX_NAME],
        "title": root.get("name", "") or path.stem,
        "model": {
            "path": os.path.relpath(path.resolve(), Path(folder or path.parent).resolve()),
            **(
                {"acknowledged": {k: f"as the model has it: {v}" for k, v in faults.items()}}
                if faults
                else {}
            ),
            "source": f"the file {path.name}",
        },
        "base": rest.base,
        **({"locked_joints": locked} if locked else {}),
        **together.moving(held),
        "posture": {
            "joints": {
                n: round(float(v), 5) for n, v in zip(robot.joint_names, rest.q, strict=True) if abs(v) > 1e-6
            },
            "source": rest.source,
        },
        "limits": {"position": _positions(free, margin), **limits},
        **({"feet": made.feet()} if rest.base == "floating" else {}),
        "sensors": sensors,
        "controller": made.controller(),
        **({"segments": {"pairs": [list(p) for p in guess_pairs(robot)]}} if guess_pairs(robot) else {}),
        "collision": {
            "geometry": built.kind or "authored",
            **({"shapes": authored} if authored else {}),
            "margin": robot.description.collision.margin,
            **({} if ground is None else {"table_height": round(ground, 4)}),
            "ignored_pairs": [list(p) for p in _ignored(rest, figure, ground)],
            "source": "convex hulls of the model's geometry; pairs computed by excite.robot.shapes.ignored_pairs",
        },
        "assumed": [one.model_dump() for one in (*assumed, *more, *noise)],
    }
    follow = {name for name, passive in zip(robot.joint_names, robot.passive, strict=True) if passive}
    for block in (*limits.values(), sensors.get("noise_torque"), *content["controller"].values()):
        if isinstance(block, dict) and "joints" in block:
            block["joints"] = {name: value for name, value in block["joints"].items() if name not in follow}
    return content


def _with_followers(held: Mapping[str, Held], guesses: tuple[JointGuess, ...]) -> set[str]:
    """Names of joints that are held, and of those that follow them."""
    names = set(held)
    while more := {guess.name for guess in guesses if guess.follows in names} - names:
        names |= more
    return names


def _faults(root: Any, joints: dict[str, Any], floating: bool, path: Path) -> dict[str, str]:
    return {name: error.what for name, error in inertial_faults(root, joints, floating, path).items()}


def _margin(free: tuple[JointGuess, ...]) -> float:
    """Margin to the position limits, small against the shortest range [rad or m]."""
    shortest = min((g.position[1] - g.position[0] for g in free if g.position), default=1.0)
    return min(0.03, float(f"{0.05 * shortest:.1g}"))


def _apart(robot: Robot) -> float:
    """Distance that links keep, small against the longest limb [m]."""
    shapes = collision_shapes(robot) if robot.description.collision.geometry != "authored" else ()
    longest = reach(robot.model, shapes, from_base=False)
    return min(APART, float(f"{_APART_SHARE * longest:.1g}")) if longest > 0.0 else APART


def _positions(free: tuple[JointGuess, ...], margin: float) -> dict[str, Any]:
    unlimited = {g.name: [-3.1416, 3.1416] for g in free if g.position is None}
    said = "the model's, less a margin" + (", half a turn either way where it has none" if unlimited else "")
    return {**({"joints": unlimited} if unlimited else {}), "margin": margin, "source": said}


def _wanted(robot: Robot, posture: Mapping[str, float] | None) -> Array:
    """The posture that the model states, else the one nearest to zero that keeps a tenth of the range free."""
    limits = robot.limits
    room = 0.1 * (limits.position_upper - limits.position_lower)
    zero = np.clip(np.zeros(robot.n_joints), limits.position_lower + room, limits.position_upper - room)
    if posture is None:
        return zero
    stated = np.array([posture.get(name, zero[i]) for i, name in enumerate(robot.joint_names)])
    return np.clip(stated, limits.position_lower + 0.2 * room, limits.position_upper - 0.2 * room)


def _base_link(root: Any, joints: dict[str, Any]) -> str:
    children = {str(joint.find("child").get("link")) for joint in joints.values()}
    return next(str(link.get("name")) for link in root.findall("link") if link.get("name") not in children)


def _ignored(rest: Rest, figure: Figure, ground: float | None) -> list[tuple[str, str]]:
    margin = figure.robot.description.collision.margin
    below = [] if ground is None else links_below(figure.model, figure.shapes, rest.q, ground, margin)
    return [*rest.ignored, *((link, TABLE) for link in below)]
