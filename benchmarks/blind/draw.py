"""Which effects, forms, noise and faults the cases of a battery have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.blind.arm_case import FAULTS
from benchmarks.blind.documents import CaseKind
from benchmarks.blind.forms import FORMS, NEEDS_GIVEN_INERTIA, OWN_TERMS

# Kinds of cases, which come round in this order.
_KINDS: tuple[CaseKind, ...] = (
    *("single", "none", "single", "weak", "single"),
    *("unknown", "single", "double", "single", "none"),
)

ROBOTS = ("panda", "ur10", "iiwa14", "jaco2")
# Joints of theirs are nearly all rotor: without one a step would turn them round, and their friction with them.
_ROTORS = ("ur10", "jaco2")
# Pairs that one set of trials tells apart when their sizes are alike: not two of timing, nor two in a joint.
_DOUBLES = ("stribeck", "backlash", "torque_gain", "torque_bias", "joint_spring", "torque_ripple")
_WEAK = tuple(
    name for name in FORMS if name not in {*NEEDS_GIVEN_INERTIA, *OWN_TERMS, "unknown", "coulomb_asymmetry"}
)


@dataclass(frozen=True)
class Draft:
    """A case before it is simulated.

    Attributes:
        robot: name of the robot.
        kind: ``single``, ``weak``, ``double``, ``none`` or ``unknown``.
        effects: effects and their forms.
        fixed: whether inertial parameters are given.
        noise: factor on the usual noise.
        faults: kinds of faults of the record.
        bristles: whether all joints' dry friction has bristles, as the nominal model's has not.
        absent: a term that neither the robot nor its model has, empty where there is none.
    """

    robot: str
    kind: CaseKind
    effects: tuple[tuple[str, str], ...]
    fixed: bool
    noise: float
    faults: tuple[str, ...]
    bristles: bool
    absent: str = ""


def draft_case(number: int, rng: np.random.Generator, robots: tuple[str, ...] = ROBOTS) -> Draft:
    """The case of a number: of ten, five have one effect, and one each two, a weak one, none (two), unknown.

    Effects go round in order and forms are drawn, so that even a small battery has most of the names.

    Args:
        number: number of the case.
        rng: source of what is drawn.
        robots: to choose from.

    Returns:
        The draft.
    """
    robot = robots[int(rng.integers(len(robots)))]
    turn, tens = number % 10, number // 10
    kind = _KINDS[turn]
    if kind == "unknown" and tens % 2:
        kind = "weak"
    names = [name for name in FORMS if name != "unknown"]
    effects: list[str] = []
    if kind == "single":
        effects = [names[(5 * tens + turn // 2) % len(names)]]
    elif kind == "weak":
        effects = [str(rng.choice(_WEAK))]
    elif kind == "double":
        effects = [str(name) for name in rng.choice(_DOUBLES, 2, replace=False)]
    elif kind == "unknown":
        effects = ["unknown"]
    if "armature" in effects and robot in _ROTORS:
        robot = "iiwa14"
    given = bool({*effects} & NEEDS_GIVEN_INERTIA)
    fixed = given or (kind == "single" and rng.random() < 0.25)
    noise = 2.0 if kind == "none" and turn == 9 else float(rng.choice([1.0, 1.0, 1.5]))
    faulty = rng.random() < 0.4
    faults = (str(rng.choice(sorted(FAULTS))),) if faulty else ()
    # Warm oil alone changes little: over a background it would be the least of what is there.
    forms = tuple(
        (name, str(rng.choice([f for f in FORMS[name] if kind != "weak" or f != "oil"]))) for name in effects
    )
    bristles, absent = bool(rng.random() < 0.15), ""
    if rng.random() < 0.2:
        absent = str(rng.choice(("viscous_friction", "armature")))
        # A wrist that is nearly all rotor needs one; what is hidden, or changes what is hidden, stays.
        taken = {*effects} & {absent, "friction_drift", "joint_elasticity", "backlash"}
        absent = "" if taken or robot in _ROTORS else absent
    # Servos that are stiff for such light wrists ring with a drive that lags twice.
    if ("actuator_lag", "second_order") in forms and robot in _ROTORS:
        robot = "iiwa14"
    return Draft(robot, kind, forms, fixed, noise, faults, bristles, absent)
