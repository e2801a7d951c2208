"""How much better a model predicts what it was not fitted on than another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.joint_fit import Model
from excite.diagnosis.budget.terms import Term
from excite.diagnosis.budget.thresholds import THRESHOLDS

# Odds at the width within which two effects are called alike: e³, about 20 to 1.
_ODDS = 3.0


@dataclass(frozen=True, eq=False)
class Merit:
    """What a term gains.

    Attributes:
        nats: by joint, by which left-out blocks are predicted better, ``(n_joints,)``.
        steady: mean over blocks of their nats, in units of the deviation between them.
        score: all nats less the price.
    """

    nats: Array
    steady: float
    score: float

    @property
    def passes(self) -> bool:
        """Whether it is worth its price, and not because of one block."""
        return self.score > 0.0 and self.steady >= THRESHOLDS.steadiness


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
    spread = float(steps.std(ddof=1))
    steady = float(steps.mean()) / max(spread, 1e-12)
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
    effective = other.share_beside(one) * other.design.fitted.count.sum()
    return float((0.5 * effective * np.log(one.predicted.sum(axis=0) / other.predicted.sum(axis=0))).sum())


def probability(score: float, rivals: Sequence[float]) -> float:
    """Probability of an effect among its rivals and nothing, by their nats beyond their prices.

    Likelihoods are tempered: where two count as alike, the odds are 20 to 1.

    Args:
        score: nats of the effect beyond its price.
        rivals: of the others in its place.
    """
    width = max(THRESHOLDS.rival, THRESHOLDS.alike * score) / _ODDS
    weights = np.exp(-np.clip((score - np.array([score, *rivals])) / width, -50.0, 50.0))
    nothing = float(np.exp(-min(max(score, 0.0), 50.0)))
    return float(1.0 / (weights.sum() + nothing))
