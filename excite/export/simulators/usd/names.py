"""Names of USD's attributes for joints, and the unit that each counts in."""

from __future__ import annotations

import re
from collections.abc import Collection

import numpy as np

DEGREE = np.pi / 180.0

PHYSX = {
    "armature": "physxJointAxis:{axis}:armature",
    "coulomb": "physxJointAxis:{axis}:dynamicFrictionEffort",
    "viscous": "physxJointAxis:{axis}:viscousFrictionCoefficient",
    "velocity_limit": "physxJointAxis:{axis}:maxJointVelocity",
}
"""PhysX's own, of an articulation's joint; ``axis`` is angular or linear."""

STATIC = "physxJointAxis:{axis}:staticFrictionEffort"
"""PhysX's friction at rest, which it wants no smaller than that of motion."""

NEWTON = {
    "armature": "newton:armature",
    "coulomb": "newton:friction",
    "viscous": "newton:damping",
    "velocity_limit": "newton:velocityLimit",
}
"""Newton's, which its solvers read, and PhysX where its own are not there."""

DRIVE = {
    "kp": "drive:{axis}:physics:stiffness",
    "kd": "drive:{axis}:physics:damping",
    "torque_limit": "drive:{axis}:physics:maxForce",
}
"""USD physics' drive."""

# Of a hinge USD counts angles in degrees: gains and viscous friction are for each degree, speeds in degrees.
_PER_ANGLE, _ANGLE = ("kp", "kd", "viscous"), ("velocity_limit",)


def unit_factor(term: str, *, slides: bool) -> float:
    """What a value in SI is multiplied by to be in USD's unit."""
    if slides:
        return 1.0
    return DEGREE if term in _PER_ANGLE else 1.0 / DEGREE if term in _ANGLE else 1.0


def prim_name(name: str, taken: Collection[str] = ()) -> str:
    """A name that USD takes (letters, digits and underscores, no digit first) and that is not taken."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    plain = f"_{plain}" if not plain or plain[0].isdigit() else plain
    while plain in taken:
        plain += "_"
    return plain
