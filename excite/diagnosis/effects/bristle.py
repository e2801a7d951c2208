"""Dry friction that builds up over a deflection, stepped along with a simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.dry_friction.friction_sign import RATIO, bend_bristle, bend_further


@dataclass(frozen=True)
class StaticFriction:
    """Static friction over Coulomb's, ``excess·exp(−|v/velocity|^exponent)``.

    Attributes:
        excess: at rest [N·m].
        velocity: Stribeck velocity [rad/s].
        exponent: of its decay.
    """

    excess: float
    velocity: float
    exponent: float = 2.0

    def share_at_speed(self, v: Array) -> Array:
        """What is left of it at speeds, 0…1."""
        return np.asarray(np.exp(-((np.abs(v) / self.velocity) ** self.exponent)))


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
        z: states, without and with static friction, ``(2, n_runs)``, −1 … 1 + r.
        kept: shares of the states that a step at the present speeds leaves, likewise.
    """

    breakaway: float
    damping: float = 0.0
    damped_below: float = np.inf
    static: StaticFriction | None = None
    z: Array = field(default_factory=lambda: np.zeros((2, 1)))
    kept: Array = field(default_factory=lambda: np.ones((2, 1)))

    def start_runs(self, before: Sequence[tuple[Array, float]]) -> None:
        """Bend it as the speeds before each run did: ``(n,)`` of them, one a period [s]; straight where none are."""
        self.z = np.array([self._bend_before_run(v, period) for v, period in before]).T
        self.kept = np.ones_like(self.z)

    def _bend_before_run(self, v: Array, period: float) -> tuple[float, float]:
        if not len(v):
            return 0.0, 0.0
        starts = np.zeros(len(v), dtype=np.bool_)
        starts[0] = True
        plain = float(bend_bristle(v, starts, period, self.breakaway)[-1])
        further = plain
        if self.static is not None:
            law = self.static.velocity, self.static.exponent
            further = float(bend_further(v, starts, period, self.breakaway, *law, RATIO)[-1])
        return plain, further

    def friction_force(self, level: Array, v: Array, step: float) -> tuple[Array, Array]:
        """Torque [N·m] and damping [N·m·s/rad] of the coming step, together those of its end, ``(n_runs,)`` each.

        Args:
            level: of the friction that it builds up to [N·m].
            v: speeds of the joint [rad/s].
            step: length of the step [s].
        """
        static, way = self.static, step * np.abs(v) / self.breakaway
        excess = 0.0 if static is None else static.excess / RATIO
        slips = 1.0 if static is None else 1.0 + RATIO * static.share_at_speed(v)
        self.kept = 1.0 / (1.0 + np.array([way, way / slips]))
        rate = self.damping * np.exp(-((v / self.damped_below) ** 2)) / step
        # Static friction is damped as Coulomb friction is.
        more = np.divide(rate * excess, level, out=np.zeros_like(level), where=level > 0.0)
        (z, z_further), (kept, kept_further) = self.z, self.kept
        plain, further = level - excess + rate - more, excess + more
        torque = -plain * kept * z + (rate - more) * z - further * kept_further * z_further + more * z_further
        damping = (plain * kept + further * kept_further) * step / self.breakaway
        return torque, damping

    def advance_deflection(self, v: Array, step: float) -> None:
        """Bend it by the step that was made at speeds ``(n_runs,)``."""
        self.z = self.kept * (self.z + step * v / self.breakaway)
