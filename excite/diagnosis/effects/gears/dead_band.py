"""Play in front of dry friction on an axis without mass: after a reversal nothing resists until it is used up."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.effects.note import Beyond
from excite.lazy_kernel import LazyKernel

# Rigid bodies' share of an axis' torque (root mean square) below which it carries no mass to speak of: 2e-5 on a
# friction damper, 0.6 on the lightest wrist of a UR10e. Where there is mass, the link flies through its play, and the
# law is the gear's.
_MASSLESS = 0.02
# Widths and ways of the grid [rad or m].
_WIDTHS, _WAYS = (1e-3, 2e-3, 4e-3, 8e-3, 16e-3), (5e-4, 2e-3)


class DeadBand(Effect):
    """Dry friction behind play and a spring: a stop operator with a dead band (Nordin, Gutman 2002, section 2).

    The way ``z`` of the drive against what rubs follows its motion between the ends ``±(w/2 + δ)``, where friction
    slips. Friction is carried beyond the play alone, ``sign(z) min(max(|z| − w/2, 0)/δ, 1)``. What the effect adds
    is that less the sign by which the joint's friction changes otherwise: what rubs before the play keeps it.
    """

    name = "backlash"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("friction_behind", "N·m", 0.0),)
    searched: ClassVar[tuple[Parameter, ...]] = (
        Parameter("width", "rad", 2e-4, 0.08),
        Parameter("breakaway", "rad", 1e-4, 2e-2),
    )
    confusable_with = ("stribeck", "joint_elasticity")
    separating_motion = "reversals at small and large amplitudes"
    mujoco = "none: an axis without mass cannot fly through its play"
    friction = True

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(w, d) for w in _WIDTHS for d in _WAYS] if massless(context, location) else []

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j, samples = context.row(location), context.baseline.samples
        way = np.diff(context.q[:, j], prepend=0.0)
        loose = friction_behind_play(way, samples.starts, 0.5 * theta[0], theta[1])
        return Shape({j: (loose - context.sign(j))[:, None]})

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(absent=Beyond.NO_FORM)


def massless(context: Context, joint: str) -> bool:
    """Whether a joint's rigid bodies ask for next to nothing of its torque."""
    j, base = context.row(joint), context.baseline
    torque = base.samples.stacked("tau")[:, j]
    return bool(np.mean(base.rigid[:, j] ** 2) <= _MASSLESS**2 * np.mean(torque**2))


def friction_behind_play(way: Array, starts: Array, half: float, breakaway: float) -> Array:
    """Share of dry friction that is carried, ``(n,)``, −1…1.

    Args:
        way: ``(n,)`` motion since the sample before [rad or m].
        starts: ``(n,)`` which samples are the first of a trial; it starts in the middle of the play.
        half: half the width of the play [rad or m].
        breakaway: way over which friction builds up beyond the play [rad or m].
    """
    return np.asarray(_behind(np.ascontiguousarray(way), starts, half, breakaway))


@LazyKernel
def _behind(way, starts, half, breakaway):  # pragma: no cover - compiled
    out = np.empty(len(way))
    z, end = 0.0, half + breakaway
    for i in range(len(way)):
        z = 0.0 if starts[i] else min(max(z + way[i], -end), end)
        carried = max(abs(z) - half, 0.0) / breakaway
        out[i] = carried if z > 0.0 else -carried
    return out
