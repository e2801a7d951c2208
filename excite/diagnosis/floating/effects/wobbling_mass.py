"""Part of a segment's mass wobbles on it: viscera, fat, a load on foam."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, links, points, segment_of
from excite.diagnosis.floating.effects.form import Beyond
from excite.diagnosis.floating.equations.cross import cross
from excite.diagnosis.floating.equations.state import State

# A mass that sags further under its weight hangs, and is no tissue [m].
_MOST_SAG = 0.12
# A segment of less than this share of the whole mass moves no sensor by what wobbles on it.
_LEAST_SHARE = 0.02
# Frequencies at which it is looked for [Hz], and the share of critical damping there.
_BEGINNINGS_HZ, _DAMPING = (1.6, 2.1, 3.0), 0.2
_MASS_STEP = 0.05


@dataclass(frozen=True)
class WobblingMass(FloatingEffect):
    """A point-like part m of a segment's mass on a spring and damper alike in all directions (Gruber et al. 1998).

    The model holds it where it rests. From there it is displaced by Δ, in the world's axes:
    ``Δ'' + 2ζω Δ' + ω² Δ = −(a − g) − R ḡ``, with a the acceleration of its place, R the segment's rotation and ḡ the
    mean gravity in the segment's frame, under which it rests. It pulls at the segment by −m Δ'' more than the model
    says, and its weight and inertia act at Δ from where the model has them.

    Attributes:
        level: whether it moves in the horizontal alone, as liquid in a tank or a pendulum does: no tissue.
    """

    level: bool = False

    name: ClassVar[str] = "soft_tissue"
    form: ClassVar[str] = "wobbling_mass"
    reads_as: ClassVar[str] = "an external force, and elasticity of the joints that carry the segment"
    confusable_with: ClassVar[tuple[str, ...]] = ("external_force", "joint_elasticity")
    says = Beyond.FORCES
    least_shrink: ClassVar[float] = 0.3
    # A resonance is narrow.
    rough_steps: ClassVar[int] = 10

    def locations(self, state: State) -> tuple[str, ...]:
        """Links with a good part of the whole mass."""
        whole = state.record.tree.phi[::10].sum()
        return tuple(link for link in links(state) if self._own_mass(state, link) > _LEAST_SHARE * whole)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Mass, where it rests, and how it wobbles: logarithms, so that neither can be negative."""
        return (
            Parameter("mass", "kg", 0.5 * self._own_mass(state, location), _MASS_STEP),
            *points(),
            Parameter("log_frequency", "", 1.0, 1e-2),
            Parameter("log_damping", "", 0.7, 1e-2),
        )

    def beginnings(self, state: State, location: str) -> tuple[Array, ...]:
        """No mass, at several frequencies: a resonance is found from near it alone."""
        slowest = _slowest_hz(state)
        logs = (float(np.log(hertz / slowest - 1.0)) for hertz in _BEGINNINGS_HZ if hertz > slowest)
        return tuple(np.array([0.0, 0.0, 0.0, 0.0, log, 0.0]) for log in logs)

    def allows(self, theta: Array) -> bool:
        """Masses are positive."""
        return bool(theta[0] > 0.0)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Let it wobble; it is a part of the segment's mass, and nothing below zero."""
        mass = self._mass(state, location, theta)
        if not mass:
            return state
        segment = segment_of(state, location)
        held = state.on_unit_mass(segment, theta[1:4])
        displaced, further = self._wobble(state, segment + 1, theta, held)
        wrench = state.at_base(-mass * further, state.poses.point(segment + 1, theta[1:4]))
        moment = cross(displaced, -mass * (held + further))
        wrench[:, 3:] += np.einsum("nji,nj->ni", state.poses.rotation[:, 1], moment)
        return state.replace(extra=state.extra + wrench)

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """Where there is no mass, how it would wobble does not matter."""
        if theta[0] > 0.0:
            return super().columns(state, location, theta)
        ahead = theta.copy()
        ahead[0] = _MASS_STEP
        columns = np.zeros((len(state.q), 6, len(theta)))
        columns[:, :, 0] = (state.residual - self.apply(state, location, ahead).residual) / _MASS_STEP
        return columns

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """Mass and place as they are; frequency and damping ratio for their logarithms."""
        hertz, ratio = _frequency(state, theta), _damping_ratio(theta)
        spread = (hertz - _slowest_hz(state)) * float(std[4])
        theta = np.array([self._mass(state, location, theta), *theta[1:]])
        straight = list(super().report(state, location, theta, std).items())[:4]
        return dict(straight) | {
            "frequency": Estimate(hertz, spread, "Hz"),
            "damping_ratio": Estimate(ratio, ratio * float(std[5]), ""),
        }

    def _wobble(self, state: State, joint: int, theta: Array, held: Array) -> tuple[Array, Array]:
        """Displacement from where it rests and the acceleration of that, each ``(n, 3)``, world.

        A trial begins with the mass where its load holds it.
        """
        omega, ratio = 2.0 * np.pi * _frequency(state, theta), _damping_ratio(theta)
        rotation = state.poses.rotation[:, joint]
        upright = np.einsum("nji,j->i", rotation, -state.tree.gravity)
        upright *= np.linalg.norm(state.tree.gravity) / np.linalg.norm(upright)
        load = rotation @ upright - held
        if self.level:
            up = -state.tree.gravity / np.linalg.norm(state.tree.gravity)
            load = load - (load @ up)[:, None] * up
        # scipy.signal takes 0.4 s to load, and an arm's diagnosis, which loads this module too, needs none of it.
        from scipy.signal import lfilter

        filters = _filters(omega, ratio, 1.0 / state.record.rate_hz)
        displaced, further = np.empty_like(load), np.empty_like(load)
        for span in state.record.spans:
            change = load[span] - load[span][0]
            for out, (top, bottom) in zip((displaced, further), filters, strict=True):
                out[span] = lfilter(top, bottom, change, axis=0)
            displaced[span] += load[span][0] / omega**2
        return displaced, further

    def _mass(self, state: State, location: str, theta: Array) -> float:
        return float(np.clip(theta[0], 0.0, self._own_mass(state, location)))

    def _own_mass(self, state: State, link: str) -> float:
        return float(state.record.tree.phi[10 * segment_of(state, link)])


def _slowest_hz(state: State) -> float:
    """Frequency at which a mass sags by the most that tissue does [Hz]."""
    return float(np.sqrt(np.linalg.norm(state.tree.gravity) / _MOST_SAG) / (2.0 * np.pi))


def _frequency(state: State, theta: Array) -> float:
    """Natural frequency [Hz], above the slowest one whatever the parameter."""
    return _slowest_hz(state) * float(1.0 + np.exp(np.clip(theta[4], -20.0, 5.0)))


def _damping_ratio(theta: Array) -> float:
    """Share of critical damping, within what filters can express."""
    return _DAMPING * float(np.exp(np.clip(theta[5], -6.0, 6.0)))


@lru_cache(maxsize=32)
def _filters(omega: float, ratio: float, step: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Numerator and denominator of the displacement and of its acceleration, the load changing linearly in a step."""
    # As lfilter above.
    from scipy.signal import cont2discrete

    spring = [1.0, 2.0 * ratio * omega, omega**2]
    (top, bottom, _), (again, same, _) = (
        cont2discrete((top, spring), step, "foh") for top in ([1.0], [1.0, 0.0, 0.0])
    )
    return (top.ravel(), bottom), (again.ravel(), same)
