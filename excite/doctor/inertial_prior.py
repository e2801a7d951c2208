"""A prior over inertial parameters about the nominal ones, by which readings of the channels are judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from excite.arrays import Array
from excite.regressor.kernels import joint_torque_regressor
from excite.regressor.tree import KinematicTree
from excite.rows.drive_terms import smooth_sign

# How well bodies that are likely, given the nominal ones, explain torques: what a misreading is judged by.
#
# Nominal masses and centres are wrong by some tenths, and robots carry loads that nobody wrote down. A fit
# may therefore move every inertial parameter, at a price: the further from the nominal value, the higher.
# What only impossible bodies explain, such as a torque with its sign turned, costs more than what it brings.

# Standard deviation of a mass about its nominal value: a share of its own, and a share of the robot's for loads.
_OWN, _LOAD = 0.3, 0.03
# Centres of mass and extents that are wrong, beside a load's own [m]: those of CAD models are off by 1 to 3 cm.
_ASTRAY_M = 0.04
# Drives: standard deviations of offset, viscous and dry friction and rotor inertia, in units of the torque's own
# deviation and the motion's; as good as free.
_FREE = 10.0
_PASSES = 3
# Added to each diagonal of the normal equations, as a share: what rounding takes off them is some hundred times less.
# Of a log of a standing arm, the reading with a clock in nanoseconds had entries of 1e27 beside the prior's 1.
_RIDGE = 1e-12
# Less than this share of a channel's power is no better explained: nominal inertias are off by some tenths.
FLOOR = 1e-3
# What a reading has to leave less of to matter: half the logarithm of the residual's power [nat], for each change. In
# 22 logs of simulated arms with up to 18 effects each and 10 of real ones no change brings more than 0.10, or 0.14
# where all joints move as one; the mistakes that were put into such logs bring from 0.5 to 16.
LEAST_GAIN = 0.35
# Odds at which one of several explanations that are as likely beforehand is strongly supported [nat]: twenty to one
# (Kass and Raftery 1995, section 3.2).
STRONG_ODDS = float(np.log(20.0))


def half_log(shares: Array) -> Array:
    """Half the logarithm of shares of power that are left, and of :data:`FLOOR` where less is."""
    return np.asarray(0.5 * np.log(np.maximum(shares, FLOOR)))


def count_effective_samples(residual: Array, trial: NDArray[np.int64]) -> Array:
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
    """

    left: Array
    cost: float
    counts: Array

    def odds(self, other: Judgement) -> float:
        """Logarithm of another reading's likelihood per this one's, by this one's effective samples [nat]."""
        return float(self.counts @ (self.left - other.left)) + self.cost - other.cost

    def posterior(self, other: Judgement, *, tried: int = 1, changes: int = 1) -> float:
        """The same times prior odds of one in so many that were tried for each of so many changes [nat].

        Minus infinity where another reading leaves, and its bodies cost a sample, less by so little as not to matter.
        """
        gain = float((self.left - other.left).sum() + (self.cost - other.cost) / self.counts.mean())
        matters = gain > LEAST_GAIN * changes
        return self.odds(other) - changes * float(np.log(tried)) if matters else -np.inf


