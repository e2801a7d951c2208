"""A soft or loose gear, and the link behind it as the gear feels it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.effects.form import Context


class Gear(NamedTuple):
    """A gear that gives way.

    Attributes:
        stiffness: of the gear, or of the contact on either side of the play [N·m/rad].
        damping: [N·m·s/rad].
        gap: half the play [rad].
        cubic: relative growth of the stiffness with the square of the deflection [1/rad²].
        soft: width over which contact comes on at either side of the play [rad].
        depth: of round contacts where they are as stiff as told [rad]; 0 of flat ones.
    """

    stiffness: float
    damping: float
    gap: float = 0.0
    cubic: float = 0.0
    soft: float = 0.0
    depth: float = 0.0


class DrivenLink(NamedTuple):
    """What a gear has behind it at every sample, ``(n_samples,)`` each.

    Attributes:
        load: torque that the link needs where it moves with the motor [N·m].
        by_q: its change with the joint's angle [N·m/rad].
        by_v: its change with the joint's speed [N·m·s/rad].
        inertia: [kg·m²], positive.
        by_qq: second derivative of the torque with the angle [N·m/rad²].
        by_qv: with the angle and the speed [N·m·s/rad²].
    """

    load: Array
    by_q: Array
    by_v: Array
    inertia: Array
    by_qq: Array
    by_qv: Array

    @classmethod
    def of_joint(cls, context: Context, j: int, *, second_order: bool = False) -> DrivenLink:
        """What joint j's gear has behind it; second derivatives are none to first order."""
        load = np.ascontiguousarray(context.baseline.rigid[:, j])
        key, kept = (j, "behind, curved" if second_order else "behind"), context.baseline.derived.values
        if key not in kept:
            slopes = [context.torque_gradient(j, what)[:, j] for what in ("q", "v")]
            curves = [
                context.torque_curvature(j, what)[:, j] if second_order else 0.0 * load
                for what in ("qq", "qv")
            ]
            kept[key] = np.array([*slopes, *curves])
        by_q, by_v, by_qq, by_qv = kept[key]
        return cls(load, by_q, by_v, link_inertia(context, j), by_qq, by_qv)

    def required_torque(self, x: Array, s: Array, acc: Array) -> Array:
        """Torque that the link needs at a deflection, its speed and its acceleration, ``(n_samples,)``."""
        turned = (self.by_q + 0.5 * self.by_qq * x) * x + (self.by_v + self.by_qv * x) * s
        return self.load + turned + self.inertia * acc

    def at_samples(self, samples: NDArray[np.int64]) -> DrivenLink:
        """The same at some samples."""
        return DrivenLink(*(values[samples] for values in self))


def link_inertia(context: Context, j: int) -> Array:
    """Inertia that a joint moves, ``(n_samples,)``, kept positive where fitted parameters make it none [kg·m²]."""
    key, kept = (j, "inertia"), context.baseline.derived.values
    if key not in kept:
        mass = context.torque_gradient(j, "a")[:, j]
        kept[key] = np.maximum(mass, 0.05 * max(float(np.abs(mass).mean()), 1e-6))
    return kept[key]


def contact_stiffness(context: Context, j: int, hertz: float) -> float:
    """Stiffness at which the mean inertia behind a joint swings so often a second [N·m/rad]."""
    return float(link_inertia(context, j).mean()) * (2.0 * math.pi * hertz) ** 2


def gear_damping(context: Context, j: int, stiffness: float, ratio: float) -> float:
    """Damping of a gear whose ratio is told at the mean inertia behind it [N·m·s/rad]."""
    return 2.0 * ratio * math.sqrt(stiffness * float(link_inertia(context, j).mean()))
