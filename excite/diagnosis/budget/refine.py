"""Non-linear parameters of a term searched between those of the grid, in the joint fit with all others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.joint_fit import Model, effective_share
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.effects.effect import Effect, Theta

# Factors between neighbouring values, first and last, and how many of a kind are tried.
_FIRST, _LAST, _MOST = 1.5, 1.01, 40
# Nats by which a form with more parameters has to lead, odds of 20 to 1, and one more for each of them.
RICHER = 3.0


class _Products(NamedTuple):
    """Products of a term's columns.

    Attributes:
        left: ``(size, size)`` with themselves, beside the model's columns.
        slope: ``(size,)`` with what the model leaves.
        cross: ``(n_parameters, size)`` with the model's columns.
    """

    left: Array
    slope: Array
    cross: Array


@dataclass(frozen=True, eq=False)
class Beside:
    """What columns gain beside a model, its weights as they are.

    Attributes:
        model: without the term.
        inverse: of its normal matrix.
    """

    model: Model
    inverse: Array
    _rows: dict[int, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, model: Model) -> Beside:
        """Beside a model."""
        return cls(model, np.asarray(np.linalg.inv(model.normal)))

    def gain(self, term: Term) -> tuple[float, Array]:
        """Nats that a term's columns gain, each joint's by what is left of it, and its parameters."""
        m, use = self.model, self.model.design.rows.block >= 0
        x, changes = self._changes(term)
        nats = 0.0 if changes else -np.inf
        for j, moved in enumerate(changes):
            rest = m.residual[j][use]
            more = float(moved @ (moved - 2.0 * rest)) * float(m.weight[j]) / len(rest)
            nats -= 0.5 * len(rest) * float(m.share[j]) * float(np.log(max(1.0 + more, 1e-9)))
        return nats, x

    def between(self, one: Term, other: Term) -> float:
        """Nats that another term's columns gain over those of one, against what is left with the other's.

        What the other explains beyond the one is no sign of how alike neighbouring rows are.
        """
        rows = self.model.design.rows
        use = rows.block >= 0
        left = [self.model.residual.copy() for _ in (one, other)]
        for rest, term in zip(left, (one, other), strict=True):
            _, changes = self._changes(term)
            if not changes:
                return -np.inf
            rest[:, use] -= np.array(changes)
        share = effective_share(left[1], use, rows.trial, left[0] - left[1])
        before, after = ((rest[:, use] ** 2).sum(axis=1) for rest in left)
        return float(0.5 * use.sum() * (share * np.log(before / np.maximum(after, 1e-300))).sum())

    def _changes(self, term: Term) -> tuple[Array, list[Array]]:
        """A term's parameters and, by joint, how its rows change with it; none where it is the model's own."""
        m, use = self.model, self.model.design.rows.block >= 0
        left, slope, cross = self._products(term)
        if (np.diag(left) <= 0.0).any():
            return np.zeros(term.size), []
        x: Array = np.ones(1) if term.known else np.asarray(np.linalg.solve(left, slope))
        shift = -self.inverse @ (cross @ x)
        changes = []
        for j in range(m.design.rows.n_joints):
            moved = shift[m.layout.numbers[j]] @ self.columns(j)
            changes.append(moved + term.columns[j][use] @ x if j in term.columns else moved)
        return x, changes

    def information(self, term: Term) -> tuple[Array, Array]:
        """Normal matrix ``(size, size)`` of a term's parameters beside the model's, and their right side."""
        left, slope, _ = self._products(term)
        return left, slope

    def _products(self, term: Term) -> _Products:
        """A term's products with its own columns, the rest and the model's columns."""
        m = self.model
        use = m.design.rows.block >= 0
        size = term.size
        cross, inner, slope = np.zeros((m.layout.size, size)), np.zeros((size, size)), np.zeros(size)
        for j, block in term.columns.items():
            inside, w = block[use], m.weight[j]
            cross[m.layout.numbers[j]] += w * (self.columns(j) @ inside)
            inner += w * inside.T @ inside
            slope += w * (inside.T @ m.residual[j][use])
        left = inner - cross.T @ (self.inverse @ cross) + 1e-8 * np.diag(np.diag(inner))
        return _Products(left, slope, cross)

    def columns(self, j: int) -> Array:
        """The model's columns of a joint at the rows that are fitted, ``(n, n_rows)``."""
        if j not in self._rows:
            m = self.model
            self._rows[j] = np.ascontiguousarray(
                m.design.matrices[j].T[m.layout.columns[j]][:, m.design.rows.block >= 0]
            )
        return self._rows[j]


