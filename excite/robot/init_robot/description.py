"""A first ``robot.yaml`` for a URDF of one's own: complete and careful, with what was assumed said in it."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin
import yaml

from excite.arrays import Array
from excite.display import count, span
from excite.finding import first_names
from excite.results import Assumed
from excite.robot.description import UncertaintyBlock
from excite.robot.init_robot.assumptions import assume
from excite.robot.init_robot.bare_model import BareModel, bare_model
from excite.robot.init_robot.first_guesses import JointGuess, guess_pairs, held_still, joint_inertias
from excite.robot.init_robot.rest import Rest, find_rest, weak_joints
from excite.robot.legs import UPRIGHT, toppling_stiffness
from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE, ground_height, links_below
from excite.robot.shapes.shape import joints_at
from excite.robot.urdf.converted import Said
from excite.robot.urdf.tree import MAX_NAME

AS_IT_IS = "as the model has it"
"""How the reason begins with which a first description takes a fault of a link's inertia that no person accepted."""


def scaffold_description(
    urdf_path: str | Path,
    folder: str | Path | None = None,
    *,
    seed: int = 0,
    said: Said | None = None,
    absolute: bool = False,
) -> str:
    """Text of a ``robot.yaml`` for a URDF: complete, with what had to be assumed under ``assumed``.

    Args:
        urdf_path: the URDF.
        folder: folder that the text will be written to; the URDF's own by default.
        seed: seed of the random postures behind inertia, rest and collision pairs.
        said: what another format said beside the URDF.
        absolute: whether the URDF is named by its whole path.

    Returns:
        YAML text.

    Raises:
        RobotError: the URDF is missing or absurd in a way that no description can mend.
    """
    content = draft_description(Path(urdf_path), folder, np.random.default_rng(seed), said or Said())
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
    widths = dict(said.uncertainty) if said.uncertainty and rest.base == "fixed" else {}
    place, wide = Path(folder or path.parent), UncertaintyBlock(**widths)
    content = _description_content(model, rest, place, rng, said.armature, wide)
    if widths:
        content["uncertainty"] = widths
    content["assumed"] = [*(one.to_json() for one in said.assumed), *content["assumed"]]
    free = {guess.name for guess in model.free}
    tables = [one for one in said.by_position if {one.joint, one.over or one.joint} <= free]
    if tables:
        content["limits"]["by_position"] = [
            one.model_dump(mode="json", exclude_defaults=True) for one in tables
        ]
    return content


