"""Which effects an arm with a little of everything has, where, in what form and how large."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.blind.draw import ROBOTS
from excite.blind.faults import FAULTS
from excite.blind.forms import FORMS, NEEDS_GIVEN_INERTIA, OWN_TERMS
from excite.robot.loading import load_robot

FEWEST, MOST = 3, 8
# Of the usual magnitude: from what no log shows to what rules its joint.
SMALLEST, LARGEST = 0.03, 1.5
# At most one of a group: two of them in one robot, or at one joint, are one effect with two names.
_ONE_A_ROBOT = (
    frozenset({"time_delay", "actuator_lag"}),
    frozenset({"base_tilt"}),
    # A simulated gear halves the step and every further one slows all steps.
    frozenset({"backlash", "joint_elasticity"}),
)
_ONE_A_JOINT = (
    frozenset({"torque_bias", "coulomb_asymmetry"}),
    frozenset({"payload", "link_inertia"}),
)
# Terms of ``modelled`` are all there, and what has no name is no effect that anyone could name.
_CHOICE = tuple(name for name in FORMS if name not in {*OWN_TERMS, "unknown"})
# Bristles take the place of dry friction, which further laws at a joint need.
_FORMS = {name: tuple(form for form in FORMS[name] if form != "bristle") for name in _CHOICE}


@dataclass(frozen=True)
class Ingredient:
    """One effect before it is hidden.

    Attributes:
        effect: its name.
        form: which of its forms.
        joint: index of the joint, or of the link behind it.
        size: factor on the usual magnitude.
        seed: of everything else about it.
    """

    effect: str
    form: str
    joint: int
    size: float
    seed: int


@dataclass(frozen=True)
class Mixture:
    """A case before it is simulated.

    Attributes:
        robot: name of the robot.
        fixed: whether inertial parameters are given.
        noise: factor on the usual noise.
        faults: kinds of faults of the record.
        ingredients: what is hidden.
    """

    robot: str
    fixed: bool
    noise: float
    faults: tuple[str, ...]
    ingredients: tuple[Ingredient, ...]


def draw_mixture(rng: np.random.Generator, robots: tuple[str, ...] = ROBOTS) -> Mixture:
    """Draw a case: three to eight effects, whose places go through all joints before one has its second.

    Args:
        rng: source of what is drawn.
        robots: to choose from.

    Returns:
        The draft.
    """
    robot = robots[int(rng.integers(len(robots)))]
    joints = load_robot(robot).n_joints
    fixed = bool(rng.random() < 0.4)
    noise = float(rng.choice([1.0, 1.0, 1.5]))
    faults = (str(rng.choice(sorted(FAULTS))),) if rng.random() < 0.3 else ()
    count = int(rng.integers(FEWEST, MOST + 1))
    places = np.concatenate([rng.permutation(joints) for _ in range(-(-count // joints))])[:count]
    made: list[Ingredient] = []
    for place in places:
        free = [name for name in _CHOICE if _fits_at(name, int(place), made, fixed, joints)]
        name = str(rng.choice(free))
        size = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
        made.append(
            Ingredient(name, str(rng.choice(_FORMS[name])), int(place), size, int(rng.integers(1 << 31)))
        )
    return Mixture(robot, fixed, noise, faults, tuple(made))


def _fits_at(name: str, joint: int, made: list[Ingredient], fixed: bool, joints: int) -> bool:
    """Whether an effect can be at a joint beside those that are drawn already."""
    if name in NEEDS_GIVEN_INERTIA and not (fixed and 0 < joint < joints - 1):
        return False
    here = {item.effect for item in made if item.joint == joint}
    anywhere = {item.effect for item in made}
    if name in here or any(name in group and group & anywhere for group in _ONE_A_ROBOT):
        return False
    # A drive that lags makes a gear behind it ring.
    if name == "actuator_lag" and anywhere & {"backlash", "joint_elasticity"}:
        return False
    if name in {"backlash", "joint_elasticity"} and "actuator_lag" in anywhere:
        return False
    return not any(name in group and group & here for group in _ONE_A_JOINT)
