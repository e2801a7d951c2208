"""A prior over inertial parameters about the nominal ones, by which readings of the channels are judged.

Nominal masses and centres are wrong by some tenths, and robots carry loads that nobody wrote down. A fit may therefore
move every inertial parameter, at a price: the further from the nominal value, the higher. What only impossible bodies
explain, such as a torque with its sign turned, costs more than what it brings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from excite.arrays import Array, Indices
from excite.doctor.thresholds import THRESHOLD
from excite.regressor.tree import KinematicTree

STRONG_ODDS = float(np.log(THRESHOLD.strong_odds))
"""Odds at which one of several explanations that are as likely beforehand is strongly supported [nat]."""


def half_log(shares: Array) -> Array:
    """Half the logarithm of shares of power that are left, and of the least that tells where less is."""
    return np.asarray(0.5 * np.log(np.maximum(shares, THRESHOLD.least_share)))


def count_effective_samples(residual: Array, trial: Indices) -> Array:
    """Samples that are as good as independent, ``(m,)``: n / (1 + 2 Σ ρ_k), at least one.

    The autocorrelations ρ_k are added in pairs of neighbouring lags while these are positive (initial positive
    sequence, Geyer 1992, section 3.3): what is left beside rigid bodies is mostly other physics, alike over much of a
    motion.

    Args:
        residual: ``(n, m)`` what is left of each channel.
        trial: ``(n,)`` a number for each trial: no lag goes beyond one.
    """
    totals = np.zeros((len(residual), residual.shape[1]))
    for one in np.unique(trial):
        part = residual[trial == one]
        power = np.abs(np.fft.rfft(part - part.mean(axis=0), 2 * len(part), axis=0)) ** 2
        totals[: len(part)] += np.fft.irfft(power, 2 * len(part), axis=0)[: len(part)]
    rho = totals / np.maximum(totals[0], 1e-300)
    even = len(rho) // 2 * 2
    pairs = rho[0:even:2] + rho[1:even:2]
    positive = np.cumprod(pairs > 0.0, axis=0)
    return np.asarray(len(residual) / np.maximum(2.0 * (pairs * positive).sum(axis=0) - 1.0, 1.0))


@dataclass(frozen=True, eq=False)
class Judgement:
    """What likely bodies leave of a reading's channels.

    Attributes:
        left: ``(m,)`` half the logarithm of each channel's share of power that is left.
        cost: of the bodies' deviation from the nominal ones [nat].
        counts: ``(m,)`` effective samples of each channel.
        drives: ``(m, k)`` what each channel holds of what is its own, by column; empty of channels that share it.
        moved: ``(k,)`` the likeliest deviations of all parameters that have a spread; ``std`` how well they are
            known, where that was asked.
    """

    left: Array
    cost: float
    counts: Array
    drives: Array
    moved: Array
    std: Array

    def odds(self, other: Judgement) -> float:
        """Logarithm of another reading's likelihood per this one's, by this one's effective samples [nat]."""
        return float(self.counts @ (self.left - other.left)) + self.cost - other.cost

    def posterior(self, other: Judgement, *, tried: int = 1, changes: int = 1) -> float:
        """The same times prior odds of one in so many that were tried for each of so many changes [nat].

        Minus infinity where another reading leaves, and its bodies cost a sample, less by so little as not to matter.
        """
        gain = float((self.left - other.left).sum() + (self.cost - other.cost) / self.counts.mean())
        matters = gain > THRESHOLD.least_gain * changes
        return self.odds(other) - changes * float(np.log(tried)) if matters else -np.inf


def likely_spread(tree: KinematicTree, payload: float = 0.0) -> Array:
    """Standard deviations of inertial parameters about the nominal ones, ``(10·n_segments,)``.

    ``payload``: of what the outermost bodies carry, as a share of the robot's mass.
    """
    phi = tree.phi.reshape(-1, 10)
    mass, own = phi[:, 0], THRESHOLD.own_spread
    outermost = ~np.isin(np.arange(len(phi)), np.asarray(tree.parents)[1:] - 1)
    astray = own * mass + (THRESHOLD.load_spread + payload * outermost) * mass.sum()
    centre = np.linalg.norm(phi[:, 1:4], axis=1) / np.maximum(mass, 1e-9)
    arm = np.minimum(centre, 1.0) + THRESHOLD.centre_astray_m
    inertias = own * np.abs(phi[:, 4:]) + (astray * arm**2)[:, None]
    return np.column_stack([astray, *[astray * arm] * 3, inertias]).ravel()


