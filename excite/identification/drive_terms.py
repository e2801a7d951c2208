"""Columns that a joint's drive adds to its torque: friction, offset, rotor inertia."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.robot.robot import Array


@dataclass(frozen=True)
class DriveTerm:
    """A term of a joint's torque that is linear in one parameter of its drive.

    Attributes:
        name: first part of the parameter's name, ``NAME.JOINT``.
        unit: unit of the parameter for a revolute joint.
        effects: words of ``modelled`` in ``log.yaml`` that ask for it.
        column: torque per unit of the parameter from velocity [rad/s], acceleration [rad/s²] and the width of
            the sign change [rad/s]; arrays of one shape.
    """

    name: str
    unit: str
    effects: tuple[str, ...]
    column: Callable[[Array, Array, float], Array]


def smooth_sign(velocity: Array, width: float) -> Array:
    """``tanh(velocity / width)``, the plain sign for width 0."""
    return np.sign(velocity) if width == 0.0 else np.tanh(velocity / width)


DRIVE_TERMS: dict[str, DriveTerm] = {
    term.name: term
    for term in (
        DriveTerm("viscous", "N·m·s/rad", ("viscous_friction",), lambda v, a, w: v),
        DriveTerm("coulomb", "N·m", ("coulomb_friction",), lambda v, a, w: smooth_sign(v, w)),
        DriveTerm("offset", "N·m", ("torque_bias", "coulomb_asymmetry"), lambda v, a, w: np.ones_like(v)),
        DriveTerm("armature", "kg·m²", ("armature",), lambda v, a, w: a),
        # Concave growth with speed, which viscous friction alone cannot follow.
        DriveTerm("root", "N·m·(s/rad)^½", (), lambda v, a, w: smooth_sign(v, w) * np.sqrt(np.abs(v))),
    )
}
