"""Dry friction that builds up over a deflection, stepped along with a simulation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.dry_friction.presliding import RATIO, bend, bend_further


@dataclass(frozen=True)
class Static:
    """Static friction over Coulomb's, ``excess·exp(−|v/velocity|^exponent)``.

    Attributes:
        excess: at rest [N·m].
        velocity: Stribeck velocity [rad/s].
        exponent: of its decay.
    """

    excess: float
    velocity: float
    exponent: float = 2.0

    def share(self, v: float) -> float:
        """What is left of it at a speed, 0…1."""
        return math.exp(-((abs(v) / self.velocity) ** self.exponent))


@dataclass(eq=False)
class Bristle:
    """Friction that builds up over a deflection, ``z' = (v − |v| z)/δ`` (Dahl 1968), stepped implicitly.

    With static friction the LuGre model's bristles bend further, ``z' = (v − |v| z/g)/δ``, ``g = 1 + r·share``; per
    unit of static over Coulomb friction that adds the difference of both over r (Canudas de Wit et al. 1995).

    Attributes:
        breakaway: δ [rad].
        damping: torque per ``z'`` [N·m·s] (Canudas de Wit et al. 1995, eq. 3).
        damped_below: speed beyond which it has died out [rad/s].
        static: static friction on it.
        z: states, without and with static friction, −1 … 1 + r.
        kept: shares of the states that a step at the present speed leaves.
    """

    breakaway: float
    damping: float = 0.0
    damped_below: float = np.inf
    static: Static | None = None
    z: tuple[float, float] = (0.0, 0.0)
    kept: tuple[float, float] = (1.0, 1.0)

    def start(self, v: Array, period: float) -> None:
        """Bend it as the speeds ``(n,)`` before did, one a ``period`` [s]; it is straight where there are none."""
        self.z = (0.0, 0.0)
        if not len(v):
            return
        starts = np.zeros(len(v), dtype=np.bool_)
        starts[0] = True
        plain = float(bend(v, starts, period, self.breakaway)[-1])
        further = plain
        if self.static is not None:
            law = self.static.velocity, self.static.exponent
            further = float(bend_further(v, starts, period, self.breakaway, *law, RATIO)[-1])
        self.z = (plain, further)

    def force(self, level: float, v: float, step: float) -> tuple[float, float]:
        """Torque [N·m] and damping [N·m·s/rad] of the coming step, together those of its end."""
        excess = 0.0 if self.static is None else self.static.excess / RATIO
        slips = 1.0 if self.static is None else 1.0 + RATIO * self.static.share(v)
        self.kept = (
            1.0 / (1.0 + step * abs(v) / self.breakaway),
            1.0 / (1.0 + step * abs(v) / (self.breakaway * slips)),
        )
        rate = self.damping * math.exp(-((v / self.damped_below) ** 2)) / step
        # Static friction is damped as Coulomb friction is.
        more = rate / level * excess if level > 0.0 else 0.0
        (z, z_further), (kept, kept_further) = self.z, self.kept
        plain, further = level - excess + rate - more, excess + more
        torque = -plain * kept * z + (rate - more) * z - further * kept_further * z_further + more * z_further
        damping = (plain * kept + further * kept_further) * step / self.breakaway
        return torque, damping

    def move(self, v: float, step: float) -> None:
        """Bend it by the step that was made."""
        (plain, further), (kept, kept_further) = self.z, self.kept
        way = step * v / self.breakaway
        self.z = (kept * (plain + way), kept_further * (further + way))
