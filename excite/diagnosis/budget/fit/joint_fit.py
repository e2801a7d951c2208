"""A model fitted jointly, and predicted by what the other blocks say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Design, Grams, Layout
from excite.diagnosis.budget.fit.terms import Term

_LAGS = 200
_ITERATIONS = 30
_RIDGE = 1e-9
# Weight of what is known beside what is measured.
_KNOWN = 1e6


@dataclass(frozen=True, eq=False)
class Model:
    """Some of the design's terms, fitted.

    Attributes:
        design: the columns.
        chosen: indices of its terms.
        layout: where their parameters stand.
        x: parameters of the fit of all blocks.
        weight: ``(n_joints,)`` inverse variances.
        normal: normal matrix with what is known a priori.
        left_out: ``(n_blocks, n_parameters)`` parameters without a block each.
        predicted: ``(n_blocks, n_joints)`` sums of squares that the blocks leave when they are left out.
    """

    design: Design
    chosen: tuple[int, ...]
    layout: Layout
    x: Array
    weight: Array
    normal: Array
    left_out: Array
    predicted: Array

    @cached_property
    def residual(self) -> Array:
        """What the fit of all blocks leaves of all rows, ``(n_joints, n_rows)``."""
        rest = []
        for m, c, p in zip(self.design.matrices, self.layout.columns, self.layout.numbers, strict=True):
            # The first columns are every model's: no copy of them.
            first = int(np.argmin(np.append(c == np.arange(len(c)), False)))
            x = self.x[p]
            rest.append(m[:, -1] - m[:, :first] @ x[:first] - m[:, c[first:]] @ x[first:])
        return np.array(rest)

    @cached_property
    def effective_share(self) -> Array:
        """Effective part of the rows by the autocorrelation of what is left, ``(n_joints,)``."""
        return _effective_share(self.residual_autocorrelation) * self.known_torque_share

    @cached_property
    def known_torque_share(self) -> Array:
        """Share of the rows that hold known torques, ``(n_joints,)``."""
        return _known_torque_share(self.residual, self.design.rows.block >= 0)

    @cached_property
    def residual_autocorrelation(self) -> Array:
        """Autocorrelation of what is left, ``(n_joints, n_lags)``."""
        return estimate_autocorrelation(self.residual, self.design.rows.block >= 0, self.design.rows.trial)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its terms."""
        return tuple(self.design.terms[k] for k in self.chosen)

    def term_parameters(self, k: int, x: Array | None = None) -> Array:
        """Fitted parameters of the design's term ``k``, ``(size,)``."""
        first = self.layout.begin[self.chosen.index(k)]
        return (self.x if x is None else x)[first : first + self.design.terms[k].n_free]

    def taken_by(self, k: int) -> float:
        """About how much the design's term ``k`` takes away: the weakest are judged first."""
        size, x = 0.0, self.term_parameters(k)
        for j, block in self.design.terms[k].columns.items():
            size += float(self.weight[j] * ((block @ x) ** 2).sum())
        return size

    def residual_power(self, grams: Grams, x: Array | None = None) -> Array:
        """Mean square that it leaves of each joint in each block, ``(n_blocks, n_joints)``."""
        return _residual_squares(grams, self.layout, self.x if x is None else x) / grams.count[:, None]


