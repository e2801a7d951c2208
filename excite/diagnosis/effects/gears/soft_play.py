"""Soft play in MuJoCo's XML: contacts that come on over a width, as many hard ones one after the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array

if TYPE_CHECKING:
    import mujoco

_COUNT = 8
# Where the flanks add up to less than this share of the stiffness in the middle, there is none.
_LEAST_MIDDLE = 1e-3
# Impedances outside these MuJoCo replaces by them (mjMINIMP, mjMAXIMP).
_IMPEDANCE = (1e-4, 0.9999)


@dataclass(frozen=True)
class SoftPlay:
    """Two contacts, each of torque ``k s log(1 + exp((x − g)/s))`` on its side.

    Attributes:
        half: half the play, g [rad].
        softness: width over which contact comes on, s [rad].
        stiffness: of a contact that is wholly on, k [N·m/rad].
        damping: of the same [N·m·s/rad].
    """

    half: float
    softness: float
    stiffness: float
    damping: float

    @property
    def middle(self) -> float:
        """Share of the stiffness that the two flanks add up to at x = 0."""
        return 1.0 - float(np.tanh(0.5 * self.half / self.softness))

    def deflection(self, torque: float) -> float:
        """Where it rests under a torque [N·m] that it opposes [rad]."""
        y = abs(torque) / self.stiffness / self.softness
        ratio = self.half / self.softness
        if y > 300.0:
            return float(np.sign(torque)) * self.softness * (y + ratio)
        # exp(y) = (1 + u e)/(1 + e/u) with u = exp(x/s), e = exp(−g/s) is quadratic in u.
        beyond, e = np.expm1(y), np.exp(-ratio)
        u = (beyond + np.sqrt(beyond**2 + 4.0 * (1.0 + beyond) * e**2)) / (2.0 * e)
        return float(np.sign(torque) * self.softness * np.log(u))

    def hard_contacts(self, count: int) -> Array:
        """Distances from the middle of hard contacts that share what is not the middle's alike, ``(count,)`` [rad].

        The softplus is the mean of hard contacts that lie around its own place with the logistic distribution.
        That is cut into parts of equal weight, each of which has its contact where its mean is: far out the torque
        is the soft contacts' own.
        """
        ratio = self.half / self.softness
        left = (1.0 - self.middle) * (1.0 - np.arange(1, count) / count)
        # Slope 1 − sinh(g/s)/(cosh(x/s) + cosh(g/s)).
        x = np.arccosh(np.maximum(np.sinh(ratio) / left - np.cosh(ratio), 1.0))
        held = np.logaddexp(0.0, x - ratio) - np.logaddexp(0.0, -x - ratio)
        moment = np.concatenate([[0.0], x * (1.0 - left) - held, [ratio]])
        return np.asarray(self.softness * np.diff(moment) * count / (1.0 - self.middle))


def add_soft_play(spec: mujoco.MjSpec, joint: str, play: SoftPlay) -> None:
    """Hold a joint between soft contacts: limits of tendons that hang on it alone, and an equality for the middle.

    MuJoCo's constraints act as ``f = D (−b ẋ − k x − ẍ)`` with ``D`` from their impedance. With
    ``D = h² K + h B``, ``k = K/D`` and ``b = (B + h K)/D`` that is a spring K and a damper B of an implicit step h:
    stable however stiff they are, and gone where the contact is open.

    Args:
        spec: the specification, with all its bodies and joints.
        joint: the joint.
        play: its contacts.
    """
    import mujoco

    compiled = spec.compile()
    mobility = float(compiled.dof_invweight0[compiled.joint(joint).dofadr[0]])
    step = float(spec.option.timestep)
    share = (1.0 - play.middle) / _COUNT
    solref, solimp = _spring(share * play.stiffness, share * play.damping, mobility, step)
    for number, distance in enumerate(play.hard_contacts(_COUNT)):
        tendon = spec.add_tendon(name=f"{joint}.contact.{number}", limited=True)
        tendon.range = [-distance, distance]
        tendon.solref_limit, tendon.solimp_limit = solref, solimp
        tendon.wrap_joint(joint, 1.0)
    if play.middle > _LEAST_MIDDLE:
        middle = spec.add_equality(name=f"{joint}.middle", type=mujoco.mjtEq.mjEQ_JOINT, name1=joint)
        middle.objtype = mujoco.mjtObj.mjOBJ_JOINT
        middle.data[:5] = 0.0
        middle.solref, middle.solimp = _spring(
            play.middle * play.stiffness, play.middle * play.damping, mobility, step
        )


def _spring(
    stiffness: float, damping: float, mobility: float, step: float
) -> tuple[list[float], list[float]]:
    """``solref`` and ``solimp`` of a constraint that is a spring and a damper."""
    low, high = (d / (1.0 - d) / mobility for d in _IMPEDANCE)
    weight = min(max(step**2 * stiffness + step * damping, low), high)
    d = weight * mobility / (1.0 + weight * mobility)
    # MuJoCo divides both by the impedance.
    k, b = d * stiffness / weight, d * (damping + step * stiffness) / weight
    return [-k, -b], [d, d, 0.001, 0.5, 2.0]
