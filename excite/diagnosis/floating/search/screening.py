"""Every effect at every place, linearised once: which deserve a closer look."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.effects.effect import FloatingEffect
from excite.diagnosis.floating.effects.registry import FLOATING_EFFECTS
from excite.diagnosis.floating.equations.problem import LinearFit, Problem
from excite.diagnosis.floating.equations.state import State


@dataclass(frozen=True, eq=False)
class Screened:
    """An effect at a place and its linearised fit.

    Attributes:
        effect: the effect.
        location: the place.
        begun: parameters with which it is absent, at which it is linearised.
        fit: of what is added to them, in units of their scales.
    """

    effect: FloatingEffect
    location: str
    begun: Array
    fit: LinearFit

    def start(self, state: State) -> Array:
        """Its parameters by that fit, in their units."""
        return self.begun + self.fit.theta * self.effect.scales(state, self.location)


def effect_columns(
    problem: Problem, state: State, effect: FloatingEffect, location: str, theta: Array
) -> Array:
    """Whitened columns of an effect in units of its scales, unloaded sensors included, ``(m, k)``."""
    base = problem.whitening(effect.columns(state, location, theta))
    unloaded = np.zeros((6 * len(problem.unloaded.sensors), base.shape[1]))
    if len(unloaded) and effect.changes_readings:
        here = problem.unloaded.residual(effect.apply(state, location, theta))
        for i, parameter in enumerate(effect.parameters(state, location)):
            ahead = theta.copy()
            ahead[i] += parameter.step
            there = problem.unloaded.residual(effect.apply(state, location, ahead))
            unloaded[:, i] = (here - there) / parameter.step
    return np.vstack([base, unloaded]) * effect.scales(state, location)


def screen(problem: Problem, state: State, rows: Array) -> list[Screened]:
    """Linearised fits of all effects at all places from the likeliest of their beginnings, best evidence first.

    Args:
        problem: the problem.
        state: the state to linearise at.
        rows: ``(m,)`` whitened residual there.
    """
    hypotheses = [
        (effect, location, begun)
        for effect in FLOATING_EFFECTS.values()
        if effect.name not in state.record.modelled
        for location in effect.locations(state)
        for begun in effect.beginnings(state, location)
    ]
    columns = [effect_columns(problem, state, *hypothesis) for hypothesis in hypotheses]
    screened = [
        Screened(*hypothesis, fit)
        for hypothesis, fit in zip(hypotheses, problem.fit_each(rows, columns), strict=True)
    ]
    likeliest: dict[tuple[FloatingEffect, str], Screened] = {}
    for item in sorted(screened, key=lambda item: -item.fit.evidence):
        if item.effect.allows(item.start(state)):
            likeliest.setdefault((item.effect, item.location), item)
    return list(likeliest.values())
