"""The joint torque equations of an arm, and the weighted fit that every hypothesis is judged by."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array

# Columns smaller than this share of the largest one of their hypothesis are rounding errors.
_NOTHING = 1e-7
# Fewer trials do not tell how much they disagree.
TRIALS = 3


@dataclass(frozen=True, eq=False)
class Equations:
    """Rows ``y_j = A_j x + O_j o_j + noise`` for every joint j; x is shared, o_j is the joint's own.

    Attributes:
        shared: ``(n_joints, n_rows, n_shared)``, scaled so that a priori ``x`` has unit variance.
        own: one ``(n_rows, n_own)`` a joint.
        y: ``(n_joints, n_rows)``: torque less the nominal rigid bodies' where those are fitted or trusted.
        use: ``(n_rows,)`` rows that are fitted (identification).
        trial: ``(n_rows,)`` index of the trial.
        floor: ``(n_joints,)`` noise below which no joint is weighted up [N·m].
    """

    shared: Array
    own: tuple[Array, ...]
    y: Array
    use: NDArray[np.bool_]
    trial: NDArray[np.int64]
    floor: Array

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.y)


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis fitted on the identification rows.

    Attributes:
        equations: the rows.
        shared: ``(n_shared,)`` x.
        extra: ``(n_extra,)`` coefficients of the hypothesis' columns.
        extra_std: their standard deviations for white residuals.
        sigma: ``(n_joints,)`` weights' standard deviations [N·m].
        columns: ``(n_joints, n_rows, n_extra)`` of the hypothesis, None where it has none.
        offset: ``(n_joints, n_rows)`` torque taken off, None where there is none.
        held: coefficients of the joints' own columns where other rows have told them; None where these do.
    """

    equations: Equations
    shared: Array
    extra: Array
    extra_std: Array
    sigma: Array
    columns: Array | None
    offset: Array | None
    held: tuple[Array, ...] | None = None

    @cached_property
    def before_own(self) -> Array:
        """What the joints' own columns have to explain, ``(n_joints, n_rows)`` [N·m]."""
        e = self.equations
        rest = e.y - e.shared @ self.shared
        if self.columns is not None:
            rest = rest - self.columns @ self.extra
        return rest if self.offset is None else rest - self.offset

    @cached_property
    def own_coefs(self) -> tuple[Array, ...]:
        """Coefficients of the joints' own columns, one ``(n_own,)`` a joint."""
        if self.held is not None:
            return self.held
        e = self.equations
        made = (
            np.linalg.lstsq(own[e.use], rest[e.use], rcond=1e-10)[0]
            for own, rest in zip(e.own, self.before_own, strict=True)
        )
        return tuple(np.where(own.any(axis=0), x, 0.0) for own, x in zip(e.own, made, strict=True))

    @cached_property
    def residual(self) -> Array:
        """Residual of all rows, ``(n_joints, n_rows)`` [N·m]."""
        rest = self.before_own.copy()
        for j, o in enumerate(self.own_coefs):
            rest[j] -= self.equations.own[j] @ o
        return rest


