"""What an effect is given to work with: the fitted baseline and full-rate signals at its parameters."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.friction_sign import sign_of_motion
from excite.regressor.kernels import inverse_dynamics

# Steps of first and second differences [rad], [rad/s].
_STEP, _FAR = 1e-5, 1e-3


@dataclass(frozen=True, eq=False)
class Context:
    """The baseline and full-rate signals at its parameters.

    Attributes:
        baseline: the fitted baseline.
    """

    baseline: Baseline
    _signs: dict[int, Array] = field(default_factory=dict)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints with rows."""
        return self.baseline.samples.joints

    def row(self, joint: str) -> int:
        """Index of a joint's row."""
        return self.joints.index(joint)

    @cached_property
    def q(self) -> Array:
        """``(n_samples, n_joints)`` [rad]."""
        return self.baseline.samples.stacked("q")[:, list(self.baseline.samples.index)]

    @cached_property
    def v(self) -> Array:
        """``(n_samples, n_joints)`` [rad/s]."""
        return self.baseline.samples.stacked("v")[:, list(self.baseline.samples.index)]

    @cached_property
    def a(self) -> Array:
        """``(n_samples, n_joints)`` [rad/s²]."""
        return self.baseline.samples.stacked("a")[:, list(self.baseline.samples.index)]

    @cached_property
    def session(self) -> Array:
        """``(n_samples,)`` time since the session's start [s]."""
        return self.baseline.samples.stacked("session_s")

    def sign(self, j: int) -> Array:
        """What a joint's dry friction follows, ``(n_samples,)``."""
        if j not in self._signs:
            base = self.baseline
            self._signs[j] = sign_of_motion(base.samples, j, base.signs[j])
        return self._signs[j]

    def torques(self, q: Array, v: Array, a: Array, model: object = None) -> Array:
        """Torques of the rigid bodies at the fitted parameters, ``(n_samples, n_joints)`` [N·m]."""
        model = self.baseline.samples.robot.model if model is None else model
        return inverse_dynamics(model, q, v, a, self.baseline.phi)[:, list(self.baseline.samples.index)]

    def gradient(self, j: int, what: str) -> Array:
        """Change of the torques per unit of a joint's ``q``, ``v`` or ``a``: ``(n_samples, n_joints)``."""
        kept = self.baseline.derived.values
        if (j, what) not in kept:
            samples = self.baseline.samples
            motion = {name: samples.stacked(name) for name in ("q", "v", "a")}
            step = 1.0 if what == "a" else _STEP
            moved = dict(motion)
            moved[what] = motion[what].copy()
            moved[what][:, samples.index[j]] += step
            still = self.baseline.rigid - self.baseline.added
            change = self.torques(moved["q"], moved["v"], moved["a"]) - still
            # A torque in one piece: most take one of them, or all one after the other.
            kept[j, what] = np.asfortranarray(change / step)
        return kept[j, what]

    def curvature(self, j: int, what: str) -> Array:
        """Second derivative of the torques with a joint's motion: ``qq``, ``qv``, ``vv`` or ``qa``, as the gradient."""
        kept = self.baseline.derived.values
        if (j, what) not in kept:
            samples = self.baseline.samples
            q, v, a = (samples.stacked(name) for name in ("q", "v", "a"))
            unit = np.zeros(q.shape[1])
            unit[samples.index[j]] = 1.0

            def at(turn: float, speed: float = 0.0, more: float = 0.0) -> Array:
                return self.torques(q + turn * unit, v + speed * unit, a + more * unit)

            # Torques are of second degree in the speeds and of first in the accelerations: steps there may be large.
            h = _FAR
            ahead, behind = at(h), at(-h)
            faster, slower = (at(h, 1.0), at(-h, 1.0)), (at(h, -1.0), at(-h, -1.0))
            still = self.baseline.rigid - self.baseline.added
            kept[j, "qq"] = (ahead - 2.0 * still + behind) / h**2
            kept[j, "qv"] = (faster[0] - faster[1] - slower[0] + slower[1]) / (4.0 * h)
            kept[j, "vv"] = 0.5 * (sum(faster) + sum(slower)) - ahead - behind
            kept[j, "qa"] = (at(h, more=1.0) - ahead - at(-h, more=1.0) + behind) / (2.0 * h)
        return kept[j, what]
