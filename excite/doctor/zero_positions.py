"""Zeros of joint positions that are quarter turns away from the model's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from excite.arrays import Array
from excite.doctor.torque_samples import TorqueSamples, mean_left
from excite.rows.drive_terms import slides

# Controllers and models place their zeros along different links: quarter turns apart, and never just a little.
_QUARTERS = (1, -1, 2)
# Two zeros can be off at once and one alone bring nothing: joints this far apart are tried together.
_TOGETHER = 2
_SAMPLES = 300
# What every further joint has to bring, as mean over the joints of half the logarithm of the residual's power.
_LEAST_STEP = 0.1


@dataclass(frozen=True, eq=False)
class ZeroPositions:
    """Zeros with which the nominal model explains the torques best.

    Attributes:
        score: what is then left, as :func:`~excite.doctor.torque_samples.mean_left`.
        quarters: ``(n_joints,)`` quarter turns to add to each joint's positions.
    """

    score: float
    quarters: Array

    def text(self, joints: tuple[str, ...]) -> str:
        """The zeros in words."""
        moved = [f"{90 * self.quarters[j]:+.0f}° to {joints[j]}" for j in np.flatnonzero(self.quarters)]
        return f"zeros of positions look quarter turns off the model's: add {', '.join(moved)}"


def best_zeros(samples: TorqueSamples, start: float) -> ZeroPositions:
    """Turn one joint or two near each other to where the torques fit best, and again as long as that brings much.

    Args:
        samples: the log's.
        start: what is left as they are.
    """
    n = len(samples.places)
    few = _thinned(samples)
    # A joint that slides has no quarter turns.
    turning = [j for j in range(n) if not slides(samples.robot.model, samples.places[j])]
    moves = [{j: a} for j in turning for a in _QUARTERS]
    near = [(j, k) for j in turning for k in turning if 0 < k - j <= _TOGETHER]
    moves += [{j: a, k: b} for j, k in near for a, b in product(_QUARTERS, repeat=2)]
    best = ZeroPositions(mean_left(few), np.zeros(n))
    for _ in turning:
        found = min((_turned(few, best.quarters, move) for move in moves), key=_gain_by(best), default=best)
        if _gain_by(best)(found) > -_LEAST_STEP:
            break
        best = found
    if not best.quarters.any():
        return ZeroPositions(start, best.quarters)
    return replace(best, score=mean_left(_moved(samples, best.quarters)))


def _gain_by(best: ZeroPositions) -> Callable[[ZeroPositions], float]:
    """What is left per joint that changes, lower is better: two joints have to bring twice as much."""

    def gain(item: ZeroPositions) -> float:
        return (item.score - best.score) / max(1, int(np.count_nonzero(item.quarters - best.quarters)))

    return gain


def _turned(samples: TorqueSamples, quarters: Array, move: dict[int, int]) -> ZeroPositions:
    changed = quarters.copy()
    for joint, quarter in move.items():
        changed[joint] = quarter
    return ZeroPositions(mean_left(_moved(samples, changed)), changed)


def _thinned(samples: TorqueSamples) -> TorqueSamples:
    step = slice(None, None, max(1, len(samples.q) // _SAMPLES))
    return replace(
        samples, q=samples.q[step], v=samples.v[step], a=samples.a[step], torque=samples.torque[step]
    )


def _moved(samples: TorqueSamples, quarters: Array) -> TorqueSamples:
    q = samples.q.copy()
    q[:, samples.places + samples.q.shape[1] - samples.v.shape[1]] += 0.5 * np.pi * quarters
    return replace(samples, q=q)
