"""How much better a model predicts what it was not fitted on than another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.budget.fit.joint_fit import Model
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.budget.thresholds import THRESHOLDS

# Odds at the width within which two effects are called alike: e³, about 20 to 1.
_ODDS = 3.0
# Share of what is left at its place that an effect of the first search has to take: small ones patch up what a large
# one leaves at its first, rough parameters. Springs with slack always have to, of the whole gap: of friction by the
# motor's torque they patch up 3 %, which is 37 nats; where they are there they have 85 and 95 % of the joint's gap.
LARGE = 0.3


@dataclass(frozen=True, eq=False)
class Merit:
    """What a term gains.

    Attributes:
        nats: by joint, by which left-out blocks are predicted better, ``(n_joints,)``.
        steady: nats of all blocks but those that gain most.
        score: all nats less the price.
    """

    nats: Array
    steady: float
    score: float

    @property
    def passes(self) -> bool:
        """Whether it is worth its price, and not because of a few blocks."""
        return self.score > 0.0 and self.steady > 0.0


def merit(without: Model, with_it: Model, term: Term, candidates: int) -> Merit:
    """What a term gains: in the company of all others, against what stays unexplained with it."""
    count = with_it.design.fitted.count
    share = with_it.share
    effective = share * count.sum()
    old, new = without.predicted, with_it.predicted
    nats = 0.5 * effective * np.log(old.sum(axis=0) / new.sum(axis=0))
    by_block = 0.5 * share * count[:, None] * np.log(old / new)
    own = term.own is not None
    steps = by_block[:, term.own] if own else by_block.sum(axis=1)
    few = int(np.ceil(THRESHOLDS.few * len(steps)))
    steady = float(np.sort(steps)[:-few].sum())
    total = float(nats.sum())
    if own:
        # What acts on a joint has to show there.
        total = min(total, float(nats[term.own]) * 2.0) if len(term.columns) > 1 else total
    return Merit(nats, steady, total - price_of(term, candidates))


def price_of(term: Term, candidates: int) -> float:
    """Nats that a term costs among so many effects and places that were tried."""
    more = 0.5 * max(term.n_parameters - 1, 0)
    return float(THRESHOLDS.price + 0.5 * np.log(max(candidates, 1)) + more)


def nats_between(one: Model, other: Model) -> float:
    """How many nats another model predicts left-out blocks better by, against what stays unexplained with it."""
    return float(_nats(other.share_beside(one), one, other).sum())


def nats_alike(without: Model, one: Model, other: Model) -> float:
    """What a model gains over one without a term, in the effective samples by which another is compared with it.

    Nothing where the other lacks most of it at some joint. A joint that is not explained leaves so much that is alike
    that it counts few samples, beside all those of joints where both say the same: of two arms on a tilted base the
    offset of one arm's first encoder explains one.
    """
    gained, lacked = _gained_and_lacked(without, one, other)
    return 0.0 if _surely(gained, lacked).any() else float(gained.sum())


def lacks(without: Model, one: Model, other: Model) -> tuple[int, ...]:
    """Joints at which a model surely lacks most of what one gains there over one without a term."""
    return tuple(np.flatnonzero(_surely(*_gained_and_lacked(without, one, other))).tolist())


def _gained_and_lacked(without: Model, one: Model, other: Model) -> tuple[Array, Array]:
    share = other.share_beside(one)
    return _nats(share, without, one), _nats(share, other, one)


def _surely(gained: Array, lacked: Array) -> NDArray[np.bool_]:
    return (lacked > THRESHOLDS.rival) & (lacked > THRESHOLDS.most * gained)


def _nats(share: Array, one: Model, other: Model) -> Array:
    """Nats by joint that a model gains over one, in so large a share of the samples, ``(n_joints,)``."""
    effective = share * other.design.fitted.count.sum()
    return np.asarray(0.5 * effective * np.log(one.predicted.sum(axis=0) / other.predicted.sum(axis=0)))


def share_taken(without: Model, with_it: Model, of: Array | None = None) -> float:
    """What a model leaves less than another, as a share of what is above the noise, where that share is largest.

    Args:
        without: the other model.
        with_it: the model.
        of: ``(n_joints,)`` sums of squares of which it is a share, each at its joint; what the other leaves if None.
    """
    design = with_it.design
    old, new = without.predicted.sum(axis=0), with_it.predicted.sum(axis=0)
    noise = design.rows.floor**2 * design.fitted.count.sum()
    of = old if of is None else of
    return float(np.max(np.where(old > noise, (old - new) / np.maximum(of - noise, 1e-300), 0.0)))


def probabilities(score: float, behind: Sequence[float]) -> tuple[float, ...]:
    """Probability of an effect, then of its rivals; that there is nothing has the rest.

    Likelihoods are tempered: at the width within which two count as alike, the odds are 20 to 1.

    Args:
        score: nats of the effect beyond its price.
        behind: how far each rival is behind, in units of that width.
    """
    weights = np.exp(-_ODDS * np.clip(np.array([0.0, *behind]), -15.0, 15.0))
    nothing = float(np.exp(-min(max(score, 0.0), 50.0)))
    return tuple((weights / (weights.sum() + nothing)).tolist())