@dataclass(eq=False)
class Refiner:
    """Searches non-linear parameters.

    Attributes:
        maker: makes the columns.
    """

    maker: TermMaker

    def refined(
        self, beside: Beside, term: Term, forms: Sequence[Effect] = (), *, closer: bool = False
    ) -> Term:
        """The term at better parameters, or in a richer form where that is worth its parameters.

        Args:
            beside: the model without it.
            term: where to begin.
            forms: richer forms.
            closer: whether to try it with what its first order leaves out.
        """
        best, gain = self._searched(beside, term)
        for form in forms:
            for start in form.starts(best.theta)[:3]:
                begun = self._made(form, term, start)
                # A form that begins where it cannot be ends there as well.
                if begun is None or not self._can_be(begun, beside.gain(begun)[1]):
                    continue
                item, more = self._searched(beside, begun)
                if beside.between(best, item) > RICHER + (item.n_parameters - best.n_parameters):
                    best, gain = item, more
        whole = best.effect.closer if closer else None
        begun = None if whole is None else self._made(whole, best, best.theta)
        if begun is not None:
            item, more = self._searched(beside, begun)
            best = item if more > gain else best
        return best

    def unlike(self, beside: Beside, term: Term) -> list[Term]:
        """Richer forms that begin far from where the plain one does, each at its best."""
        found = []
        for form in term.effect.richer:
            starts = form.own_starts(self.maker.context, term.location)
            begun = [t for t in (self._made(form, term, start) for start in starts) if t is not None]
            if begun:
                found.append(self._searched(beside, max(begun, key=lambda t: beside.gain(t)[0]))[0])
        return found

    def _searched(self, beside: Beside, term: Term) -> tuple[Term, float]:
        """Steps on a logarithmic scale, one parameter after the other, the steps ever smaller."""
        best, gain = term, beside.gain(term)[0]
        step, tried, seen = _FIRST, 0, {_rounded(term.theta)}
        while step > _LAST and term.theta and tried < _MOST:
            moved = False
            for i, parameter in enumerate(term.effect.searched):
                for way in (step, 1.0 / step):
                    value = best.theta[i] * way
                    if not parameter.low <= value <= parameter.high:
                        continue
                    theta = (*best.theta[:i], value, *best.theta[i + 1 :])
                    tried += 1
                    # Shorter steps come back to where longer ones were: what was no better then is none now.
                    if _rounded(theta) in seen:
                        continue
                    seen.add(_rounded(theta))
                    item = self._made(term.effect, term, theta)
                    if item is None:
                        continue
                    new, x = beside.gain(item)
                    if new > gain + 1e-3 and self._can_be(item, x):
                        best, gain, moved = item, new, True
                        break
            step = step if moved else step**0.5
        return best, gain

    def _made(self, effect: Effect, like: Term, theta: Theta) -> Term | None:
        whole = len(like.kept) == len(like.effect.linear) or effect is not like.effect
        return self.maker.make(effect, like.location, theta, None if whole else like.kept)

    def _can_be(self, term: Term, x: Array) -> bool:
        if term.known:
            return True
        return term.effect.admissible(self.maker.context, term.location, term.theta, term.beta(x))


def _rounded(theta: Theta) -> tuple[str, ...]:
    """The same for parameters that differ by rounding alone."""
    return tuple(f"{value:.9e}" for value in theta)