def fit_model(
    design: Design,
    chosen: Sequence[int],
    weight: Array | None = None,
    *,
    left_out: bool = True,
    sizes: Mapping[int, Array] | None = None,
    freed: int | None = None,
) -> Model:
    """Fit a model by iterated weights, one a joint, and leave out each block in turn.

    Args:
        design: the columns.
        chosen: indices of its terms.
        weight: where the weights begin.
        left_out: whether to leave out blocks.
        sizes: parameters that are known, by term.
        freed: a term whose size is fitted though it is known.
    """
    chosen = tuple(chosen)
    layout, grams, floor = design.lay_out_parameters(chosen), design.fitted, design.rows.floor
    count = float(grams.count.sum())
    rows = StackedGrams.of_model(grams if left_out else grams.sum_over_blocks, layout)
    if weight is None:
        power = np.array([g[-1, -1] for g in grams.total]) / count
        weight = 1.0 / np.maximum(power, floor**2)
    prior, known = _parameter_priors(design, chosen, layout, sizes or {}, freed)
    rotors, least = design.rows.rotors, design.rows.least_rotor
    for _ in range(_ITERATIONS):
        normal, right = rows.normal_equations(weight, by_block=False)
        full = normal[0] + np.diag(prior + _RIDGE * np.diag(normal[0]))
        x = np.linalg.solve(full, right[0] + known)
        power = rows.total_squares(x) / count
        new = 1.0 / np.maximum(power, floor**2)
        done = np.max(np.abs(np.log(new / weight))) < 0.05
        weight = new
        if (none := rotors[x[rotors] < least[: len(rotors)]]).size:
            # As where the model has no effects, so that what they take is not theirs and the rotors' too.
            prior[none], done = _KNOWN * count, False
        if done:
            break
    if not left_out:
        nothing = np.zeros((0, layout.size))
        return Model(design, chosen, layout, x, weight, full, nothing, nothing)
    blocks, rights = rows.normal_equations(weight, by_block=True)
    total, right = blocks.sum(axis=0), rights.sum(axis=0)
    full = total + np.diag(prior + _RIDGE * np.diag(total))
    without = np.linalg.solve(full - blocks, (right - rights + known)[..., None])[..., 0]
    return Model(design, chosen, layout, x, weight, full, without, rows.residual_squares(without))


def _parameter_priors(
    design: Design, chosen: Sequence[int], layout: Layout, sizes: Mapping[int, Array], freed: int | None
) -> tuple[Array, Array]:
    """Precision of each parameter a priori, and that times what it is then."""
    prior, known = np.full(layout.size, 1e-12), np.zeros(layout.size)
    prior[: design.rows.shared.shape[2]] = 1.0
    for k, first in zip(chosen, layout.begin, strict=True):
        term = design.terms[k]
        here = slice(first, first + term.n_free)
        if k == freed:
            continue
        if term.known or k in sizes:
            prior[here] = _KNOWN * float(design.fitted.count.sum())
            known[here] = prior[here] * sizes.get(k, np.ones(1))
        else:
            prior[here] += term.prior_precision
    return prior, known


def _residual_squares(grams: Grams, layout: Layout, x: Array) -> Array:
    """Sums of squares that parameters leave, ``(n_blocks, n_joints)``; of each block its own where ``x`` has rows."""
    out = np.empty((len(grams.count), len(grams.of)))
    for j, (g, c, p) in enumerate(zip(grams.of, layout.columns, layout.numbers, strict=True)):
        z = np.broadcast_to(x[..., p], (len(g), len(p)))
        inner = (g[:, c[:, None], c] @ z[..., None])[..., 0] - 2.0 * g[:, c, -1]
        out[:, j] = g[:, -1, -1] + (inner * z).sum(axis=1)
    return np.maximum(out, 1e-300)


def effective_share(residual: Array, use: NDArray[np.bool_], trial: NDArray[np.int64]) -> Array:
    """Effective part of the samples, ``(n_joints,)``: 1 / (1 + 2 Σ ρ) by initial positive sums (Geyer 1992, 3.3).

    Args:
        residual: ``(n_joints, n_rows)`` what is left.
        use: ``(n_rows,)`` rows that are fitted.
        trial: ``(n_rows,)`` index of the trial.
    """
    return _effective_share(estimate_autocorrelation(residual, use, trial)) * _known_torque_share(
        residual, use
    )


def _known_torque_share(residual: Array, use: NDArray[np.bool_]) -> Array:
    """Share of the rows in which anything is left, ``(n_joints,)``: nothing is where the torque is not known."""
    return np.count_nonzero(residual[:, use], axis=1) / max(int(use.sum()), 1)