@dataclass(frozen=True, eq=False)
class LikelyBodies:
    """Standard deviations of inertial parameters about the nominal ones, ``(10·n_segments,)``."""

    spread: Array

    @classmethod
    def of(cls, tree: KinematicTree) -> LikelyBodies:
        """From the nominal parameters of a model."""
        phi = tree.phi.reshape(-1, 10)
        mass = phi[:, 0]
        astray = _OWN * mass + _LOAD * mass.sum()
        centre = np.linalg.norm(phi[:, 1:4], axis=1) / np.maximum(mass, 1e-9)
        arm = np.minimum(centre, 1.0) + _ASTRAY_M
        spread = np.empty_like(phi)
        spread[:, 0] = astray
        spread[:, 1:4] = (astray * arm)[:, None]
        spread[:, 4:] = _OWN * np.abs(phi[:, 4:]) + (astray * arm**2)[:, None]
        return cls(spread.ravel())

    def left(
        self,
        tree: KinematicTree,
        motion: tuple[Array, Array, Array],
        columns: NDArray[np.int64],
        torque: Array,
        nominal: Array,
        width: Array,
        trial: NDArray[np.int64],
        counts: Array | None = None,
    ) -> Judgement:
        """What likely bodies leave of torques.

        Args:
            tree: the model, under the gravity of the reading.
            motion: ``q (n, nq)``, ``v``, ``a (n, nv)``.
            columns: ``(n_torques,)`` indices into ``v`` of the joints that have a torque.
            torque: ``(n, n_torques)``.
            nominal: what it holds of the nominal bodies', likewise.
            width: ``(n_torques,)`` speed over which dry friction changes sign [rad/s].
            trial: ``(n,)`` a number for each sample's trial.
            counts: ``(n_torques,)`` effective samples; None for those of what is left.
        """
        q, v, a = motion
        n, m = torque.shape
        body = joint_torque_regressor(tree, q, v, a)[:, columns]
        scale = np.maximum(torque.std(axis=0), 1e-12)
        target = (torque - nominal) / scale
        felt = np.abs(body).max(axis=0) * self.spread > 1e-9
        used = np.flatnonzero(felt.any(axis=0))
        k = len(used)
        columns_of, places = [], []
        for j in range(m):
            # A joint feels the bodies beyond it alone.
            mine = np.flatnonzero(felt[j])
            speed, push = v[:, columns[j]], a[:, columns[j]]
            drive = np.column_stack([np.ones(n), speed, smooth_sign(speed, width[j]), push])
            drive = drive / np.maximum(np.sqrt((drive**2).mean(axis=0)), 1e-12) * _FREE
            rows = np.column_stack([body[:, j, mine] * (self.spread[mine] / scale[j]), drive])
            places.append(np.concatenate([np.searchsorted(used, mine), k + 4 * j + np.arange(4)]))
            columns_of.append(rows)
        return _fitted(columns_of, target, places, k, trial, counts)

    def left_of_wrench(
        self,
        body: Array,
        others: Array,
        target: Array,
        trial: NDArray[np.int64],
        counts: Array | None = None,
    ) -> Judgement:
        """The same of a wrench, whose parts have no drives.

        Args:
            body: ``(n, m, 10·n_segments)`` wrench per unit of each inertial parameter, in units of its scale.
            others: ``(n, m, k)`` what sensors and pose may add, per standard deviation, in the same units.
            target: ``(n, m)`` measured less nominal, in the same units.
            trial: ``(n,)`` a number for each sample's trial.
            counts: ``(m,)`` effective samples; None for those of what is left.
        """
        felt = np.abs(body).max(axis=0) * self.spread > 1e-9
        used = np.flatnonzero(felt.any(axis=0))
        _, m, added = others.shape
        columns_of, places = [], []
        for j in range(m):
            # Forces do not feel inertias.
            mine = np.flatnonzero(felt[j])
            rows = np.column_stack([body[:, j, mine] * self.spread[mine], others[:, j]])
            places.append(np.concatenate([np.searchsorted(used, mine), len(used) + np.arange(added)]))
            columns_of.append(rows)
        return _fitted(columns_of, target, places, len(used) + added, trial, counts)


def _fitted(
    rows: list[Array],
    target: Array,
    places: list[NDArray[np.int64]],
    k: int,
    trial: NDArray[np.int64],
    counts: Array | None,
) -> Judgement:
    """Weights by what is left, again and again; friction and rotors that come out negative are left out.

    ``places`` says which unknowns each channel's equations have: the first ``k`` are the bodies', four a drive follow.
    """
    (n, m), size = target.shape, 1 + max(int(place.max()) for place in places)
    grams = [part.T @ part / n for part in rows]
    rights = [part.T @ target[:, j] / n for j, part in enumerate(rows)]
    allowed = np.ones(size, dtype=bool)
    shares = np.full(m, 0.1)
    told = count_effective_samples(target, trial) if counts is None else counts
    x = np.zeros(size)
    for _ in range(_PASSES):
        weights = told / np.maximum(shares, FLOOR)
        matrix, right = np.eye(size), np.zeros(size)
        for j in range(m):
            matrix[places[j][:, None], places[j]] += weights[j] * grams[j]
            right[places[j]] += weights[j] * rights[j]
        np.fill_diagonal(matrix, (1.0 + _RIDGE) * np.diag(matrix))
        while True:
            kept = np.flatnonzero(allowed)
            x = np.zeros(size)
            x[kept] = cho_solve(cho_factor(matrix[np.ix_(kept, kept)]), right[kept])
            wrong = np.flatnonzero(x < 0.0)
            wrong = wrong[(wrong >= k) & ((wrong - k) % 4 != 0)]
            if not len(wrong):
                break
            allowed[wrong] = False
        rest = target - np.column_stack([part @ x[place] for part, place in zip(rows, places, strict=True)])
        shares = (rest**2).mean(axis=0)
        if counts is None:
            told = count_effective_samples(rest, trial)
    return Judgement(half_log(shares), 0.5 * float(x[:k] @ x[:k]), told)
