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
# What is left beside the best rigid bodies is no noise but other physics, alike over whole motions: a trial of some
# seconds says as much as so many independent samples.
_EFFECTIVE = 50.0
# Drives: standard deviations of offset, viscous and dry friction and rotor inertia, in units of the torque's own
# deviation and the motion's; as good as free.
_FREE = 10.0
_PASSES = 3
# Added to each diagonal of the normal equations, as a share: what rounding takes off them is some hundred times less.
# Of a log of a standing arm, the reading with a clock in nanoseconds had entries of 1e27 beside the prior's 1.
_RIDGE = 1e-12
# Less than this share of a channel's power is no better explained: nominal inertias are off by some tenths.
FLOOR = 1e-3


def half_log(shares: Array) -> Array:
    """Half the logarithm of shares of power that are left, and of :data:`FLOOR` where less is."""
    return np.asarray(0.5 * np.log(np.maximum(shares, FLOOR)))


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
    ) -> Array:
        """Half the logarithm of each torque's share of power that is left, and of what the fit costs.

        Args:
            tree: the model, under the gravity of the reading.
            motion: ``q (n, nq)``, ``v``, ``a (n, nv)``.
            columns: ``(n_torques,)`` indices into ``v`` of the joints that have a torque.
            torque: ``(n, n_torques)``.
            nominal: what it holds of the nominal bodies', likewise.
            width: ``(n_torques,)`` speed over which dry friction changes sign [rad/s].

        Returns:
            ``(n_torques + 1,)``: one a channel; last what the bodies' deviation from the nominal ones costs.
        """
        q, v, a = motion
        n, m = torque.shape
        body = joint_torque_regressor(tree, q, v, a)[:, columns]
        scale = np.maximum(torque.std(axis=0), 1e-12)
        target = (torque - nominal) / scale
        felt = np.abs(body).max(axis=0) * self.spread > 1e-9
        used = np.flatnonzero(felt.any(axis=0))
        k = len(used)
        grams, rights, powers, places = [], [], [], []
        for j in range(m):
            # A joint feels the bodies beyond it alone.
            mine = np.flatnonzero(felt[j])
            speed, push = v[:, columns[j]], a[:, columns[j]]
            drive = np.column_stack([np.ones(n), speed, smooth_sign(speed, width[j]), push])
            drive = drive / np.maximum(np.sqrt((drive**2).mean(axis=0)), 1e-12) * _FREE
            rows = np.column_stack([body[:, j, mine] * (self.spread[mine] / scale[j]), drive])
            places.append(np.concatenate([np.searchsorted(used, mine), k + 4 * j + np.arange(4)]))
            grams.append(rows.T @ rows / n)
            rights.append(rows.T @ target[:, j] / n)
            powers.append(float(target[:, j] @ target[:, j]) / n)
        return _fitted(grams, rights, np.array(powers), places, k)

    def left_of_wrench(self, body: Array, others: Array, target: Array) -> Array:
        """The same of a wrench, whose parts have no drives.

        Args:
            body: ``(n, m, 10·n_segments)`` wrench per unit of each inertial parameter, in units of its scale.
            others: ``(n, m, k)`` what sensors and pose may add, per standard deviation, in the same units.
            target: ``(n, m)`` measured less nominal, in the same units.

        Returns:
            ``(m + 1,)``, as :meth:`left`.
        """
        felt = np.abs(body).max(axis=0) * self.spread > 1e-9
        used = np.flatnonzero(felt.any(axis=0))
        n, m, added = others.shape
        grams, rights, places = [], [], []
        for j in range(m):
            # Forces do not feel inertias.
            mine = np.flatnonzero(felt[j])
            rows = np.column_stack([body[:, j, mine] * self.spread[mine], others[:, j]])
            places.append(np.concatenate([np.searchsorted(used, mine), len(used) + np.arange(added)]))
            grams.append(rows.T @ rows / n)
            rights.append(rows.T @ target[:, j] / n)
        return _fitted(grams, rights, (target**2).mean(axis=0), places, len(used) + added)


def _fitted(
    grams: list[Array], rights: list[Array], powers: Array, places: list[NDArray[np.int64]], k: int
) -> Array:
    """Weights by what is left, again and again; friction and rotors that come out negative are left out.

    ``places`` says which unknowns each channel's equations have: the first ``k`` are the bodies', four a drive follow.
    """
    m, size = len(grams), 1 + max(int(place.max()) for place in places)
    allowed = np.ones(size, dtype=bool)
    shares = np.full(m, 0.1)
    x = np.zeros(size)
    for _ in range(_PASSES):
        weights = _EFFECTIVE / np.maximum(shares, FLOOR)
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
        parts = [x[place] for place in places]
        shares = np.array(
            [powers[j] - 2.0 * parts[j] @ rights[j] + parts[j] @ grams[j] @ parts[j] for j in range(m)]
        )
    cost = 0.5 * float(x[:k] @ x[:k]) / _EFFECTIVE
    return np.append(half_log(shares), cost)