@dataclass(eq=False)
class Solver:
    """Fits with the joints' own columns projected out once; hypotheses bring extra columns.

    Attributes:
        equations: the rows.
    """

    equations: Equations
    _q: list[Array] = field(init=False)
    _a: list[Array] = field(init=False)
    _y: list[Array] = field(init=False)
    _gram: Array = field(init=False)
    _cross: Array = field(init=False)

    def __post_init__(self) -> None:
        e = self.equations
        n, empty = e.shared.shape[2], np.zeros(0)
        self._q, self._a, self._y = ([empty] * e.n_joints for _ in range(3))
        self._gram, self._cross = np.zeros((e.n_joints, n, n)), np.zeros((e.n_joints, n))
        for j in range(e.n_joints):
            self._project_joint(j)

    def _project_joint(self, j: int) -> None:
        e = self.equations
        own = e.own[j][e.use]
        own = own[:, own.any(axis=0)]
        q = np.linalg.qr(own / np.maximum(np.linalg.norm(own, axis=0), 1e-12))[0] if own.shape[1] else own
        self._q[j], self._a[j], self._y[j] = (q, _project(q, e.shared[j][e.use]), _project(q, e.y[j][e.use]))
        self._gram[j] = self._a[j].T @ self._a[j]
        self._cross[j] = self._a[j].T @ self._y[j]

    def with_own(self, joint: int, own: Array) -> Solver:
        """The same equations with other own columns of one joint."""
        columns = tuple(own if k == joint else o for k, o in enumerate(self.equations.own))
        new = copy(self)
        new.equations = replace(self.equations, own=columns)
        new._q, new._a, new._y = list(self._q), list(self._a), list(self._y)
        new._gram, new._cross = self._gram.copy(), self._cross.copy()
        new._project_joint(joint)
        return new

    def fit_columns(
        self,
        extra: Array | None = None,
        offset: Array | None = None,
        iterations: int = 6,
        widths: Array | None = None,
    ) -> Fit:
        """Fit by iterated weights, one a joint.

        Args:
            extra: ``(n_joints, n_rows, n_extra)`` further columns.
            offset: ``(n_joints, n_rows)`` torque that is known: taken off ``y``.
            iterations: of the weights.
            widths: ``(n_extra,)`` a priori standard deviations of the coefficients, infinite without.

        Returns:
            The fit.
        """
        e = self.equations
        m = 0 if extra is None else extra.shape[2]
        n = e.shared.shape[2]
        touched = [] if extra is None else [j for j in range(e.n_joints) if extra[j].any()]
        c = {j: _project(self._q[j], extra[j][e.use]) for j in touched} if extra is not None else {}
        y = list(self._y)
        cross = self._cross
        if offset is not None:
            cross = cross.copy()
            for j in range(e.n_joints):
                if offset[j].any():
                    y[j] = y[j] - _project(self._q[j], offset[j][e.use])
                    cross[j] = self._a[j].T @ y[j]
        yy = np.array([v @ v for v in y])
        scale = np.sqrt(sum((v**2).sum(axis=0) for v in c.values())) if c else np.zeros(m)
        # A direction that the motion does not show is no column: rounding errors would be fitted in its place.
        scale = np.where(scale > _NOTHING * scale.max(initial=0.0), scale, np.inf)
        gram = np.zeros((e.n_joints, n + m, n + m))
        right = np.zeros((e.n_joints, n + m))
        gram[:, :n, :n], right[:, :n] = self._gram, cross
        for j, v in c.items():
            v = v / scale
            gram[j, :n, n:] = self._a[j].T @ v
            gram[j, n:, :n] = gram[j, :n, n:].T
            gram[j, n:, n:] = v.T @ v
            right[j, n:] = v.T @ y[j]
        count = int(e.use.sum())
        sigma = np.sqrt(np.maximum(yy / count, e.floor**2))
        prior = np.concatenate([np.ones(n), np.full(m, 1e-9)])
        if widths is not None:
            # Along what the motion hardly shows there is no more than a body of this world can have.
            prior[n:] += 1.0 / (widths * scale) ** 2
        x = np.zeros(n + m)
        normal = np.eye(n + m)
        for _ in range(iterations):
            w = 1.0 / sigma**2
            normal = np.tensordot(w, gram, axes=1) + np.diag(prior)
            normal[n:, n:] += 1e-10 * np.trace(normal[n:, n:]) * np.eye(m)
            x = np.linalg.solve(normal, w @ right)
            rss = yy - 2.0 * right @ x + np.einsum("jab,a,b->j", gram, x, x)
            new = np.sqrt(np.maximum(rss / count, e.floor**2))
            done = np.max(np.abs(new - sigma) / sigma) < 1e-2
            sigma = new
            if done:
                break
        beta = x[n:] / scale
        covariance = np.linalg.inv(normal)[n:, n:] if m else np.zeros((0, 0))
        std = np.sqrt(np.diag(covariance)) / scale
        return Fit(e, x[:n], beta, std, sigma, extra, offset)

    def std_between_trials(self, fit: Fit, widths: Array | None = None) -> Array:
        """Standard deviations of a fit's extra coefficients as its trials disagree, ``(n_extra,)``.

        What a model leaves is alike within a trial, and white noise's deviations are too small then. The sandwich of
        the trials' gradients (Liang, Zeger 1986) asks for their independence alone; never less than white noise's.

        Args:
            fit: made by this solver.
            widths: ``(n_extra,)`` a priori standard deviations that it was made with.

        Returns:
            In the coefficients' units; of a coefficient whose column shows nothing, what it has a priori.
        """
        if fit.columns is None:
            return fit.extra_std
        few = len(np.unique(self.equations.trial[self.equations.use])) < TRIALS
        std = fit.extra_std if few else np.maximum(self._sandwich(fit, fit.columns, widths), fit.extra_std)
        prior = np.full(len(std), np.inf) if widths is None else widths
        return np.where(fit.columns.any(axis=(0, 1)), std, prior)

    def _sandwich(self, fit: Fit, columns: Array, widths: Array | None = None) -> Array:
        """The sandwich for columns ``(n_joints, n_rows, n)`` beside all that the fit has."""
        e, n = self.equations, self.equations.shared.shape[2]
        size = np.sqrt((columns[:, e.use] ** 2).sum(axis=(0, 1)))
        scale = np.maximum(size, max(_NOTHING * float(size.max()), 1e-100))
        own = [_project(q, block[e.use] / scale) for q, block in zip(self._q, columns, strict=True)]
        rows = [np.hstack([a, o]) / s for a, o, s in zip(self._a, own, fit.sigma, strict=True)]
        rest = [left[e.use] / s for left, s in zip(fit.residual, fit.sigma, strict=True)]
        known = np.zeros(len(scale)) if widths is None else 1.0 / (widths * scale) ** 2
        return std_of_trials(rows, rest, e.trial[e.use], np.concatenate([np.ones(n), known]))[n:] / scale


def _project(q: Array, values: Array) -> Array:
    return values - q @ (q.T @ values) if q.shape[1] else values


# Standard deviations by which trials disagree: the sandwich of their gradients (Liang, Zeger 1986).


def std_of_trials(
    rows: Sequence[Array], rest: Sequence[Array], trial: NDArray[np.int64], prior: Array
) -> Array:
    """Standard deviations of the coefficients of a weighted least-squares fit, ``(n,)``, in its rows' units.

    Args:
        rows: by channel, ``(n_rows, n)`` in units of its noise.
        rest: by channel, ``(n_rows,)`` what the fit leaves, in the same units.
        trial: ``(n_rows,)`` index of the trial.
        prior: ``(n,)`` precision that each coefficient has a priori.
    """
    trials = np.unique(trial)
    normal, gradients = np.diag(prior), np.zeros((len(trials), len(prior)))
    for a, left in zip(rows, rest, strict=True):
        normal += a.T @ a
        gradients += [left[trial == k] @ a[trial == k] for k in trials]
    # Columns that a short record cannot tell apart, or does not show, have no deviation of their own.
    moved = np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ gradients.T
    return np.sqrt((moved**2).sum(axis=1) * len(trials) / (len(trials) - 1))