def _effective_share(rho: Array) -> Array:
    """The same from autocorrelations ``(n_joints, n_lags)``."""
    pairs = rho[:, 0:-1:2] + rho[:, 1::2]
    positive = np.cumprod(pairs > 0.0, axis=1)
    return 1.0 / np.maximum(2.0 * (pairs * positive).sum(axis=1) - 1.0, 1.0)


def estimate_autocorrelation(values: Array, use: NDArray[np.bool_], trial: NDArray[np.int64]) -> Array:
    """Of rows that are fitted, ``(n_joints, n_lags)``: within trials, over all of them."""
    numbers = np.unique(trial[use])
    members = [np.flatnonzero(trial == k) for k in numbers]
    # All below each other, each followed by as many zeros as there are lags.
    size = sum(len(m) for m in members) + _LAGS * len(members)
    laid, at = np.zeros((len(values), next_fast_len(size, real=True))), 0
    for rows in members:
        laid[:, at : at + len(rows)] = values[:, rows]
        at += len(rows) + _LAGS
    f = rfft(laid, axis=1)
    total = irfft(f.real**2 + f.imag**2, laid.shape[1], axis=1)[:, :_LAGS]
    return np.asarray(total / np.maximum(total[:, :1], 1e-300))


# Normal matrices of a model by joint and block.


@dataclass(frozen=True, eq=False)
class StackedGrams:
    """Gram matrices of a model's parameters, as sums of squares are made of them.

    Attributes:
        of: ``(n_joints, n_blocks, p, p)``.
        right: ``(n_joints, n_blocks, p)`` with the measurement.
        square: ``(n_joints, n_blocks)`` of the measurement.
        total: ``(n_joints, p, p)`` over all blocks.
    """

    of: Array
    right: Array
    square: Array
    total: Array

    @classmethod
    def of_model(cls, grams: Grams, layout: Layout) -> StackedGrams:
        """Those of a model whose parameters stand as the layout says."""
        n_joints, n_blocks, p = len(grams.of), len(grams.count), layout.size
        of, right = np.zeros((n_joints, n_blocks, p, p)), np.zeros((n_joints, n_blocks, p))
        square = np.empty((n_joints, n_blocks))
        for j, (g, c, at) in enumerate(zip(grams.of, layout.columns, layout.numbers, strict=True)):
            of[j][:, at[:, None], at] = g.take(c, axis=1).take(c, axis=2)
            right[j][:, at] = g[:, c, -1]
            square[j] = g[:, -1, -1]
        return cls(of, right, square, of.sum(axis=1))

    def normal_equations(self, weight: Array, *, by_block: bool) -> tuple[Array, Array]:
        """Normal matrices and right sides at joints' weights, ``(n, p, p)`` and ``(n, p)``.

        Args:
            weight: ``(n_joints,)``.
            by_block: whether one a block, or a single one over all.
        """
        of = self.of if by_block else self.total[:, None]
        right = self.right if by_block else self.right.sum(axis=1, keepdims=True)
        n, p = of.shape[1], of.shape[2]
        inner = (weight @ of.reshape(len(of), -1)).reshape(n, p, p)
        return inner, (weight @ right.reshape(len(right), -1)).reshape(n, p)

    def residual_squares(self, x: Array) -> Array:
        """Sums of squares that parameters ``(n_blocks, p)`` leave of each block, ``(n_blocks, n_joints)``."""
        inner = (self.of @ x[None, :, :, None])[..., 0] - 2.0 * self.right
        return np.maximum((self.square + (inner * x).sum(axis=-1)).T, 1e-300)

    def total_squares(self, x: Array) -> Array:
        """The same of parameters ``(p,)`` over all blocks, ``(n_joints,)``."""
        inner = (self.total @ x) @ x - 2.0 * self.right.sum(axis=1) @ x
        return np.maximum(self.square.sum(axis=1) + inner, 1e-300)
