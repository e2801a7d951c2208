"""Which effects, sensors and noise the standing cases of a battery have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.blind.floating.magnitudes import FORMS
from excite.blind.floating.stand import ROBOTS, SensorKind

_KINDS = ("single", "none", "single", "single", "unknown", "single", "double", "single", "single", "none")
# Invisible where inertial parameters are free: part of them, or, over force plates, absorbed by them.
_NEEDS_GIVEN = frozenset({"payload", "link_inertia"})
_NEEDS_GIVEN_OVER_PLATES = frozenset({"base_orientation_bias", "encoder_offset", "link_length_error"})
# Pairs are drawn one from each.
_OF_SENSORS = ("sensor_gain", "sensor_bias", "sensor_crosstalk", "sensor_frame_offset")
_OF_THE_BODY = ("external_force", "unlogged_contact", "joint_elasticity", "payload", "encoder_offset")


@dataclass(frozen=True)
class FloatingDraft:
    """A standing case before it is simulated.

    Attributes:
        robot: name of the robot.
        kind: ``single``, ``double``, ``none`` or ``unknown``.
        effects: effects and their forms.
        sensors: ``force_plate`` or ``foot_ft``.
        fixed: whether inertial parameters are given.
        noise: factor on the usual noise.
    """

    robot: str
    kind: str
    effects: tuple[tuple[str, str], ...]
    sensors: SensorKind
    fixed: bool
    noise: float


def floating_draft(number: int, rng: np.random.Generator, robots: tuple[str, ...] = ROBOTS) -> FloatingDraft:
    """The case of a number: of ten, six have one effect, one has two, two have none and one something unknown.

    Effects go round in order; robots, sensors, forms and noise are drawn.

    Args:
        number: number of the case.
        rng: source of what is drawn.
        robots: to choose from.
    """
    robot = str(rng.choice(robots))
    kind, tens = _KINDS[number % 10], number // 10
    names = [name for name in FORMS if name != "unknown"]
    effects: list[str] = []
    if kind == "single":
        before = _KINDS[: number % 10].count("single")
        effects = [names[(tens * _KINDS.count("single") + before) % len(names)]]
    elif kind == "double":
        effects = [str(rng.choice(_OF_SENSORS)), str(rng.choice(_OF_THE_BODY))]
    elif kind == "unknown":
        effects = ["unknown"]
    if "soft_tissue" in effects and "human" in robots:
        robot = "human"
    sensors: SensorKind = "force_plate" if rng.random() < 0.5 else "foot_ft"
    given = bool({*effects} & _NEEDS_GIVEN) or (
        sensors == "force_plate" and bool({*effects} & _NEEDS_GIVEN_OVER_PLATES)
    )
    fixed = given or bool(rng.random() < 0.4)
    noise = 2.0 if number % 10 == 9 else float(rng.choice([1.0, 1.0, 1.0, 2.0]))
    forms = tuple((name, str(rng.choice(FORMS[name]))) for name in effects)
    return FloatingDraft(robot, kind, forms, sensors, fixed, noise)