def normal_equations(rows: Sequence[Array], places: Sequence[Indices]) -> Array:
    """Mean products of all unknowns of channels, and of the channels themselves, ``(m, size + 1, size + 1)``.

    Args:
        rows: of each channel ``(k + 1, n)``, per unit of the unknowns that it has, and the channel.
        places: ``(k + 1,)`` of these among all unknowns, the channel's after the last of them.
    """
    size = places[0][-1] + 1
    sums = np.zeros((len(rows), size, size))
    for channel, part, place in zip(sums, rows, places, strict=True):
        channel[place[:, None], place] = part @ part.T / part.shape[1]
    return sums


def left_of_channels(rows: Sequence[Array], places: Sequence[Indices], x: Array) -> Array:
    """What unknowns ``(size,)`` leave of channels, as :func:`normal_equations` has them, ``(n, m)``."""
    unknowns = np.append(-x, 1.0)
    return np.column_stack([unknowns[place] @ part for part, place in zip(rows, places, strict=True)])


def judge_bodies(
    spread: Array,
    body: Array,
    own: Array,
    target: Array,
    trial: Indices,
    counts: Array | None,
    *,
    of_drives: bool,
    precise: bool = False,
) -> Judgement:
    """What likely bodies leave of channels; weights are those of what is left, found again and again.

    Args:
        spread: of :func:`likely_spread`.
        body: ``(n, m, 10·n_segments)`` channel per unit of each inertial parameter, in units of its scale.
        own: ``(n, m, k)`` what else a channel may hold, per standard deviation: offset, friction and rotor of each
            channel by itself, the last three not negative; or what all channels have in common.
        target: ``(n, m)`` measured less nominal, in the same units.
        trial: ``(n,)`` a number for each sample's trial.
        counts: ``(m,)`` effective samples; None for those of what is left.
        of_drives: whether ``own`` is each channel's by itself, and free.
        precise: whether it is asked how well parameters are known, which takes a while.
    """
    columns = np.ascontiguousarray((body * spread).transpose(1, 2, 0))
    felt = np.abs(columns).max(axis=2) > 1e-9
    used = np.flatnonzero(felt.any(axis=0))
    (_, m, k), first = own.shape, len(used)
    size = first + k * (m if of_drives else 1)
    rows, places = [], []
    for j in range(m):
        # A joint feels the bodies beyond it alone, and forces do not feel inertias.
        mine = np.flatnonzero(felt[j])
        rows.append(np.concatenate([columns[j, mine], own[:, j].T, target[:, j, None].T]))
        places.append(np.r_[np.searchsorted(used, mine), first + of_drives * k * j + np.arange(k), size])
    sums = normal_equations(rows, places)
    # Unknowns that may be negative.
    priced = first if of_drives else size
    signed = np.arange(size) < priced
    signed[priced::k] = True
    allowed, shares, x = np.ones(size, dtype=bool), np.full(m, 0.1), np.zeros(size)
    told = count_effective_samples(target, trial) if counts is None else counts
    for _ in range(3):
        whole = np.tensordot(told / np.maximum(shares, THRESHOLD.least_share), sums, 1)
        matrix, right = whole[:-1, :-1], whole[:-1, -1]
        np.fill_diagonal(matrix, (1.0 + THRESHOLD.ridge) * (1.0 + np.diag(matrix)))
        wrong = np.ones(size, dtype=bool)
        while wrong.any():
            x = np.zeros(size)
            kept = np.flatnonzero(allowed)
            x[kept] = cho_solve(cho_factor(matrix[np.ix_(kept, kept)]), right[kept])
            wrong = (x < 0.0) & ~signed
            allowed &= ~wrong
        rest = left_of_channels(rows, places, x)
        shares = (rest**2).mean(axis=0)
        if counts is None:
            told = count_effective_samples(rest, trial)
    moved, std = np.zeros_like(spread), spread.copy()
    moved[used] = spread[used] * x[:first]
    if precise:
        covariance = cho_solve(cho_factor(matrix[np.ix_(kept, kept)]), np.eye(len(kept)))
        std[used] *= np.sqrt(np.diag(covariance)[:first])
    drives = x[first:].reshape(m, k) if of_drives else np.zeros((0, k))
    return Judgement(half_log(shares), 0.5 * float(x[:priced] @ x[:priced]), told, drives, moved, std)
