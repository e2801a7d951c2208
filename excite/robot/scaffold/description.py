"""A first ``robot.yaml`` for a URDF of one's own: complete and careful, with what was assumed said in it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from excite.arrays import Array
from excite.robot.robot import Robot
from excite.robot.scaffold import numbers
from excite.robot.scaffold.bare_model import BareModel, bare_model
from excite.robot.scaffold.guesses import JointGuess, guess_pairs
from excite.robot.scaffold.limbs import Figure
from excite.robot.scaffold.rest import Rest, find_rest, weak_joints
from excite.robot.scaffold.said import Said
from excite.robot.scaffold.structure import assumed_structure
from excite.robot.scaffold.values import Values
from excite.robot.shapes.collision import TABLE
from excite.robot.shapes.ground import ground_height, links_below
from excite.robot.urdf.tree import MAX_NAME

AS_IT_IS = "as the model has it"
"""How the reason begins with which a first description takes a fault of a link's inertia that no person accepted."""


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
    content = draft_description(Path(urdf_path), folder, np.random.default_rng(seed), said or Said(floating))
    if absolute:
        content["model"]["path"] = str(Path(urdf_path).resolve())
    head = (
        "# A first description, derived from the model. What no file said stands under assumed, with what follows\n"
        "# from it; each block says its source. Correct what you know better, and take out of assumed what is then\n"
        "# not assumed any more: pages repeat that list as it stands here.\n"
    )
    return head + str(
        yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None)
    )


def draft_description(
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
    model = bare_model(path, said, weak)
    rest = find_rest(model.figure, _wanted_posture(model.robot, said.posture), said, rng)
    more_weak = weak_joints(model.figure, rest)
    if more_weak and len(more_weak) < len(model.free):
        return draft_description(path, folder, rng, said, {**weak, **more_weak})
    content = _description_content(model, rest, Path(folder or path.parent), rng, said.armature)
    content["assumed"] = [*(one.model_dump() for one in said.assumed), *content["assumed"]]
    return content


def _description_content(
    model: BareModel, rest: Rest, folder: Path, rng: np.random.Generator, armature: Mapping[str, float]
) -> dict[str, Any]:
    """The blocks in their order, of a model that rests so; ``folder`` is where they will be read."""
    robot, path, stands = model.robot, model.path, rest.base == "floating"
    rotors = {n: armature[n] for n in robot.joint_names if n in armature}
    made = Values.of(robot, model.free, rest, float(model.figure.beyond[0]), rng, rotors)
    slides = {name for name, joint in model.joints.items() if joint.get("type") == "prismatic"}
    limits, more = made.limits(slides)
    sensors, noise = numbers.guess_sensors(
        made.torque, _base_link(model.root, model.joints) if stands else None
    )
    ground = None
    if not stands:
        held_up = rest.base == "held"
        ground = ground_height(model.figure.model, model.figure.shapes, rest.q, held_up=held_up)
    unlimited = tuple(g.name for g in model.free if g.position is None)
    structure = assumed_structure(
        model.held,
        model.faults[stands],
        model.geometry.fault,
        rest,
        ground,
        model.figure,
        model.ranged,
        unlimited,
    )
    more += numbers.uncounted_friction(model.joints, model.free, made.torque)
    controller, stiff = made.controller()
    joints = {n: round(float(v), 5) for n, v in zip(robot.joint_names, rest.q, strict=True) if abs(v) > 1e-6}
    pairs = [list(pair) for pair in guess_pairs(robot)]
    content: dict[str, Any] = {
        "schema": "excite.robot/1",
        "name": path.stem[:MAX_NAME],
        "title": model.root.get("name", "") or path.stem,
        "model": _model_block(path, folder, model.faults[stands]),
        "base": rest.base,
        **({"locked_joints": model.locked} if model.held else {}),
        **model.moving,
        "posture": {"joints": joints, "source": rest.source},
        "limits": {"position": _position_block(model.free, model.margin), **limits},
        **({"feet": made.feet()} if stands else {}),
        "sensors": sensors,
        "controller": controller,
        **({"drives": {"armature": _armature_block(rotors)}} if rotors else {}),
        **({"segments": {"pairs": pairs}} if pairs else {}),
        "collision": _collision_block(model, rest, ground),
        "assumed": [one.model_dump() for one in (*structure, *rest.assumed, *more, *stiff, *noise)],
    }
    follow = {name for name, passive in zip(robot.joint_names, robot.passive, strict=True) if passive}
    drives = content.get("drives", {}).values()
    for block in (*limits.values(), sensors.get("noise_torque"), *controller.values(), *drives):
        if isinstance(block, dict) and "joints" in block:
            block["joints"] = {name: value for name, value in block["joints"].items() if name not in follow}
    return content


def _model_block(path: Path, folder: Path, faults: dict[str, str]) -> dict[str, Any]:
    """The block ``model``: where the file is, seen from a folder, and what is wrong with it."""
    taken = {"acknowledged": {k: f"{AS_IT_IS}: {v}" for k, v in faults.items()}} if faults else {}
    where = os.path.relpath(path.resolve(), folder.resolve())
    return {"path": where, **taken, "source": f"the file {path.name}"}


def _armature_block(rotors: Mapping[str, float]) -> dict[str, Any]:
    """The block ``drives.armature`` of joints whose rotor inertia the model states [kg·m² or kg]."""
    joints = {name: float(f"{value:.6g}") for name, value in rotors.items()}
    return {"joints": joints, "source": "the model's armature"}


def _collision_block(model: BareModel, rest: Rest, ground: float | None) -> dict[str, Any]:
    """The block ``collision``; ``ground`` is the table's height [m], None for a robot that stands on it."""
    block = model.robot.description.collision
    built = "convex hulls of the model's geometry" if model.geometry.kind else ""
    boxes = "boxes of the links' inertia where there is none" if block.stand_ins else ""
    shapes = ", ".join(filter(None, (built, boxes)))
    near = [{"links": list(pair), "distance": distance} for pair, distance in rest.near.items()]
    return {
        "geometry": model.geometry.kind or "authored",
        **({"shapes": model.authored} if model.authored else {}),
        **({"stand_ins": list(block.stand_ins)} if block.stand_ins else {}),
        "margin": block.margin,
        **({} if ground is None else {"table_height": round(ground, 4)}),
        **({"near_pairs": near} if near else {}),
        "ignored_pairs": [list(p) for p in _ignored_pairs_of(rest, model.figure, ground)],
        "source": f"{shapes}; pairs computed by excite.robot.shapes.ignored_pairs",
    }


def _position_block(free: tuple[JointGuess, ...], margin: float) -> dict[str, Any]:
    unlimited = {g.name: [-3.1416, 3.1416] for g in free if g.position is None}
    said = "the model's, less a margin" + (", half a turn either way where it has none" if unlimited else "")
    return {**({"joints": unlimited} if unlimited else {}), "margin": margin, "source": said}


def _wanted_posture(robot: Robot, posture: Mapping[str, float] | None) -> Array:
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


def _ignored_pairs_of(rest: Rest, figure: Figure, ground: float | None) -> list[tuple[str, str]]:
    margin = figure.robot.description.collision.margin
    below = [] if ground is None else links_below(figure.model, figure.shapes, rest.q, ground, margin)
    return [*rest.ignored, *((link, TABLE) for link in below)]
