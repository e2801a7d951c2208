"""The equations of a record as one Gram matrix: noise whitened, what every model has integrated out.

Of each joint j the rows are ``y_j = A_j x + O_j o_j + D_j d_j + Σ_k C_jk β_k + e_j``: inertial parameters x that all
joints share, the joint's own terms o as modelled, a discrepancy d, the columns C of the effects, and red noise e. The
discrepancy is a random function of the joint's position, velocity, load and of time, cosines whose variance falls as
1/k² (Kennedy, O'Hagan 2001); its size, and the power of the likelihood, are those that what is left asks for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Rows
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.selection.prior import Atom

# Cosines of each signal that a discrepancy follows.
_COSINES = 6
# Prior precision of a joint's own terms, and ridges of scaled normal matrices: rounding, no more.
_FLAT, _RIDGE = 1e-9, 1e-10


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of the rows, and how much of them counts.

    Attributes:
        residual: ``(n_joints, n_rows)`` what the last model leaves.
        white: white part that is added to its spectrum, in units of its power.
        power: ``(n_joints,)`` factor of the variance: that of the block scores over what it should be.
        anneal: factor of the variance while shapes are on a grid.
        discrepancy: ``(n_joints,)`` deviation of the discrepancy's first cosine.
        floor: ``(n_joints,)`` noise below which nothing is weighted up.
    """

    residual: Array
    white: float
    power: Array
    anneal: float
    discrepancy: Array
    floor: Array


def discrepancy_columns(full: Baseline) -> tuple[Array, ...]:
    """Cosines of a joint's position, velocity and load and of the session's time, weighted rows, by joint."""
    context, samples, made = Context(full), full.samples, []
    for j in range(len(samples.joints)):
        columns = []
        for signal in (context.q[:, j], context.v[:, j], full.rigid[:, j], context.session_time):
            low, high = np.quantile(signal, [0.002, 0.998])
            if high - low > 1e-9:
                u = np.clip((signal - low) / (high - low), -0.1, 1.1)
                columns += [np.cos(np.pi * k * u) / k for k in range(1, _COSINES + 1)]
        rows = samples.to_rows(np.array(columns).T, [j] * len(columns))
        made.append(rows * full.strict[j][:, None])
    return tuple(made)


