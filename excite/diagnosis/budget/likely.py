"""What is likely by itself: effects that would explain most if nothing else were there."""

from __future__ import annotations

from itertools import islice

from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.budget.screening import one_each, screened
from excite.diagnosis.budget.search import Search

# Effects that are listed.
_LISTED = 8


def likely_beside(search: Search) -> tuple[Term, ...]:
    """Terms with a name that would gain most beside a search's model, best first."""
    ranking = one_each(search.design, screened(search.model, search.allowed(search.model)))
    terms = (search.design.terms[item.index] for item in ranking)
    return tuple(islice((term for term in terms if not term.effect.nameless), _LISTED))
