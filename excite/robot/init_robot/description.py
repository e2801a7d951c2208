"""A first ``robot.yaml`` for a URDF of one's own: complete and careful, with what was assumed said in it."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import yaml

from excite.arrays import Array
from excite.display import count, span
from excite.finding import first_names
from excite.results import Assumed
from excite.robot.init_robot.bare_model import BareModel, bare_model
from excite.robot.init_robot.first_guesses import (
    FRICTION,
    JointGuess,
    assumed_structure,
    guess_pairs,
    joint_inertias,
)
from excite.robot.init_robot.model_metadata import Said
from excite.robot.init_robot.rest import Rest, find_rest, weak_joints
from excite.robot.legs import UPRIGHT, toppling_stiffness
from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE, ground_height, links_below
from excite.robot.urdf.tree import MAX_NAME, link_at

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
    content["assumed"] = [*(one.to_json() for one in said.assumed), *content["assumed"]]
    free = {guess.name for guess in model.free}
    tables = [one for one in said.by_position if {one.joint, one.over or one.joint} <= free]
    if tables:
        content["limits"]["by_position"] = [
            one.model_dump(mode="json", exclude_defaults=True) for one in tables
        ]
    return content


def _description_content(
    model: BareModel, rest: Rest, folder: Path, rng: np.random.Generator, armature: Mapping[str, float]
) -> dict[str, Any]:
    """The blocks in their order, of a model that rests so; ``folder`` is where they will be read."""
    robot, path, stands, free = model.robot, model.path, rest.base == "floating", model.free
    names, mass, legs = robot.joint_names, float(model.figure.beyond[0]), _leg_contacts(robot, rest)
    rotors = {name: armature[name] for name in names if name in armature}
    # What the drives' torques turn: the bodies and the rotors.
    inertia = joint_inertias(robot, rng) + [rotors.get(name, 0.0) for name in names]
    # Torque limits that lift the robot many times stand for none.
    # A stated torque that lifts so many of the whole robot, a metre away, stands for no limit. In the URDFs looked at
    # those that do (10000, 50000, 1e9 N·m) lift 10 of it and more, the strongest drives 6 (a gripper) and 3.5
    # (Minitaur). Alexander's 1000 N·m lift 2.2 of it and are believed.
    most = 8.0 * 9.81 * mass
    free = tuple(replace(g, torque=None) if g.torque and g.torque > most else g for g in free)
    loads = weight_loads(robot, rng, legs, 9.81 * mass if legs else 0.0)
    torques, said = torque_limits(robot, free, loads, inertia)
    torque = {g.name: torques.get(g.name, g.torque or 1.0) for g in free}
    slides = {name for name, joint in model.joints.items() if joint.get("type") == "prismatic"}
    limits, more = limits_block(free, inertia, torques, slides)
    sensors, noise = guess_sensors(torque, _base_link(model.root, model.joints) if stands else None)
    ground = None
    if not stands:
        held_up = rest.base == "held"
        ground = ground_height(model.figure.model, model.figure.shapes, rest.q, held_up=held_up)
    unlimited = tuple(g.name for g in free if g.position is None)
    faults = model.faults[stands]
    structure = assumed_structure(
        model.held, faults, model.geometry.fault, rest, ground, model.figure, model.ranged, unlimited
    )
    controller, stiff = controller_block(robot, inertia, loads, legs, mass)
    friction = uncounted_friction(model.joints, free, torque)
    joints = {n: round(float(v), 5) for n, v in zip(names, rest.q, strict=True) if abs(v) > 1e-6}
    pairs = [list(pair) for pair in guess_pairs(robot)]
    accepted = {"acknowledged": {k: f"{AS_IT_IS}: {v}" for k, v in faults.items()}} if faults else {}
    where = os.path.relpath(path.resolve(), folder.resolve())
    inertias = {name: float(f"{value:.6g}") for name, value in rotors.items()}
    wide = {name: [-3.1416, 3.1416] for name in unlimited}
    position = "the model's, less a margin" + ", half a turn either way where it has none" * bool(wide)
    content: dict[str, Any] = {
        "schema": "excite.robot/1",
        "name": path.stem[:MAX_NAME],
        "title": model.root.get("name", "") or path.stem,
        "model": {"path": where, **accepted, "source": f"the file {path.name}"},
        "base": rest.base,
        "locked_joints": model.locked,
        **model.moving,
        "posture": {"joints": joints, "source": rest.source},
        "limits": {
            "position": {**({"joints": wide} if wide else {}), "margin": model.margin, "source": position},
            **limits,
        },
        "feet": feet_block(rest),
        "sensors": sensors,
        "controller": controller,
        "drives": {"armature": {"joints": inertias, "source": "the model's armature"}} if rotors else {},
        "segments": {"pairs": pairs} if pairs else {},
        "collision": _collision_block(model, rest, ground),
    }
    content = {name: block for name, block in content.items() if block not in ({}, [])}
    assumed = (*structure, *rest.assumed, *said, *more, *friction, *stiff, *noise)
    content["assumed"] = [one.to_json() for one in assumed]
    follow = {name for name, passive in zip(names, robot.passive, strict=True) if passive}
    drives = content.get("drives", {}).values()
    for block in (*limits.values(), sensors["noise_torque"], *controller.values(), *drives):
        block["joints"] = {name: value for name, value in block["joints"].items() if name not in follow}
    return content


def _collision_block(model: BareModel, rest: Rest, ground: float | None) -> dict[str, Any]:
    """The block ``collision``; ``ground`` is the table's height [m], None for a robot that stands on it."""
    block, figure = model.robot.description.collision, model.figure
    built = "convex hulls of the model's geometry" if model.geometry.kind else ""
    boxes = "boxes of the links' inertia where there is none" if block.stand_ins else ""
    near = [{"links": list(pair), "distance": distance} for pair, distance in rest.near.items()]
    below = [] if ground is None else links_below(figure.model, figure.shapes, rest.q, ground, block.margin)
    content = {
        "geometry": model.geometry.kind or "authored",
        "shapes": model.authored,
        "stand_ins": list(block.stand_ins),
        "margin": block.margin,
        "table_height": [] if ground is None else round(ground, 4),
        "near_pairs": near,
    }
    return {
        **{name: value for name, value in content.items() if value != []},
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


def _base_link(root: Any, joints: dict[str, Any]) -> str:
    children = {link_at(joint, "child") for joint in joints.values()}
    return next(str(link.get("name")) for link in root.findall("link") if link.get("name") not in children)


# Blocks of a first description that follow from the robot, its rest and its model's limits.


def limits_block(
    free: tuple[JointGuess, ...], inertia: Array, torques: dict[str, float], slides: set[str]
) -> tuple[dict[str, Any], list[Assumed]]:
    """The block ``limits`` without positions, and what was assumed for it.

    Args:
        free: the joints, without torque limits that stand for none.
        inertia: largest inertia at each joint, ``(n_joints,)``.
        torques: torque limits that the model does not state.
        slides: joints along an axis.
    """
    velocities, assumed = velocity_limits(free, slides)
    accelerations, jerks = dict[str, float](), dict[str, float]()
    for guess, own in zip(free, inertia, strict=True):
        known = guess.torque is not None and own > 0.0
        # Share of the torque limit that a proposed acceleration limit may use on the joint's own inertia.
        share = 0.3 * (guess.torque or 0.0) / own if known else _UNKNOWN_ACCELERATION
        most = min(two_digits(min(_ACCELERATION, share)), guess.acceleration or math.inf)
        accelerations[guess.name], jerks[guess.name] = most, min(20.0 * most, guess.jerk or math.inf)
    said = "assumed for joints whose limit the model does not state"
    rule = "30 % of the torque limit on the largest inertia at the joint, at most 30 rad/s²"
    soft = "so that full acceleration takes 0.05 s to build up"
    rows = (
        ("velocity", velocities, said),
        ("torque", torques, said),
        ("acceleration", accelerations, rule),
        ("jerk", jerks, soft),
    )
    block = {name: {"joints": values, "source": source} for name, values, source in rows if values}
    assumed.append(
        Assumed(
            "acceleration limits",
            f"{_spanned(accelerations.values())} rad/s² or m/s², 30 % of the torque limit on the largest inertia",
            "motions may be slower than the robot allows, or faster than its maker does",
        )
    )
    chosen = [jerks[guess.name] for guess in free if jerks[guess.name] != guess.jerk]
    if chosen:
        value = f"{_spanned(chosen)} rad/s³ or m/s³, full acceleration within 0.05 s"
        consequence = (
            "motions may start and turn softer than the robot has to, or harder than its maker lets it"
        )
        assumed.append(Assumed("jerk limits", value, consequence))
    return block, assumed


def _spanned(values: Collection[float]) -> str:
    return span(f"{min(values):g}", f"{max(values):g}")


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


def controller_block(
    robot: Robot, inertia: Array, loads: Array, legs: Mapping[int, Array], mass: float
) -> tuple[dict[str, Any], list[Assumed]]:
    """The block ``controller``, gains of a servo at each joint, and what was assumed for it.

    Arguments as for :func:`guess_gains`.
    """
    found = guess_gains(robot, inertia, loads, legs, mass)
    said = "a servo that its load's weight bends by 0.7 degrees, of 8 Hz at least, damping 0.7"
    if any(not tip.any() for tip in legs.values()):
        said += ", legs on soles twenty times stiffer than what topples the robot"
    block = {name: {"joints": values, "source": said} for name, values in found.items()}
    if not legs:
        return block, []
    of_legs = [found["kp"][robot.joint_names[joint - 1]] for joint in legs]
    size = " … ".join(f"{value:g}" for value in sorted({min(of_legs), max(of_legs)}))
    value = f"kp {size} N·m/rad at the ends of the legs, as stiff as geared position servos are"
    consequence = (
        "motions are rehearsed with them, without feedback of balance: a robot with softer servos "
        "may fall where this one stands: state controller.kp and kd"
    )
    return block, [Assumed("servo gains", value, consequence)]


def _leg_contacts(robot: Robot, rest: Rest) -> dict[int, Array]:
    """Where weight meets each leg, in the frame of the joint at its end: a point foot's point, a sole's ankle."""
    places = {}
    for joint, foot in zip(rest.legs, rest.feet, strict=True):
        link = robot.model.frames[robot.model.getFrameId(foot.link, pin.BODY)].placement
        narrow = len(foot.sole) < 3
        places[joint] = np.asarray(link.act(np.mean(foot.sole, axis=0))) if narrow else np.zeros(3)
    return places


# Numbers that a bare model lacks: limits, gains and noise, each on the careful side, and what was assumed for
# them.

# What arms that people work beside keep to [rad/s, m/s]; a sixth of it for slides.
_VELOCITY, _SLIDE_VELOCITY = 1.5, 0.25
# Bundled robots have 3 to 30 rad/s²; without a torque limit nothing says what the drive can do.
_ACCELERATION, _UNKNOWN_ACCELERATION = 30.0, 5.0
# Natural frequency of the servo on the joint's own inertia, and on the robot's that a leg carries [Hz]; its damping.
_FREQUENCY, _DAMPING = 8.0, 0.7


def two_digits(value: float) -> float:
    """Rounded to two significant digits, never to zero."""
    return float(f"{max(value, 1e-6):.2g}")


def torque_limits(
    robot: Robot, guesses: tuple[JointGuess, ...], loads: Array, inertia: Array
) -> tuple[dict[str, float], list[Assumed]]:
    """Torque limits that the model does not state, by joint, from weight ``loads`` and ``inertia`` ``(n_joints,)``."""
    # A drive is chosen for about twice the weight that it holds and moves.
    needed = 3.0 * (loads + inertia * _UNKNOWN_ACCELERATION)
    found = {g.name: two_digits(max(needed[i], 0.1)) for i, g in enumerate(guesses) if g.torque is None}
    if not found:
        return {}, []
    value = f"three times weight and inertia at {len(found)} joints"
    consequence = "a motion may ask more of a drive than it gives: state limits.torque"
    # Zero says something where others state more.
    stating = any(guess.torque for guess in guesses)
    zero = [g.name for g, passive in zip(guesses, robot.passive, strict=True) if g.effortless and not passive]
    if stating and zero:
        consequence += (
            f"; it is 0 in the model for {first_names(zero)}: hold under locked_joints what no motor drives"
        )
    return found, [Assumed(what="torque limits", value=value, consequence=consequence)]


def uncounted_friction(
    joints: Mapping[str, ElementTree.Element], guesses: tuple[JointGuess, ...], torque: Mapping[str, float]
) -> list[Assumed]:
    """What the model's ``<dynamics>`` would take of the drives' ``torque`` limits [N·m or N], which nothing counts.

    Friction there is a drive's in some models and a simulator's damping in others, which nothing in the file tells.
    """
    shares: dict[str, float] = {}
    for guess in guesses:
        for dynamics in joints[guess.name].findall("dynamics"):
            dry, viscous = (float(dynamics.get(name, "0")) for name in ("friction", "damping"))
            share = (dry + viscous * (guess.velocity or 0.0)) / torque[guess.name]
            if share > 0.0:
                shares[guess.name] = share
    if not shares:
        return []
    worst = max(shares, key=lambda name: shares[name])
    what = f"friction that the model states at {count(len(shares), 'joint')}"
    value = f"not counted; at full speed it would take {shares[worst]:.2g} of the torque limit of {worst}"
    consequence = (
        "a motion may ask more of a drive than it gives, unless that is a simulator's damping: state "
        "drives.viscous and drives.coulomb"
    )
    return [Assumed(what, value, consequence)]


def velocity_limits(
    guesses: tuple[JointGuess, ...], slides: set[str]
) -> tuple[dict[str, float], list[Assumed]]:
    """Velocity limits that the model does not state, by joint."""
    found = {
        g.name: _SLIDE_VELOCITY if g.name in slides else _VELOCITY for g in guesses if g.velocity is None
    }
    if not found:
        return {}, []
    value = f"{_VELOCITY} rad/s or {_SLIDE_VELOCITY} m/s at {len(found)} joints"
    consequence = "motions are slower than the robot may be: state limits.velocity"
    return found, [Assumed(what="velocity limits", value=value, consequence=consequence)]


def weight_loads(robot: Robot, rng: np.random.Generator, legs: Mapping[int, Array], weight: float) -> Array:
    """Largest torque of weight at each joint over random postures, of legs with the robot's weight at their ends.

    Args:
        robot: the robot.
        rng: draws the postures.
        legs: by the joint at a leg's end, where it touches the ground in that joint's frame ``(3,)`` [m].
        weight: of the robot [N].
    """
    data = robot.model.createData()
    loads = np.zeros(robot.n_joints)
    for q in robot.draw_configurations(rng, 30):
        weight_now = pin.computeGeneralizedGravity(robot.model, data, q)
        loads = np.maximum(loads, np.abs(robot.on_motors(q[None], weight_now[None])[0]))
    for _, index, reach in _leg_reaches(robot, legs):
        loads[index] = max(loads[index], 0.5 * weight * reach / max(len(legs) // 2, 1))
    return loads


def _leg_reaches(robot: Robot, legs: Mapping[int, Array]) -> list[tuple[int, int, float]]:
    """Joints at ends of legs, indices of the joints of these, and how far the ground is from each at rest [m]."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    return [
        (
            leg,
            joint - 1,
            max(float(np.linalg.norm(data.oMi[leg].act(tip) - data.oMi[joint].translation)), 0.1),
        )
        for leg, tip in legs.items()
        for joint in list(robot.model.supports[leg])[1:]
    ]


def guess_gains(
    robot: Robot, inertia: Array, loads: Array, legs: Mapping[int, Array], mass: float
) -> dict[str, dict[str, float]]:
    """Stiffness and damping of servos by joint, which give way by little under the weight that they carry.

    Args:
        robot: the robot.
        inertia: largest inertia at each joint, ``(n_joints,)``.
        loads: largest torque of weight at each joint, ``(n_joints,)``.
        legs: as for :func:`weight_loads`.
        mass: of the robot [kg].
    """
    topples, loaded = np.zeros(robot.n_joints), np.zeros(robot.n_joints)
    soles = (leg for leg, tip in legs.items() if not tip.any())
    for joint, stiffness in toppling_stiffness(robot, soles, mass).items():
        topples[joint - 1] = stiffness
    for leg, index, reach in _leg_reaches(robot, legs):
        # A leg on a point is damped as it swings: damped as the robot sways, it drags at its point (with a quarter of
        # that damping feet of the HyQ slip by 3 mm in place of 12).
        loaded[index] = 0.0 if legs[leg].any() else mass / len(legs) * reach**2
    # What weight bends a joint by [rad]: with it the bundled G1 has the 8000 N·m/rad with which it stands in
    # simulation as the real one does, and the Go2 the 2000 with which its trunk follows.
    stiff = np.maximum(inertia * (2.0 * math.pi * _FREQUENCY) ** 2, loads / 0.0125)
    # Damped for its load alone: of ten leg swings of an H1_2 seven stand with ankles damped for this stiffness, and
    # six with three tenths of that.
    damping = 2.0 * _DAMPING * np.sqrt(stiff * np.maximum(inertia, loaded))
    gains = {"kp": np.maximum(stiff, UPRIGHT * topples), "kd": damping}
    return {
        kind: {n: max(two_digits(float(v)), 0.01) for n, v in zip(robot.joint_names, values, strict=True)}
        for kind, values in gains.items()
    }


def guess_sensors(limits: dict[str, float], base_link: str | None) -> tuple[dict[str, Any], list[Assumed]]:
    """The ``guess_sensors`` block: joint torques and, where ``base_link`` floats, an IMU there."""
    # Torques of motor currents are seldom known better than to a hundredth of full scale.
    block: dict[str, Any] = {
        "rate_hz": 200.0,
        "noise_position": 1e-4,
        "joint_torque": "motor_side",
        "noise_torque": {
            "joints": {name: two_digits(0.005 * value) for name, value in limits.items()},
            "source": "assumed: 0.5 % of the torque limit",
        },
    }
    value = "200 Hz, torques of motor currents to 0.5 % of their limits, angles to 1e-4 rad"
    if base_link is not None:
        block |= {"noise_base_position": 1e-3, "noise_base_orientation": 1e-3}
        block["imu"] = {"link": base_link, "noise_gyro": 5e-3, "noise_acceleration": 0.05}
        value += ", an IMU on the base, no force sensor"
    block["source"] = "assumed; no model says it"
    consequence = "predicted errors scale with it: state sensors from data sheets or a record at rest"
    return block, [Assumed(what="sensors", value=value, consequence=consequence)]
