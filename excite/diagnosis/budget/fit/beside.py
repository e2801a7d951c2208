"""What further columns gain beside a fitted model, its weights as they are: products of matrices, no rows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.joint_fit import Model, effective_share
from excite.diagnosis.budget.fit.terms import Term


class _Own(NamedTuple):
    """Products of a term's columns at one joint, nothing weighted.

    Attributes:
        cross: ``(n, size)`` with the model's columns.
        inner: ``(size, size)`` with themselves.
        slope: ``(size,)`` with what the model leaves.
    """

    cross: Array
    inner: Array
    slope: Array


class _Products(NamedTuple):
    """Products of a term's columns, weighted.

    Attributes:
        left: ``(size, size)`` with themselves, beside the model's columns.
        slope: ``(size,)`` with what the model leaves.
        cross: ``(n_parameters, size)`` with the model's columns.
        own: by joint.
    """

    left: Array
    slope: Array
    cross: Array
    own: dict[int, _Own]


class _Joint(NamedTuple):
    """A model's columns at one joint.

    Attributes:
        columns: ``(n, n_rows)`` at the rows that are fitted.
        inner: ``(n, n)`` products with themselves.
        rest: ``(n_rows,)`` what the model leaves.
        slope: ``(n,)`` products with that.
    """

    columns: Array
    inner: Array
    rest: Array
    slope: Array


@dataclass(frozen=True, eq=False)
class Beside:
    """What columns gain beside a model, its weights as they are.

    Attributes:
        model: without the term.
        inverse: of its normal matrix.
    """

    model: Model
    inverse: Array
    _joints: dict[int, _Joint] = field(default_factory=dict)

    @classmethod
    def of(cls, model: Model) -> Beside:
        """Beside a model."""
        return cls(model, np.asarray(np.linalg.inv(model.normal)))

    def gain(self, term: Term) -> tuple[float, Array]:
        """Nats that a term's columns gain, each joint's by what is left of it, and its parameters."""
        m = self.model
        found = self._fitted(term)
        if found is None:
            return -np.inf, np.zeros(term.size)
        x, shift, own = found
        nats = 0.0
        for j in range(m.design.rows.n_joints):
            at, z = self.joint(j), shift[m.layout.numbers[j]]
            more = float(z @ (at.inner @ z) - 2.0 * z @ at.slope)
            if j in own:
                here = own[j]
                more += float(x @ (here.inner @ x + 2.0 * here.cross.T @ z - 2.0 * here.slope))
            n = len(at.rest)
            ratio = 1.0 + more * float(m.weight[j]) / n
            nats -= 0.5 * n * float(m.share[j]) * float(np.log(max(ratio, 1e-9)))
        return nats, x

    def between(self, one: Term, other: Term) -> float:
        """Nats that another term's columns gain over those of one, against what is left with the other's.

        What the other explains beyond the one is no sign of how alike neighbouring rows are.
        """
        rows = self.model.design.rows
        use = rows.block >= 0
        left = [self.model.residual.copy() for _ in (one, other)]
        for rest, term in zip(left, (one, other), strict=True):
            changes = self._changes(term)
            if not changes:
                return -np.inf
            rest[:, use] -= np.array(changes)
        share = effective_share(left[1], use, rows.trial, left[0] - left[1])
        before, after = ((rest[:, use] ** 2).sum(axis=1) for rest in left)
        return float(0.5 * use.sum() * (share * np.log(before / np.maximum(after, 1e-300))).sum())

    def _fitted(self, term: Term) -> tuple[Array, Array, dict[int, _Own]] | None:
        """A term's parameters, how the model's change with it, and its products; None where it is the model's own."""
        left, slope, cross, own = self._products(term)
        if (np.diag(left) <= 0.0).any():
            return None
        x: Array = np.ones(1) if term.known else np.asarray(np.linalg.solve(left, slope))
        return x, -self.inverse @ (cross @ x), own

    def _changes(self, term: Term) -> list[Array]:
        """By joint, how its rows change with a term; none where it is the model's own."""
        m, use, found = self.model, self.model.design.rows.block >= 0, self._fitted(term)
        if found is None:
            return []
        x, shift, _ = found
        changes = []
        for j in range(m.design.rows.n_joints):
            moved = shift[m.layout.numbers[j]] @ self.joint(j).columns
            changes.append(moved + term.columns[j][use] @ x if j in term.columns else moved)
        return changes

    def _products(self, term: Term) -> _Products:
        """A term's products with its own columns, the rest and the model's columns."""
        m = self.model
        use = m.design.rows.block >= 0
        size = term.size
        cross, inner, slope = np.zeros((m.layout.size, size)), np.zeros((size, size)), np.zeros(size)
        own = {}
        for j, block in term.columns.items():
            inside, w, at = block[use], m.weight[j], self.joint(j)
            own[j] = _Own(at.columns @ inside, inside.T @ inside, inside.T @ at.rest)
            cross[m.layout.numbers[j]] += w * own[j].cross
            inner += w * own[j].inner
            slope += w * own[j].slope
        left = inner - cross.T @ (self.inverse @ cross) + 1e-8 * np.diag(np.diag(inner))
        return _Products(left, slope, cross, own)

    def joint(self, j: int) -> _Joint:
        """The model's columns at a joint."""
        if j not in self._joints:
            m = self.model
            use = m.design.rows.block >= 0
            columns = np.ascontiguousarray(m.design.matrices[j].T[m.layout.columns[j]][:, use])
            c, rest = m.layout.columns[j], m.residual[j][use]
            self._joints[j] = _Joint(columns, m.design.fitted.total[j][np.ix_(c, c)], rest, columns @ rest)
        return self._joints[j]
