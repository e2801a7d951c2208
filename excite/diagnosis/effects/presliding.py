"""The sign of a joint's motion with presliding."""

from __future__ import annotations

from excite.diagnosis.drive_terms import sign_of_motion
from excite.diagnosis.effects.effect import Context
from excite.robot.robot import Array


def hysteretic_sign(context: Context, j: int, breakaway: float) -> Array:
    """The sign of a joint's motion with presliding, ``(n_samples,)`` (Dahl 1968; Canudas de Wit et al. 1995).

    Args:
        context: the context.
        j: row of the joint.
        breakaway: deflection over which friction builds up [rad].
    """
    return sign_of_motion(context.baseline.samples, j, 1.0, breakaway)
