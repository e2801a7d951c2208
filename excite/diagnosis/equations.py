"""The joint torque equations of an arm, and the weighted fit that every hypothesis is judged by."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from excite.robot.robot import Array


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
        shared: ``(n_shared,)`` x.
        own: one ``(n_own,)`` a joint.
        extra: ``(n_extra,)`` coefficients of the hypothesis' columns.
        extra_std: their standard deviations, correlation of the residuals included.
        residual: ``(n_joints, n_rows)`` of all rows [N·m].
        sigma: ``(n_joints,)`` weights' standard deviations [N·m].
    """

    shared: Array
    own: tuple[Array, ...]
    extra: Array
    extra_std: Array
    residual: Array
    sigma: Array


@dataclass(eq=False)
class Solver:
    """Fits with the joints' own columns projected out once; hypotheses bring extra columns.

    Attributes:
        equations: the rows.
        ridge: weight of the prior on ``x``; and of the prior on each extra coefficient where one is given.
    """

    equations: Equations
    _q: list[Array] = field(init=False)
    _a: list[Array] = field(init=False)
    _y: list[Array] = field(init=False)
    _gram: Array = field(init=False)
    _cross: Array = field(init=False)

    def __post_init__(self) -> None:
        e = self.equations
        self._q, self._a, self._y = [], [], []
        n = e.shared.shape[2]
        self._gram, self._cross = np.zeros((e.n_joints, n, n)), np.zeros((e.n_joints, n))
        for j in range(e.n_joints):
            own = e.own[j][e.use]
            q = np.linalg.qr(own / np.maximum(np.linalg.norm(own, axis=0), 1e-12))[0] if own.shape[1] else own
            self._q.append(q)
            self._a.append(_project(q, e.shared[j][e.use]))
            self._y.append(_project(q, e.y[j][e.use]))
            self._gram[j] = self._a[j].T @ self._a[j]
            self._cross[j] = self._a[j].T @ self._y[j]

    def fit(self, extra: Array | None = None, offset: Array | None = None, iterations: int = 6) -> Fit:
        """Fit by iterated weights, one a joint.

        Args:
            extra: ``(n_joints, n_rows, n_extra)`` further columns.
            offset: ``(n_joints, n_rows)`` torque that is known: taken off ``y``.
            iterations: of the weights.

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
        scale = np.where(scale > 0.0, scale, 1.0)
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
        residual = e.y - e.shared @ x[:n]
        if extra is not None:
            residual -= extra @ beta
        if offset is not None:
            residual -= offset
        own = []
        for j in range(e.n_joints):
            o = np.linalg.lstsq(e.own[j][e.use], residual[j][e.use], rcond=1e-10)[0]
            residual[j] -= e.own[j] @ o
            own.append(o)
        return Fit(x[:n], tuple(own), beta, np.sqrt(np.diag(covariance)) / scale, residual, sigma)


def _project(q: Array, values: Array) -> Array:
    return values - q @ (q.T @ values) if q.shape[1] else values