def _description_content(
    model: BareModel,
    rest: Rest,
    folder: Path,
    rng: np.random.Generator,
    armature: Mapping[str, float],
    widths: UncertaintyBlock,
) -> dict[str, Any]:
    """The blocks in their order, of a model that rests so; ``folder`` is where they will be read.

    ``widths``: how far its bodies may be from what the model says, or what was assumed of them.
    """
    robot, path, figure = model.robot, model.path, model.figure
    # Where weight meets each leg, in the frame of the joint at its end: a point foot's point, a sole's ankle.
    places = {}
    for joint, foot in zip(rest.legs, rest.feet, strict=True):
        link = robot.model.frames[robot.model.getFrameId(foot.link, pin.BODY)].placement
        narrow = len(foot.sole) < 3
        places[joint] = np.asarray(link.act(np.mean(foot.sole, axis=0))) if narrow else np.zeros(3)
    names, mass, legs = robot.joint_names, float(figure.beyond[0]), places
    # What the drives' torques turn: the bodies and the rotors.
    inertia = joint_inertias(robot, rng) + [armature.get(name, 0.0) for name in names]
    # A stated torque that lifts so many of the whole robot, a metre away, stands for no limit. In the URDFs looked at
    # those that do (10000, 50000, 1e9 N·m) lift 10 of it and more, the strongest drives 6 (a gripper) and 3.5
    # (Minitaur). Alexander's 1000 N·m lift 2.2 of it and are believed.
    most = 8.0 * 9.81 * mass
    free = [replace(g, torque=None) if g.torque and g.torque > most else g for g in model.free]
    loads = weight_loads(robot, rng, legs, 9.81 * mass if legs else 0.0)
    ground = None
    if rest.base != "floating":
        ground = ground_height(figure.model, figure.shapes, rest.q, held_up=rest.base == "held")
    assumed = [*assumed_structure(model, rest, ground), *rest.assumed]
    # A drive that nobody stated holds the heaviest of the bodies that motions are judged for.
    heaviest = (1.0 + widths.mass) * (loads + 9.81 * widths.com * figure.beyond[1:])
    limits = limits_block(model, free, inertia, heaviest, assumed)
    stated = limits.get("torque", {"joints": {}})["joints"]
    torque = {g.name: stated.get(g.name, g.torque or 1.0) for g in free}
    note_friction(model.joints, free, torque, assumed)
    controller = controller_block(robot, inertia, loads, legs, mass, assumed)
    sensors = sensors_block(torque, model.base_link if rest.base == "floating" else None, assumed)
    joints = {n: round(float(v), 5) for n, v in zip(names, rest.q, strict=True) if abs(v) > 1e-6}
    accepted = {name: f"{AS_IT_IS}: {fault}" for name, fault in model.faults[rest.base == "floating"].items()}
    rotors = {name: float(f"{armature[name]:.6g}") for name in names if name in armature}
    wide = {g.name: [-3.1416, 3.1416] for g in free if g.position is None}
    position = "the model's, less a margin" + ", half a turn either way where it has none" * bool(wide)
    where = os.path.relpath(path.resolve(), folder.resolve())
    content: dict[str, Any] = {
        "schema": "excite.robot/1",
        "name": path.stem[:MAX_NAME],
        "title": model.root.get("name", "") or path.stem,
        "model": _drop_empty(path=where, acknowledged=accepted, source=f"the file {path.name}"),
        "base": rest.base,
        "locked_joints": model.locked,
        **model.moving,
        "posture": {"joints": joints, "source": rest.source},
        "limits": {"position": _drop_empty(joints=wide, margin=model.margin, source=position), **limits},
        "feet": feet_block(rest),
        "sensors": sensors,
        "controller": controller,
        "drives": {"armature": {"joints": rotors, "source": "the model's armature"}} if rotors else {},
        "segments": _drop_empty(pairs=[list(pair) for pair in guess_pairs(robot)]),
        "collision": _collision_block(model, rest, ground),
    }
    content = {**_drop_empty(**content), "assumed": [one.to_json() for one in assumed]}
    follow = {name for name, passive in zip(names, robot.passive, strict=True) if passive}
    drives = content.get("drives", {}).values()
    for block in (*limits.values(), sensors["noise_torque"], *controller.values(), *drives):
        block["joints"] = {name: value for name, value in block["joints"].items() if name not in follow}
    return content


def _drop_empty(**content: Any) -> dict[str, Any]:
    """A block without what is empty in it."""
    return {name: value for name, value in content.items() if value not in ({}, [])}


def _collision_block(model: BareModel, rest: Rest, ground: float | None) -> dict[str, Any]:
    """The block ``collision``; ``ground`` is the table's height [m], None for a robot that stands on it."""
    block, figure = model.robot.description.collision, model.figure
    built = "convex hulls of the model's geometry" if model.geometry.kind else ""
    boxes = "boxes of the links' inertia where there is none" if block.stand_ins else ""
    near = [{"links": list(pair), "distance": distance} for pair, distance in rest.near.items()]
    below = [] if ground is None else links_below(figure.model, figure.shapes, rest.q, ground, block.margin)
    return {
        **_drop_empty(
            geometry=model.geometry.kind or "authored",
            shapes=model.authored,
            stand_ins=list(block.stand_ins),
            margin=block.margin,
            table_height=[] if ground is None else round(ground, 4),
            near_pairs=near,
        ),
        "ignored_pairs": [list(pair) for pair in (*rest.ignored, *((link, TABLE) for link in below))],
        "source": f"{', '.join(filter(None, (built, boxes)))}; pairs computed by excite.robot.shapes.collision",
    }


