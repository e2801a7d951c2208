"""The sign of a joint's motion with presliding."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.dry_friction.friction_sign import (
    SignChange,
    bent,
    damped_rate,
    sign_of_motion,
)
from excite.diagnosis.equations.dry_friction.presliding import RATIO, bend_further
from excite.diagnosis.equations.own_columns import coulomb_level

# No bristle is damped for longer [s]: where there is hardly any Coulomb friction, its damping tells nothing.
_LONGEST = 0.1


def hysteretic_sign(context: Context, j: int, breakaway: float) -> Array:
    """The sign of a joint's motion with presliding, ``(n_samples,)`` (Dahl 1968; Canudas de Wit et al. 1995).

    Args:
        context: the context.
        j: row of the joint.
        breakaway: deflection over which friction builds up [rad].
    """
    return sign_of_motion(context.baseline.samples, j, SignChange(0.0, breakaway))


def bent_excess(context: Context, j: int, sign: SignChange, velocity: float, exponent: float) -> Array:
    """What static friction adds while bristles bend, ``(n_samples,)``, per unit of its excess.

    How far it bends them hardly shows in a motion: the difference between bristles of a typical ratio of static to
    Coulomb friction and those of none stands for any ratio. It is damped as they are.

    Args:
        context: the context.
        j: row of the joint.
        sign: with bristles.
        velocity: Stribeck velocity [rad/s].
        exponent: of its decay.
    """
    base = context.baseline
    samples = base.samples
    v = samples.of_motor("v", j)
    steady, dt = np.ascontiguousarray(v), 1.0 / samples.rate_hz
    further = bend_further(steady, samples.starts, dt, sign.breakaway, velocity, exponent, RATIO)
    excess = (further - bent(samples, v, sign)) / RATIO
    level = coulomb_level(base.modelled, base.fit.own[j])
    if level > 0.0 and base.signs[j].damped:
        seconds = min(base.bristle_damping(j) / level, _LONGEST)
        excess = excess + seconds * damped_rate(samples, v, excess, sign)
    return excess