@dataclass(frozen=True, eq=False)
class Gram:
    """Products of whitened columns: those that every model has first, then those of all atoms.

    Attributes:
        rows: of the record.
        discrepancy: its columns, by joint.
        atoms: in the order of their columns.
        whole: ``(n, n)``; ``right (n,)`` with the measurement.
        right: ``(n,)``.
        square: of the measurement.
        always: number of columns that every model has.
        prior: ``(always,)`` their precisions.
        white: by joint, whitened columns and the measurement, ``(n_whitened, k_j + 1)``.
        index: by joint, where its columns stand among all.
        filters: by joint, coefficient of the whitening filter and standard deviation of its error.
        gram: ``(n − always, ·)`` with what every model has integrated out; ``reduced`` the right side.
        reduced: likewise.
        searched: by term whose shape was searched beside these, its products.
    """

    rows: Rows
    discrepancy: tuple[Array, ...]
    atoms: tuple[Atom, ...]
    whole: Array
    right: Array
    square: float
    always: int
    prior: Array
    white: tuple[Array, ...]
    index: tuple[NDArray[np.int64], ...]
    filters: tuple[tuple[float, float], ...]
    gram: Array
    reduced: Array
    searched: WeakKeyDictionary[Term, Any] = field(default_factory=WeakKeyDictionary)

    @classmethod
    def of_rows(cls, rows: Rows, discrepancy: tuple[Array, ...], atoms: Sequence[Atom], noise: Noise) -> Gram:
        """The Gram matrix of some atoms."""
        n_joints, shared = rows.n_joints, rows.shared.shape[2]
        own = np.cumsum([shared, *(o.shape[1] for o in rows.own)])
        free = np.cumsum([own[-1], *(d.shape[1] for d in discrepancy)])
        always = int(free[-1])
        width = [atom.n_cols for atom in atoms]
        first = always + np.cumsum([0, *width])
        n = int(first[-1])
        whole, right, square = np.zeros((n, n)), np.zeros(n), 0.0
        prior = np.ones(always)
        prior[shared : own[-1]] = _FLAT
        white, index, filters = [], [], []
        for j in range(n_joints):
            prior[free[j] : free[j + 1]] = noise.discrepancy[j] ** -2.0
            here = [np.r_[0:shared, own[j] : own[j + 1], free[j] : free[j + 1]]]
            parts = [rows.shared[j], rows.own[j], discrepancy[j]]
            for atom, at in zip(atoms, first, strict=False):
                if j in atom.columns:
                    here.append(np.arange(at, at + atom.n_cols))
                    parts.append(atom.columns[j])
            where = np.concatenate(here)
            lag, deviation = _prediction_error_filter(rows, noise, j)
            made = whiten_rows(rows, lag, np.column_stack([*parts, rows.y[j]])) / deviation
            product = made.T @ made
            whole[np.ix_(where, where)] += product[:-1, :-1]
            right[where] += product[:-1, -1]
            square += float(product[-1, -1])
            white.append(made)
            index.append(where)
            filters.append((lag, deviation))
        inner = whole[:always, :always] + np.diag(prior)
        scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
        factor = cho_factor(inner / np.outer(scale, scale) + _RIDGE * np.eye(always))
        cross = whole[:always, always:] / scale[:, None]
        solved = cho_solve(factor, cross)
        gram = whole[always:, always:] - cross.T @ solved
        reduced = right[always:] - solved.T @ (right[:always] / scale)
        return cls(
            rows,
            discrepancy,
            tuple(atoms),
            whole,
            right,
            square,
            always,
            prior,
            tuple(white),
            tuple(index),
            tuple(filters),
            0.5 * (gram + gram.T),
            reduced,
        )

    @cached_property
    def first_columns(self) -> NDArray[np.int64]:
        """First column of each atom among all."""
        return self.always + np.cumsum([0, *(atom.n_cols for atom in self.atoms)])[:-1]

    def columns_of(self, chosen: Sequence[int]) -> NDArray[np.int64]:
        """Columns of what every model has, then of some atoms."""
        own = [np.arange(self.first_columns[a], self.first_columns[a] + self.atoms[a].n_cols) for a in chosen]
        return np.concatenate([np.arange(self.always), *own])

    def compute_posterior(self, chosen: Sequence[int]) -> Posterior:
        """All parameters of a model."""
        columns = self.columns_of(chosen)
        precision = np.concatenate([self.prior, *(self.atoms[a].precision for a in chosen)])
        mean = np.concatenate([np.zeros(self.always), *(self.atoms[a].mean for a in chosen)])
        normal = self.whole[np.ix_(columns, columns)] + np.diag(precision)
        scale = np.sqrt(np.diag(normal))
        factor = cho_factor(normal / np.outer(scale, scale) + _RIDGE * np.eye(len(scale)))
        x = cho_solve(factor, (self.right[columns] + precision * mean) / scale) / scale
        covariance = cho_solve(factor, np.eye(len(scale))) / np.outer(scale, scale)
        return Posterior(self, tuple(chosen), columns, x, covariance)


