"""Non-linear parameters of all terms of a model, and how friction changes sign beside them, searched together at last.

A term's parameters that were searched while another's were rough have stood in for it, and a friction's sign that was
chosen without it for both. So all are moved together by Gauss and Newton's steps with Levenberg's damping; what is
linear is projected out (variable projection: Golub, Pereyra 1973; Kaufman 1975), and after each step the predictions
that columns are made of are made again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from excite.diagnosis.budget.fit.design import Rows
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.library import Library
from excite.diagnosis.budget.polish.knobs import SIGN, Moved, knobs_of
from excite.diagnosis.budget.polish.state import State
from excite.diagnosis.budget.polish.steps import Steps
from excite.diagnosis.budget.refine import RICHER
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.friction_sign import WIDTHS, SignChange


@dataclass(frozen=True, eq=False)
class Polisher:
    """Searches the non-linear parameters of a model's terms together.

    Attributes:
        library: makes what the model begins with.
    """

    library: Library

    @cached_property
    def _steps(self) -> Steps:
        return Steps(Moved(self.library))

    def polished(self, full: Baseline, rows: Rows, terms: Sequence[Term]) -> State:
        """The terms at their best parameters together, each in the plainest form that says as much.

        Args:
            full: what every model begins with, fitted.
            rows: weighted rows of what is modelled.
            terms: the terms.
        """
        state = State.fitted(full, rows, terms)
        if not knobs_of(state):
            return state
        state = self._steps.searched(state)
        state = State.fitted(state.full, state.rows, state.terms, weight=state.model.weight)
        state = self._in_forms(state)
        rubbing = sorted({knob.joint for knob in knobs_of(state) if knob.term == SIGN})
        before = state.full
        for j in rubbing:
            state = self._plain_sign(state, j)
        state = state if state.full is before else self._in_forms(state)
        # Forms were tried joint by joint, the other joints' columns as they were.
        return min(state, state.remade(state.prediction), key=lambda item: item.loss)

    def _in_forms(self, state: State) -> State:
        """Each term in the plainest form that says as much, and the one of highest order of those."""
        for k, term in enumerate(state.terms):
            if not term.started:
                for other in _other_forms(term.effect):
                    state = self._in_form(state, k, other)
        return state

    def _in_form(self, state: State, k: int, effect: Effect) -> State:
        """A term in another form, where that says as much with less, or more with as much."""
        term = state.terms[k]
        theta = term.theta[: len(effect.searched)]
        made = TermMaker(state.prediction.without(k), state.full.strict).make(effect, term.location, theta)
        if made is None:
            return state
        begun = state.changed((*state.terms[:k], made, *state.terms[k + 1 :]))
        if not begun.can_be(k):
            return state
        found, spared = self._steps.searched(begun, term.own), term.n_parameters - made.n_parameters
        if not state.can_be(k):
            return found
        return found if found.loss < state.loss + (RICHER + spared if spared > 0 else 0.0) else state

    def _plain_sign(self, state: State, j: int) -> State:
        """A joint's friction without the bristles that it may have been thought to have for want of a term."""
        if not state.full.signs[j].bent:
            return state
        signs = list(state.full.signs)
        signs[j] = SignChange(WIDTHS[len(WIDTHS) // 2])
        new = self._steps.moved.with_signs(state, signs, [term.theta for term in state.terms])
        if new is None:
            return state
        found = self._steps.searched(state.changed(new.terms, new.full, new.rows), j)
        return found if found.loss < state.loss + RICHER else state


def _other_forms(effect: Effect) -> list[Effect]:
    """The form with what a first order leaves out, and the plain one of which an effect is a richer form."""
    others = [] if effect.closer is None else [effect.closer]
    plain = EFFECTS.get(effect.name)
    if plain is None or type(plain) is type(effect):
        return others
    if effect.closer is None and plain.closer is not None:
        plain = plain.closer
    return [*others, plain] if effect.searched[: len(plain.searched)] == plain.searched else others
