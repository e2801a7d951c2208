"""Effects at a place in the equations of a baseline, as a diagnosis puts them there."""

from __future__ import annotations

from excite.diagnosis.arm.read import hypothesis_of
from excite.diagnosis.attribution import Hypothesis
from excite.diagnosis.budget.fit.terms import TermMaker
from excite.diagnosis.effects.effect import Effect, Theta
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline


def fitted(baseline: Baseline, effect: Effect, place: str, theta: Theta = ()) -> Hypothesis:
    """An effect fitted beside what is modelled, alone."""
    term = TermMaker(Context(baseline), baseline.strict).make_term(effect, place, theta)
    assert term is not None
    item = hypothesis_of(term, baseline)
    assert item is not None
    return item