@dataclass(frozen=True, eq=False)
class Posterior:
    """All parameters of one model.

    Attributes:
        of: the Gram matrix.
        chosen: its atoms.
        columns: of its parameters among all.
        x: ``(p,)`` their mean.
        covariance: ``(p, p)``.
    """

    of: Gram
    chosen: tuple[int, ...]
    columns: NDArray[np.int64]
    x: Array
    covariance: Array

    @cached_property
    def sizes_by_atom(self) -> dict[int, Array]:
        """By atom, the mean of its sizes."""
        begin = self.of.always + np.cumsum([0, *(self.of.atoms[a].n_cols for a in self.chosen)])
        return {a: self.x[i : i + self.of.atoms[a].n_cols] for a, i in zip(self.chosen, begin, strict=False)}

    @cached_property
    def residual(self) -> Array:
        """What it leaves of all rows, ``(n_joints, n_rows)``, the discrepancy taken off."""
        rows, x = self.of.rows, self.x
        shared = rows.shared.shape[2]
        rest = rows.y - rows.shared @ x[:shared]
        at = shared
        for j, own in enumerate(rows.own):
            rest[j] -= own @ x[at : at + own.shape[1]]
            at += own.shape[1]
        for j, free in enumerate(self.of.discrepancy):
            rest[j] -= free @ x[at : at + free.shape[1]]
            at += free.shape[1]
        for a in self.chosen:
            for j, block in self.of.atoms[a].columns.items():
                rest[j] -= block @ self.sizes_by_atom[a]
        return rest

    def estimate_discrepancy(self, noise: Noise, gap: Array) -> Array:
        """Deviation of each joint's discrepancy that its own cosines ask for (MacKay 1992), ``(n_joints,)``."""
        made, variance = noise.discrepancy.copy(), np.diag(self.covariance)
        at = self.of.always - sum(d.shape[1] for d in self.of.discrepancy)
        for j, free in enumerate(self.of.discrepancy):
            here = slice(at, at + free.shape[1])
            if free.shape[1]:
                size = float(np.mean(self.x[here] ** 2 + variance[here]))
                made[j] = np.sqrt(np.clip(size, (1e-4 * gap[j]) ** 2, gap[j] ** 2))
            at += free.shape[1]
        return made

    def estimate_power_factors(self, noise: Noise) -> Array:
        """Factors of the variances by which the scores of the record's blocks scatter as they should, ``(n_joints,)``.

        What is left is alike within a block and no white noise; likelihoods of misspecified models count that much less
        (Grünwald, van Ommen 2017, who learn the power; here it is told by the blocks as in a sandwich).
        """
        gram, made = self.of, noise.power.copy()
        place = np.full(len(gram.right), -1)
        place[self.columns] = np.arange(len(self.columns))
        block = gram.rows.block[gram.rows.following]
        for j, (rows, index) in enumerate(zip(gram.white, gram.index, strict=True)):
            here = np.flatnonzero(place[index] >= 0)
            columns = rows[:, here]
            rest = rows[:, -1] - columns @ self.x[place[index[here]]]
            size = (columns**2).sum(axis=0)
            columns = columns[:, size > 1e-6 * size.max()]
            q = np.linalg.qr(columns / np.sqrt((columns**2).sum(axis=0)))[0]
            scores = np.array([q[block == b].T @ rest[block == b] for b in np.unique(block)])
            freedom = len(rest) / max(len(rest) - q.shape[1], 1) * noise.anneal
            ratio = float((scores**2).sum() / q.shape[1]) * freedom
            variance = float((rest**2).mean()) * freedom
            made[j] = np.clip(made[j] * max(ratio, variance, 0.3) ** 0.8, 0.5, 200.0)
        return made


# Whitening: red noise alone. A filter of high order notches what is unexplained out of the evidence for its own
# cause.


def _prediction_error_filter(rows: Rows, noise: Noise, j: int) -> tuple[float, float]:
    """Coefficient of the first-order prediction-error filter of what is left of a joint, and its error's deviation."""
    rest, same = noise.residual[j], rows.following
    use = rows.block >= 0
    power = float((rest[use] ** 2).sum())
    along = float(rest[same] @ rest[same - 1])
    power = power * (1.0 + noise.white) + 1e-30
    lag = along / power
    variance = (power - lag * along) / max(int(use.sum()), 1)
    least = (0.1 * noise.floor[j]) ** 2
    return lag, float(np.sqrt(max(variance, least, 1e-30) * noise.power[j] * noise.anneal))


def whiten_rows(rows: Rows, lag: float, values: Array) -> Any:
    """Values ``(n_rows, …)`` less ``lag`` times those one row before, of fitted rows."""
    kept = rows.following
    return values[kept] - lag * values[kept - 1]
