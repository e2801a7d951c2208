"""How the dry friction of a motor changes sign: with its velocity, or with bristles that bend."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.samples import ArmSamples
from excite.lazy_kernel import LazyKernel

# Widths of the sign change of Coulomb friction that are tried [rad/s].
WIDTHS = (1.5e-3, 3e-3, 6e-3, 12e-3, 25e-3, 50e-3)
# What the search between these may reach; no velocity of a log tells less apart.
WIDTH_BOUNDS = (1e-3, 0.06)
# Of fast joints. Simulated joints that creep have 0.1 to 0.25; with 0.9 the pitch axis of a surgical arm that sways at
# as much takes friction of a velocity's third power for it, and a part of a weight with that.
WIDEST = 0.3
# Deflections over which dry friction builds up before it slips that are tried [rad]; 0: friction of the velocity.
BREAKAWAYS = (1.5e-4, 5e-4, 1.5e-3, 4e-3)
# Speeds beyond which bristles are not damped that are tried [rad/s]: never, soon, at any speed.
_DAMPED_BELOW = (0.0, 0.03, np.inf)


class SignChange(NamedTuple):
    """How dry friction changes sign.

    Attributes:
        width: of the sign change where friction follows the velocity alone [rad/s].
        breakaway: deflection over which it builds up [rad] (Dahl 1968); 0 where it follows the velocity.
        damped_below: speed beyond which the damping of bristles has died out [rad/s]; 0 without damping, infinite
            where it never does (Canudas de Wit et al. 1995, eqs. 3 and 6).
        straight: whether friction that follows the velocity grows with it up to its level, and not ever more slowly.
            So does what a simulator softens: of four simulated arms (MuJoCo's frictionloss as it comes) 8 of 26 joints
            have 0.1 to 0.5 times as much left with it and with widths up to 0.3 rad/s.
    """

    width: float
    breakaway: float = 0.0
    damped_below: float = 0.0
    straight: bool = False

    def with_number(self, number: str, value: float) -> SignChange:
        """The same with another value of one of its numbers."""
        values: dict[str, Any] = {number: value}
        return self._replace(**values)

    @property
    def has_bristles(self) -> bool:
        """Whether there are bristles."""
        return self.breakaway > 0.0

    @property
    def has_damping(self) -> bool:
        """Whether they are damped."""
        return self.has_bristles and self.damped_below > 0.0


PLAIN = tuple(SignChange(width) for width in WIDTHS)
SIGNS = (
    *PLAIN,
    *(SignChange(WIDTHS[2], breakaway, speed) for speed in _DAMPED_BELOW for breakaway in BREAKAWAYS),
)


def sign_of_motion(samples: ArmSamples, motor: int, sign: SignChange) -> Array:
    """What a motor's dry friction follows, ``(n_samples,)``: smoothed sign of its velocity, or with presliding."""
    v = samples.motor_signal("v")[:, motor]
    return bristle_bend(samples, v, sign) if sign.has_bristles else of_velocity(v, sign)


def of_velocity(v: Array, sign: SignChange) -> Array:
    """Dry friction without memory at velocities ``v``, as a share of its level, likewise."""
    relative = v / sign.width
    return np.clip(relative, -1.0, 1.0) if sign.straight else np.tanh(relative)


def width_bounds(samples: ArmSamples, joint: int, *, straight: bool) -> tuple[float, float]:
    """What widths the search may reach [rad/s]; straight up to the joint's usual speed, beyond which it is viscous."""
    if not straight:
        return WIDTH_BOUNDS
    v = samples.motor_signal("v")[:, joint]
    return WIDTH_BOUNDS[0], max(WIDTH_BOUNDS[1], min(float(np.sqrt((v**2).mean())), WIDEST))


def damping_of_bristles(samples: ArmSamples, motor: int, sign: SignChange) -> Array:
    """How fast the bristles of a motor bend, ``(n_samples,)`` [1/s], as far as they are damped at its speed."""
    v = samples.motor_signal("v")[:, motor]
    return damped_rate(samples, v, bristle_bend(samples, v, sign), sign)


def bristle_bend(samples: ArmSamples, v: Array, sign: SignChange) -> Array:
    """How far bristles are bent at velocities ``v (n_samples,)``, as a share of the breakaway."""
    return bend_bristle(np.ascontiguousarray(v), samples.is_start, 1.0 / samples.rate_hz, sign.breakaway)


def damped_rate(samples: ArmSamples, v: Array, deflection: Array, sign: SignChange) -> Array:
    """Rate of a deflection ``(n_samples,)`` [1/s] times how much of the damping there is at velocities ``v``."""
    rate = np.diff(deflection, prepend=0.0) * samples.rate_hz
    rate[samples.is_start] = 0.0
    return rate * np.exp(-((v / sign.damped_below) ** 2))


# Dry friction before it slips: bristles that bend.

# Static over Coulomb friction, less one, that is typical, and that bristles are taken to bend further by.
RATIO = 0.7


@LazyKernel
def bend_bristle(v, starts, dt, breakaway):  # pragma: no cover - compiled
    """Dahl's model ``z' = v − |v| z/breakaway``, returned as z/breakaway, ``(n,)``; starts at rest."""
    out = np.zeros(len(v))
    s = 0.0
    for i in range(len(v)):
        if starts[i]:
            s = 0.0
        s = (s + dt * v[i] / breakaway) / (1.0 + dt * abs(v[i]) / breakaway)
        out[i] = s
    return out


@LazyKernel
def bend_further(v, starts, dt, breakaway, velocity, exponent, ratio):  # pragma: no cover - compiled
    """The LuGre model ``z' = v − |v| z/(breakaway·g)``, returned as z/breakaway, ``(n,)``; starts at rest.

    ``g = 1 + ratio·exp(−|v/velocity|^exponent)``: static over Coulomb friction is 1 + ratio, and bristles bend further
    by as much (Canudas de Wit et al. 1995, eqs. 1 and 4).
    """
    out = np.zeros(len(v))
    s = 0.0
    for i in range(len(v)):
        if starts[i]:
            s = 0.0
        g = 1.0 + ratio * np.exp(-((abs(v[i]) / velocity) ** exponent))
        s = (s + dt * v[i] / breakaway) / (1.0 + dt * abs(v[i]) / (breakaway * g))
        out[i] = s
    return out
