"""A linear filter of finite response from each joint's command to its position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.trivial.even_trial import EvenTrial

# Lengths that are tried [s]: from a stiff servo's to that of one which sways.
_LENGTHS_S = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8)
# Taps at most; between those of a long filter lie samples that are left out.
_TAPS = 40
# Ridges that are tried, relative to the mean power of the taps: commands have little above their band, and what taps
# do there is noise.
_RIDGES = (1e-8, 1e-6, 1e-4, 1e-2)
_ROWS = 20_000
# Parts of a lone trial, each left out once.
_PARTS = 4


@dataclass(frozen=True, eq=False)
class JointFir:
    """``q(t) = offset + Σ_k weight_k q_cmd(t − lags_k)`` of one joint.

    Attributes:
        lags: ``(n_taps,)`` [samples].
        weights: ``(n_taps,)``.
        offset: [rad or m].
    """

    lags: NDArray[np.intp]
    weights: Array
    offset: float

    def predicted(self, command: Array) -> Array:
        """Positions ``(n,)`` from a command ``(n,)`` [rad or m]."""
        return _taps(command, self.lags, np.arange(len(command))) @ self.weights + self.offset


@dataclass(frozen=True, eq=False)
class Fir:
    """One filter a joint.

    Attributes:
        joints: the filters.
        period_s: between samples [s].
    """

    joints: tuple[JointFir, ...]
    period_s: float

    def predicted(self, trial: EvenTrial) -> Array:
        """Positions ``(n, n_joints)`` [rad or m]."""
        return np.column_stack([f.predicted(c) for f, c in zip(self.joints, trial.command.T, strict=True)])

    @property
    def length_s(self) -> Array:
        """Length of each joint's filter, ``(n_joints,)`` [s]."""
        return np.array([f.lags[-1] * self.period_s for f in self.joints])


def fit_fir(trials: Sequence[EvenTrial]) -> Fir:
    """Filters by ridge regression, their length and ridge chosen by what is left out of these trials in turn."""
    period = float(np.median(np.diff(trials[0].time)))
    shortest = min(len(t.time) for t in trials)
    lengths = sorted({min(max(1, round(s / period)), shortest // 4) for s in _LENGTHS_S})
    folds = _folds(trials)
    joints = range(trials[0].command.shape[1])
    return Fir(tuple(_joint(trials, j, lengths, folds) for j in joints), period)


def _folds(trials: Sequence[EvenTrial]) -> list[list[NDArray[np.intp]]]:
    """Rows of each trial that are left out together: whole trials, parts of a lone one."""
    thin = max(1, sum(len(t.time) for t in trials) // _ROWS)
    rows = [np.arange(0, len(t.time), thin) for t in trials]
    if len(rows) == 1:
        return [[part] for part in np.array_split(rows[0], _PARTS)]
    none = np.zeros(0, dtype=np.intp)
    return [[r if k == i else none for k, r in enumerate(rows)] for i in range(len(rows))]


@dataclass(frozen=True, eq=False)
class _Moments:
    """Sums over rows of products of taps, one, and positions."""

    products: Array
    count: int

    def solved(self, ridge: float) -> Array:
        """Weights and offset ``(n_taps + 1,)``."""
        normal, right = self.products[:-1, :-1].copy(), self.products[:-1, -1]
        n = len(normal) - 1
        mean = normal[:n, -1] / self.count
        power = float(np.trace(normal[:n, :n])) / n - self.count * float((mean**2).mean())
        # A joint whose command stands has no power, and its taps no weight.
        normal[np.arange(n), np.arange(n)] += ridge * max(power, 0.0) + 1e-12 * (1.0 + normal[n, n])
        return np.asarray(np.linalg.solve(normal, right))

    def error(self, weights: Array) -> float:
        """Sum of the squared errors of weights."""
        both = np.append(weights, -1.0)
        return float(both @ self.products @ both)


def _joint(
    trials: Sequence[EvenTrial], joint: int, lengths: Sequence[int], folds: list[list[NDArray[np.intp]]]
) -> JointFir:
    best: tuple[float, JointFir] | None = None
    for length in lengths:
        lags = np.arange(0, length + 1, max(1, -(-length // _TAPS)), dtype=np.intp)
        parts = [_moments(trials, joint, lags, rows) for rows in folds]
        products = np.sum([p.products for p in parts], axis=0)
        whole = _Moments(products, sum(p.count for p in parts))
        rest = [_Moments(whole.products - p.products, whole.count - p.count) for p in parts]
        for ridge in _RIDGES:
            left = sum(p.error(r.solved(ridge)) for p, r in zip(parts, rest, strict=True))
            if best is None or left < best[0]:
                weights = whole.solved(ridge)
                best = left, JointFir(lags, weights[:-1], float(weights[-1]))
    if best is None:
        raise ValueError("no length was tried")
    return best[1]


def _moments(
    trials: Sequence[EvenTrial], joint: int, lags: NDArray[np.intp], rows: list[NDArray[np.intp]]
) -> _Moments:
    made = []
    for trial, here in zip(trials, rows, strict=True):
        taps = _taps(trial.command[:, joint], lags, here)
        made.append(np.column_stack([taps, np.ones(len(here)), trial.position[here, joint]]))
    stacked = np.concatenate(made)
    return _Moments(stacked.T @ stacked, len(stacked))


def _taps(command: Array, lags: NDArray[np.intp], rows: NDArray[np.intp]) -> Array:
    """Earlier commands ``(n_rows, n_taps)``; before a trial its first one held."""
    return command[np.maximum(rows[:, None] - lags, 0)]