def _wanted_posture(robot: Robot, posture: Mapping[str, float] | None) -> Array:
    """The posture that the model states, else the one nearest to zero that keeps a tenth of the range free."""
    limits = robot.limits
    room = 0.1 * (limits.position_upper - limits.position_lower)
    zero = np.clip(np.zeros(robot.n_joints), limits.position_lower + room, limits.position_upper - room)
    if posture is None:
        return zero
    stated = np.array([posture.get(name, zero[i]) for i, name in enumerate(robot.joint_names)])
    return np.clip(stated, limits.position_lower + 0.2 * room, limits.position_upper - 0.2 * room)


# What had to be assumed, by consequence, and blocks that follow from the robot, its rest and its model's limits.

FRICTION = 0.5
"""Friction of soles that nobody stated: rubber on a dusty floor has 0.5 … 0.8."""


def assumed_structure(model: BareModel, rest: Rest, ground: float | None) -> list[Assumed]:
    """Joints held or kept in a range, inertia, geometry and ground (or soles' friction) as they were assumed."""
    figure = model.figure
    block, shaped = figure.robot.description.collision, {shape.joint for shape in figure.shapes}
    boxes = [shape.link for shape in block.shapes if shape.link in block.stand_ins]
    why = f" ({model.geometry.fault[:150]})" if model.geometry.fault else ""
    endless = [guess.name for guess in model.free if guess.position is None]
    bare = [segment.link for segment in figure.robot.segments if segment.joint not in shaped]
    faulty = model.faults[rest.base == "floating"]
    named = {"ranged": model.ranged, "endless": endless, "inertia": faulty, "boxes": boxes, "bare": bare}
    links = count(len(boxes), "link")
    found = [
        *held_still(model.held),
        *(assume(key, names=first_names([*of]), links=links, why=why) for key, of in named.items() if of),
    ]
    if ground is None:
        return [*found, assume("friction", friction=FRICTION)]
    below = links_below(figure.model, figure.shapes, rest.q, ground, block.margin)
    excepted = f"; excepted: {', '.join(below)}" if below else ""
    return [*found, assume("floor" if rest.base == "held" else "ground", height=ground, excepted=excepted)]


# What arms that people work beside keep to [rad/s, m/s]; a sixth of it for slides.
_VELOCITY, _SLIDE_VELOCITY = 1.5, 0.25
# Bundled robots have 3 to 30 rad/s²; without a torque limit nothing says what the drive can do.
_ACCELERATION, _UNKNOWN_ACCELERATION = 30.0, 5.0


def two_digits(value: float) -> float:
    """Rounded to two significant digits, never to zero."""
    return float(f"{max(value, 1e-6):.2g}")


