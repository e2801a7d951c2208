"""Forms and magnitudes in which effects are hidden in an arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.blind.arm_case import Arm
from benchmarks.blind.documents import HiddenEffect
from benchmarks.blind.magnitudes import DRIVE_FIELDS, MAKERS, Hidden, Site
from excite.simulation.true_parameters import Drives
from excite.simulation.virtual_robot import VirtualRobot

# Forms by effect; the first is the textbook's. Effects of the model's own terms and of given inertial
# parameters ask for another ``modelled``.
FORMS: dict[str, tuple[str, ...]] = {
    "viscous_friction": ("plain",),
    "coulomb_friction": ("plain", "bristle"),
    "coulomb_asymmetry": ("plain",),
    "stribeck": ("plain", "exponent_1", "exponent_0.5", "bristle"),
    "load_dependent_friction": ("plain",),
    "friction_drift": ("plain", "heated", "oil"),
    "armature": ("plain",),
    "backlash": ("plain", "soft"),
    "joint_elasticity": ("plain", "hardening"),
    "joint_spring": ("plain", "hardening", "rubbing"),
    "torque_gain": ("plain",),
    "torque_bias": ("plain",),
    "torque_ripple": ("plain", "load", "harmonics"),
    "encoder_offset": ("plain",),
    "time_delay": ("plain",),
    "actuator_lag": ("plain", "second_order"),
    "payload": ("plain",),
    "link_inertia": ("plain",),
    "link_length_error": ("plain",),
    "base_tilt": ("plain",),
    "unknown": ("push", "stop", "pulses", "hose", "grip"),
}
NEEDS_GIVEN_INERTIA = frozenset({"payload", "link_inertia", "link_length_error", "encoder_offset"})
OWN_TERMS = tuple(DRIVE_FIELDS)


def hide_effect(
    virtual: VirtualRobot, arm: Arm, effect: str, form: str, joint: int, size: float, rng: np.random.Generator
) -> Hidden:
    """Hide an effect at a joint, or at the link behind it.

    Args:
        virtual: the robot so far.
        arm: what magnitudes are measured by.
        effect: its name, a key of ``FORMS``.
        form: one of its forms.
        joint: index of the joint.
        size: 1 for a plain effect, less for a weak one.
        rng: source of the magnitude.

    Returns:
        The robot with it, and what is to be found.
    """
    # Alone, an effect may be hardly seen or large; over a background it stays above it.
    low, high = (-0.9, 0.7) if size >= 1.0 else (-0.4, 0.4)
    size *= float(np.exp(rng.uniform(low, high)))
    site = Site(virtual, arm, effect, form, joint, size, float(rng.choice([-1.0, 1.0])), rng)
    return MAKERS[effect](site)


def left_out(before: VirtualRobot, after: VirtualRobot, effect: str, joint: int) -> VirtualRobot:
    """The robot that has all but an effect just hidden; of what the log leaves out, no joint has any.

    Args:
        before: the robot before the effect was hidden.
        after: the robot after it.
        effect: its name.
        joint: index of its joint.

    Returns:
        The robot.
    """
    field = DRIVE_FIELDS.get(effect)
    if field is None:
        return before
    values = getattr(after.drives, field).copy()
    values[joint] = values.min()
    return replace(before, drives=replace(before.drives, **{field: values}))


def without_term(drives: Drives, term: str) -> Drives:
    """Drives that lack a term of ``modelled``; a rotor is never weightless."""
    values = getattr(drives, DRIVE_FIELDS[term])
    return replace(drives, **{DRIVE_FIELDS[term]: (1e-3 if term == "armature" else 0.0) * values})


def hide_background(
    virtual: VirtualRobot, arm: Arm, rng: np.random.Generator, size: float = 0.06
) -> tuple[VirtualRobot, tuple[HiddenEffect, ...]]:
    """A little of something on every joint; the robot with it, and what it is."""
    some = ("stribeck", "torque_ripple", "load_dependent_friction", "joint_spring")
    made: list[HiddenEffect] = []
    for joint in range(virtual.robot.n_joints):
        effect = str(rng.choice(some))
        # A spring acts all the time, the others by turns.
        share = 0.3 if effect == "joint_spring" else 1.0
        virtual, what = hide_effect(virtual, arm, effect, "plain", joint, share * size, rng)
        made.append(what)
    return virtual, tuple(made)
