"""Numbers that a bare model lacks: limits, gains and noise, each on the careful side, and what was assumed for them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.finding import first_names
from excite.results import Assumed
from excite.robot.init_robot.first_guesses import JointGuess, drawn_posture
from excite.robot.legs import UPRIGHT, toppling_stiffness
from excite.robot.robot import Robot

SHARE_OF_TORQUE = 0.3
"""Share of the torque limit that a proposed acceleration limit may use on the joint's own inertia."""
# What arms that people work beside keep to [rad/s, m/s]; a sixth of it for slides.
_VELOCITY, _SLIDE_VELOCITY = 1.5, 0.25
# Bundled robots have 3 to 30 rad/s²; without a torque limit nothing says what the drive can do.
_ACCELERATION, _UNKNOWN_ACCELERATION = 30.0, 5.0
# A drive is chosen for about twice the weight that it holds and moves.
_RESERVE = 3.0
# A stated torque that lifts so many of the whole robot, a metre away, stands for no limit. In the URDFs looked at
# those that do (10000, 50000, 1e9 N·m) lift 10 of it and more, the strongest drives 6 (a gripper) and 3.5 (Minitaur).
# Alexander's 1000 N·m lift 2.2 of it and are believed.
_NO_TORQUE = 8.0
# Natural frequency of the servo on the joint's own inertia, and on the robot's that a leg carries [Hz]; its damping.
_FREQUENCY, _DAMPING = 8.0, 0.7
# What weight bends a joint by [rad]: with it the bundled G1 has the 8000 N·m/rad with which it stands in simulation as
# the real one does, and the Go2 the 2000 with which its trunk follows.
_SAG = 0.0125
# Torques of motor currents are seldom known better than to a hundredth of full scale.
_TORQUE_NOISE = 0.005


def two_digits(value: float) -> float:
    """Rounded to two significant digits, never to zero."""
    return float(f"{max(value, 1e-6):.2g}")


def drop_unbelievable_limits(guesses: tuple[JointGuess, ...], weight: float) -> tuple[JointGuess, ...]:
    """The joints without torque limits that stand for none, of a robot of a ``weight`` [N]."""
    return tuple(
        replace(guess, torque=None) if guess.torque and guess.torque > _NO_TORQUE * weight else guess
        for guess in guesses
    )


def torque_limits(
    robot: Robot, guesses: tuple[JointGuess, ...], loads: Array, inertia: Array
) -> tuple[dict[str, float], list[Assumed]]:
    """Torque limits that the model does not state, by joint, from weight ``loads`` and ``inertia`` ``(n_joints,)``."""
    needed = _RESERVE * (loads + inertia * _UNKNOWN_ACCELERATION)
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
        dynamics = joints[guess.name].find("dynamics")
        if dynamics is not None:
            dry, viscous = (float(dynamics.get(name, "0")) for name in ("friction", "damping"))
            shares[guess.name] = (dry + viscous * (guess.velocity or 0.0)) / torque[guess.name]
    rubbing = [name for name, share in shares.items() if share > 0.0]
    if not rubbing:
        return []
    worst = max(rubbing, key=lambda name: shares[name])
    return [
        Assumed(
            what=f"friction that the model states at {len(rubbing)} joint{'s' * (len(rubbing) > 1)}",
            value=f"not counted; at full speed it would take {shares[worst]:.2g} of the torque limit of {worst}",
            consequence="a motion may ask more of a drive than it gives, unless that is a simulator's damping: state "
            "drives.viscous and drives.coulomb",
        )
    ]


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


def guess_accelerations(guesses: tuple[JointGuess, ...], inertia: Array) -> dict[str, float]:
    """Acceleration limits by joint, no more than the model states [rad/s² or m/s²]."""
    found = {}
    for guess, own in zip(guesses, inertia, strict=True):
        known = guess.torque is not None and own > 0.0
        share = SHARE_OF_TORQUE * (guess.torque or 0.0) / own if known else _UNKNOWN_ACCELERATION
        found[guess.name] = min(two_digits(min(_ACCELERATION, share)), guess.acceleration or math.inf)
    return found


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
    for _ in range(30):
        q = drawn_posture(robot, rng)
        weight_now = pin.computeGeneralizedGravity(robot.model, data, q)
        loads = np.maximum(loads, np.abs(robot.on_motors(q[None], weight_now[None])[0]))
    q = robot.rest
    pin.forwardKinematics(robot.model, data, q)
    for leg, tip in legs.items():
        joint = leg
        while joint:
            reach = np.linalg.norm(data.oMi[leg].act(tip) - data.oMi[joint].translation)
            loads[joint - 1] = max(
                loads[joint - 1], 0.5 * weight * max(float(reach), 0.1) / max(len(legs) // 2, 1)
            )
            joint = int(robot.model.parents[joint])
    return loads


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
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    topples = toppling_stiffness(robot, (leg for leg, tip in legs.items() if not tip.any()), mass)
    stiffness, damping = [], []
    loaded = {}
    for leg, tip in legs.items():
        joint = leg
        while joint:
            reach = float(np.linalg.norm(data.oMi[leg].act(tip) - data.oMi[joint].translation))
            # A leg on a point is damped as it swings: damped as the robot sways, it drags at its point (with a
            # quarter of that damping feet of the HyQ slip by 3 mm in place of 12).
            loaded[joint - 1] = 0.0 if tip.any() else mass / len(legs) * max(reach, 0.1) ** 2
            joint = int(robot.model.parents[joint])
    for index, own in enumerate(inertia):
        moved = max(float(own), loaded.get(index, 0.0))
        stiff = max(own * (2.0 * math.pi * _FREQUENCY) ** 2, loads[index] / _SAG)
        stiffness.append(max(stiff, UPRIGHT * topples.get(index + 1, 0.0)))
        # Damped for its load alone: of ten leg swings of an H1_2 seven stand with ankles damped for this stiffness, and
        # six with three tenths of that.
        damping.append(2.0 * _DAMPING * math.sqrt(stiff * moved))
    names = robot.joint_names
    return {
        "kp": {n: max(two_digits(v), 0.01) for n, v in zip(names, stiffness, strict=True)},
        "kd": {n: max(two_digits(v), 0.01) for n, v in zip(names, damping, strict=True)},
    }


def guess_sensors(limits: dict[str, float], base_link: str | None) -> tuple[dict[str, Any], list[Assumed]]:
    """The ``guess_sensors`` block: joint torques and, where ``base_link`` floats, an IMU there."""
    block: dict[str, Any] = {
        "rate_hz": 200.0,
        "noise_position": 1e-4,
        "joint_torque": "motor_side",
        "noise_torque": {
            "joints": {name: two_digits(_TORQUE_NOISE * value) for name, value in limits.items()},
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