def limits_block(
    model: BareModel, free: Sequence[JointGuess], inertia: Array, loads: Array, assumed: list[Assumed]
) -> dict[str, Any]:
    """The block ``limits`` without positions, each on the careful side; what it assumes goes to ``assumed``.

    Args:
        free: the joints, without torque limits that stand for none.
        inertia: largest inertia at each joint, ``(n_joints,)``.
        loads: largest torque of weight at each joint, ``(n_joints,)``.
        assumed: gets what was assumed.
    """
    velocity, torque, acceleration, jerk = (dict[str, float]() for _ in range(4))
    for guess, own, load in zip(free, inertia, loads, strict=True):
        name = guess.name
        if guess.velocity is None:
            slides = model.joints[name].get("type") == "prismatic"
            velocity[name] = _SLIDE_VELOCITY if slides else _VELOCITY
        if guess.torque is None:
            # A drive is chosen for about twice the weight that it holds and moves.
            torque[name] = two_digits(max(3.0 * (load + own * _UNKNOWN_ACCELERATION), 0.1))
        # Share of the torque limit that a proposed acceleration limit may use on the joint's own inertia.
        share = 0.3 * guess.torque / own if guess.torque and own > 0.0 else _UNKNOWN_ACCELERATION
        acceleration[name] = min(two_digits(min(_ACCELERATION, share)), guess.acceleration or math.inf)
        jerk[name] = min(20.0 * acceleration[name], guess.jerk or math.inf)
    chosen = {guess.name: jerk[guess.name] for guess in free if jerk[guess.name] != guess.jerk}
    # Zero says something where others state more.
    zero = [
        g.name for g, passive in zip(free, model.robot.passive, strict=True) if g.effortless and not passive
    ]
    held = ""
    if any(guess.torque for guess in free) and zero:
        held = (
            f"; it is 0 in the model for {first_names(zero)}: hold under locked_joints what no motor drives"
        )
    told = {"zero": held, "turns": _VELOCITY, "slides": _SLIDE_VELOCITY}
    kinds = {"torque": torque, "velocity": velocity, "acceleration": acceleration, "jerk": chosen}
    for key, of in kinds.items():
        if of:
            values = span(f"{min(of.values()):g}", f"{max(of.values()):g}")
            assumed.append(assume(key, joints=len(of), values=values, **told))
    said = "assumed for joints whose limit the model does not state"
    rule = "30 % of the torque limit on the largest inertia at the joint, at most 30 rad/s²"
    sources = {
        "velocity": (velocity, said),
        "torque": (torque, said),
        "acceleration": (acceleration, rule),
        "jerk": (jerk, "so that full acceleration takes 0.05 s to build up"),
    }
    return {name: {"joints": of, "source": source} for name, (of, source) in sources.items() if of}


def feet_block(rest: Rest) -> list[dict[str, Any]]:
    """The block ``feet``: sole, radius and friction of each."""
    kinds = {1: "point", 2: "edge"}
    return [
        {
            "name": foot.link,
            "link": foot.link,
            "sole": [[round(float(x), 5) + 0.0 for x in corner] for corner in foot.sole],
            **({"radius": foot.radius} if foot.radius else {}),
            "friction": FRICTION,
            "source": f"{kinds.get(len(foot.sole), 'polygon')} where the link's geometry is lowest in the posture"
            " above; friction assumed",
        }
        for foot in rest.feet
    ]


def note_friction(
    joints: Mapping[str, Element],
    free: Sequence[JointGuess],
    torque: Mapping[str, float],
    assumed: list[Assumed],
) -> None:
    """Say what the model's ``<dynamics>`` would take of the drives' ``torque`` limits [N·m or N], which nothing counts.

    Friction there is a drive's in some models and a simulator's damping in others, which nothing in the file tells.
    """
    shares: dict[str, float] = {}
    for guess in free:
        for dynamics in joints[guess.name].findall("dynamics"):
            dry, viscous = (float(dynamics.get(name, "0")) for name in ("friction", "damping"))
            share = (dry + viscous * (guess.velocity or 0.0)) / torque[guess.name]
            if share > 0.0:
                shares[guess.name] = share
    if shares:
        worst = max(shares, key=lambda name: shares[name])
        at = count(len(shares), "joint")
        assumed.append(assume("dynamics", joints=at, share=shares[worst], joint=worst))


