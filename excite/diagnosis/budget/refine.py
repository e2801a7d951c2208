"""Non-linear parameters of a term searched between those of the grid, in the joint fit with all others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from excite.arrays import Array
from excite.diagnosis.budget.fit.beside import Beside
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.effects.effect import Effect, Theta

# Factors between neighbouring values, first and last, and how many of a kind are tried.
_FIRST, _LAST, _MOST = 1.5, 1.01, 40
# Nats by which a form with more parameters has to lead, odds of 20 to 1, and one more for each of them.
RICHER = 3.0


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
