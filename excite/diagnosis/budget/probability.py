"""How likely an effect is beside what else would do in its place, and beside nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.diagnosis.budget.thresholds import THRESHOLDS

# Odds at the width within which two effects are called alike: e³, about 20 to 1.
_ODDS = 3.0


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