def weight_loads(robot: Robot, rng: np.random.Generator, legs: Mapping[int, Array], weight: float) -> Array:
    """Largest torque of weight at each joint over random postures, of legs with the robot's weight at their ends.

    Args:
        rng: draws the postures.
        legs: by the joint at a leg's end, where it touches the ground in that joint's frame ``(3,)`` [m].
        weight: of the robot [N].
    """
    data, drawn = robot.model.createData(), robot.draw_configurations(rng, 30)
    tau = np.array([pin.computeGeneralizedGravity(robot.model, data, q).copy() for q in drawn])
    loads = np.abs(robot.on_motors(np.array(drawn), tau)).max(axis=0)
    for _, index, reach in _leg_reaches(robot, legs):
        loads[index] = max(loads[index], 0.5 * weight * reach / max(len(legs) // 2, 1))
    return np.asarray(loads)


def _leg_reaches(robot: Robot, legs: Mapping[int, Array]) -> list[tuple[int, int, float]]:
    """Joints at ends of legs, indices of the joints of these, and how far the ground is from each at rest [m]."""
    data, found = joints_at(robot.model, robot.rest), []
    for leg, tip in legs.items():
        ground = data.oMi[leg].act(tip)
        for joint in list(robot.model.supports[leg])[1:]:
            reach = float(np.linalg.norm(ground - data.oMi[joint].translation))
            found.append((leg, joint - 1, max(reach, 0.1)))
    return found


def controller_block(
    robot: Robot,
    inertia: Array,
    loads: Array,
    legs: Mapping[int, Array],
    mass: float,
    assumed: list[Assumed],
) -> dict[str, Any]:
    """The block ``controller``, stiffness and damping of servos that give way by little under the weight they carry.

    Args:
        inertia: largest inertia at each joint, ``(n_joints,)``.
        loads: largest torque of weight at each joint, ``(n_joints,)``.
        legs: as for :func:`weight_loads`.
        mass: of the robot [kg].
        assumed: gets what was assumed.
    """
    topples, loaded = np.zeros(robot.n_joints), np.zeros(robot.n_joints)
    soles = [leg for leg, tip in legs.items() if not tip.any()]
    for joint, stiffness in toppling_stiffness(robot, soles, mass).items():
        topples[joint - 1] = stiffness
    for leg, index, reach in _leg_reaches(robot, legs):
        # A leg on a point is damped as it swings: damped as the robot sways, it drags at its point (with a quarter of
        # that damping feet of the HyQ slip by 3 mm in place of 12).
        loaded[index] = 0.0 if legs[leg].any() else mass / len(legs) * reach**2
    # What weight bends a joint by [rad]: with it the bundled G1 has the 8000 N·m/rad with which it stands in
    # simulation as the real one does, and the Go2 the 2000 with which its trunk follows.
    # Natural frequency of the servo on the joint's own inertia, and on the robot's that a leg carries [Hz]; its
    # damping.
    stiff = np.maximum(inertia * (2.0 * math.pi * 8.0) ** 2, loads / 0.0125)
    # Damped for its load alone: of ten leg swings of an H1_2 seven stand with ankles damped for this stiffness, and
    # six with three tenths of that.
    damping = 2.0 * 0.7 * np.sqrt(stiff * np.maximum(inertia, loaded))
    gains = {
        kind: {n: max(two_digits(float(v)), 0.01) for n, v in zip(robot.joint_names, values, strict=True)}
        for kind, values in (("kp", np.maximum(stiff, UPRIGHT * topples)), ("kd", damping))
    }
    if legs:
        of_legs = [gains["kp"][robot.joint_names[joint - 1]] for joint in legs]
        size = " … ".join(f"{value:g}" for value in sorted({min(of_legs), max(of_legs)}))
        assumed.append(assume("gains", size=size))
    said = "a servo that its load's weight bends by 0.7 degrees, of 8 Hz at least, damping 0.7"
    said += ", legs on soles twenty times stiffer than what topples the robot" * bool(soles)
    return {name: {"joints": values, "source": said} for name, values in gains.items()}


def sensors_block(
    torque: Mapping[str, float], base_link: str | None, assumed: list[Assumed]
) -> dict[str, Any]:
    """The block ``sensors``: joint torques and, where ``base_link`` floats, an IMU there."""
    more: dict[str, Any] = {}
    if base_link is not None:
        more = {
            "noise_base_position": 1e-3,
            "noise_base_orientation": 1e-3,
            "imu": {"link": base_link, "noise_gyro": 5e-3, "noise_acceleration": 0.05},
        }
    assumed.append(assume("sensors", more=", an IMU on the base, no force sensor" * bool(more)))
    return {
        "rate_hz": 200.0,
        "noise_position": 1e-4,
        "joint_torque": "motor_side",
        # Torques of motor currents are seldom known better than to a hundredth of full scale.
        "noise_torque": {
            "joints": {name: two_digits(0.005 * most) for name, most in torque.items()},
            "source": "assumed: 0.5 % of the torque limit",
        },
        **more,
        "source": "assumed; no model says it",
    }
