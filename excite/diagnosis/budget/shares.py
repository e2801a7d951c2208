"""What each named effect takes of each channel's gap: the mean of taken out last and let in alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import Model, fit

# Power above the floor, as a share of the floor, below which a channel has no gap to share out.
_NOTHING = 0.05


@dataclass(frozen=True, eq=False)
class Power:
    """Mean squares on the trials that judge.

    Attributes:
        mean: ``(n_joints,)``.
        blocks: ``(n_judged, n_joints)`` without a block each of those that judge.
        fits: ``(n_blocks, n_joints)`` of fits without a block each.
    """

    mean: Array
    blocks: Array
    fits: Array

    def combined(self, other: Power, sign: float) -> Power:
        """Sum with a multiple of another."""
        return Power(
            self.mean + sign * other.mean, self.blocks + sign * other.blocks, self.fits + sign * other.fits
        )

    def halfway(self, other: Power) -> Power:
        """Halfway between two."""
        return Power(
            0.5 * (self.mean + other.mean), 0.5 * (self.blocks + other.blocks), 0.5 * (self.fits + other.fits)
        )


def power_of(model: Model) -> Power:
    """Mean squares that a fitted model leaves."""
    grams = model.design.judged
    left = model.power(grams) * grams.count[:, None]
    total, count = left.sum(axis=0), float(grams.count.sum())
    without = (total - left) / np.maximum(count - grams.count, 1.0)[:, None]
    fits = np.empty((len(model.left_out), len(grams.total)))
    for j, (g, c, p) in enumerate(zip(grams.total, model.layout.columns, model.layout.numbers, strict=True)):
        z = model.left_out[:, p]
        inner = z @ g[np.ix_(c, c)] - 2.0 * g[c, -1]
        fits[:, j] = (g[-1, -1] + (inner * z).sum(axis=1)) / count
    return Power(total / count, without, fits)


def judged_power(
    design: Design,
    chosen: Sequence[int],
    weight: Array | None = None,
    sizes: Mapping[int, Array] | None = None,
) -> Power:
    """What the terms leave when they are fitted together, or have known sizes."""
    return power_of(fit(design, chosen, weight, sizes=sizes))


def deviation(values: Array) -> Array:
    """Standard deviation of a jackknife ``(n, …)`` (Miller 1974)."""
    n = len(values)
    if n < 2:
        return np.zeros(values.shape[1:])
    return np.sqrt((n - 1) / n * ((values - values.mean(axis=0)) ** 2).sum(axis=0))


@dataclass(frozen=True, eq=False)
class Shares:
    """Shares of each channel's power above the floor.

    Attributes:
        level: ``(n_joints,)`` power of the noise.
        open: ``(n_joints,)`` power above the floor without effects; 0 where there is none.
        before: ``(n_joints,)`` power without effects.
        after: ``(n_joints,)`` power with all.
        value: ``(n_terms, n_joints)``.
        half: ``(n_terms, n_joints)`` half widths of the 90 % intervals.
        lost: ``(n_terms, n_joints)`` by how much more is left without each alone, as a share of what is left with all.
        unsure: ``(n_terms, n_joints)`` half widths of the 90 % intervals of that.
        sized: ``(n_terms,)`` whether the 90 % interval of the effect's own size leaves zero out.
    """

    level: Array
    open: Array
    before: Array
    after: Array
    value: Array
    half: Array
    lost: Array
    unsure: Array
    sized: NDArray[np.bool_]


def shares_of(model: Model, floor: Array) -> Shares:
    """Share out the gap of every channel.

    Two effects that overlap share what they both take (Shapley's value is the mean over orders; of many effects the
    first and the last place stand for all), each of the size that it has beside all others: a small one that is let in
    alone is no larger for what it could take. What the means miss of all that is closed is made up in proportion.

    Args:
        model: the model of the gap.
        floor: ``(n_joints,)`` noise in the rows' band.
    """
    design = model.design
    nothing, everything = judged_power(design, ()), power_of(model)
    chosen = model.chosen
    taken, lost, sized = [], [], []
    sizes = {k: model.parameters(k) for k in chosen}
    for k in chosen:
        last = judged_power(design, [i for i in chosen if i != k], model.weight).combined(everything, -1.0)
        alone = nothing.combined(judged_power(design, (k,)), -1.0)
        lost.append(last)
        others = {i: x for i, x in sizes.items() if i != k}
        without = judged_power(design, tuple(others), model.weight, others)
        only = judged_power(design, (k,), model.weight, {k: sizes[k]})
        sized.append(0.5 * (without.mean - everything.mean + nothing.mean - only.mean))
        taken.append(last.halfway(alone))
    # What all effects leave is no less than the noise.
    level = np.minimum(floor**2, everything.mean)
    room = np.where(nothing.mean - level > _NOTHING * level, nothing.mean - level, 0.0)
    if not taken:
        empty = np.zeros((0, len(floor)))
        return Shares(
            level,
            room,
            nothing.mean,
            everything.mean,
            empty,
            empty,
            empty,
            empty,
            np.zeros(0, dtype=np.bool_),
        )
    values = [
        _normalised(
            np.array([getattr(t, name) for t in taken]),
            getattr(nothing, name),
            getattr(everything, name),
            level,
        )
        for name in ("blocks", "fits")
    ]
    value = _normalised(np.array(sized), nothing.mean, everything.mean, level)
    value = np.where(room > 0.0, value, 0.0)
    spread = np.sqrt(sum(deviation(np.moveaxis(v, 1, 0)) ** 2 for v in values))
    freedom = max(min(len(nothing.blocks), len(nothing.fits)) - 1, 1)
    wide = float(stdtrit(freedom, 0.95))
    half = np.where(room > 0.0, wide * spread, 0.0)
    left = np.maximum(everything.mean, 1e-300)
    more = np.array([item.mean for item in lost]) / left
    unsure = wide * np.array([np.hypot(deviation(item.blocks), deviation(item.fits)) for item in lost]) / left
    with_size = np.array([_has_size(model, k) for k in chosen])
    return Shares(level, room, nothing.mean, everything.mean, value, half, more, unsure, with_size)


def _has_size(model: Model, k: int) -> bool:
    """Whether an effect has a size without any block that differs from zero beside how much blocks disagree on it.

    Of several parameters what counts is how far they reach along those of all blocks, as their columns weigh them; of a
    gear, whose size is known with its stiffness or its play, the share of it that all blocks would have.
    """
    term, n = model.design.terms[k], len(model.left_out)
    if n < 2:
        return False
    if term.known:
        model = fit(model.design, model.chosen, model.weight, freed=k)
    first = model.layout.begin[model.chosen.index(k)]
    here = slice(first, first + term.size)
    along = model.normal[here, here] @ model.x[here]
    reach = model.left_out[:, here] @ along / max(float(model.x[here] @ along), 1e-300)
    there = not term.known or float(model.x[first]) > 0.0
    return there and bool(stdtrit(n - 1, 0.95) * deviation(reach) < 1.0)


def has_told_size(model: Model, k: int) -> bool:
    """Whether the 90 % interval of some parameter that an effect's name stands for leaves zero out.

    By blocks left out of the fit. A gear has no such parameter, and of two blocks nobody knows an interval.
    """
    term, n = model.design.terms[k], len(model.left_out)
    if term.known or n <= 2:
        return True
    first = model.layout.begin[model.chosen.index(k)]
    here = slice(first, first + term.size)
    beta, spread = term.beta(model.x[here]), term.beta(deviation(model.left_out[:, here]))
    told = np.abs(beta) > float(stdtrit(n - 1, 0.95)) * np.abs(spread)
    return any(sure for sure, p in zip(told, term.effect.linear, strict=True) if not p.beside)


def _normalised(taken: Array, before: Array, after: Array, level: Array) -> Array:
    """Shares that add up to what all effects together close, ``taken``'s shape."""
    room = np.maximum(before - level, _NOTHING * level)
    positive = np.maximum(taken, 0.0)
    total, closed = positive.sum(axis=0), before - after
    scaled = positive * (np.maximum(closed, 0.0) / np.maximum(total, 1e-300))
    # Where nothing is closed in sum, each stands for itself.
    return np.where((closed > 0.0) & (total > 0.0), scaled, taken) / room
