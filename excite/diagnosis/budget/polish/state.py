"""Terms at some non-linear parameters, fitted together with all that is linear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Design, Rows
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.prediction import Prediction, predicted
from excite.diagnosis.effects.effect import Theta
from excite.diagnosis.equations.baseline import Baseline


@dataclass(frozen=True, eq=False)
class State:
    """Terms at some parameters, fitted together.

    Attributes:
        full: what every model begins with, at its friction's sign changes.
        rows: what all models have in common.
        terms: the terms.
        model: fitted.
        share: ``(n_joints,)`` effective part of the rows.
    """

    full: Baseline
    rows: Rows
    terms: tuple[Term, ...]
    model: Model
    share: Array

    @classmethod
    def fitted(
        cls,
        full: Baseline,
        rows: Rows,
        terms: Sequence[Term],
        share: Array | None = None,
        weight: Array | None = None,
    ) -> State:
        """Fit terms.

        Args:
            full: what every model begins with.
            rows: what all models have in common.
            terms: the terms.
            share: ``(n_joints,)`` effective part of the rows; None for that of what is left here.
            weight: where the joints' weights begin.
        """
        model = fit(Design(rows, tuple(terms)), range(len(terms)), weight, left_out=False)
        return cls(full, rows, tuple(terms), model, model.share if share is None else share)

    def changed(self, terms: Sequence[Term], full: Baseline | None = None, rows: Rows | None = None) -> State:
        """With other terms, or other sign changes of friction."""
        full, rows = full or self.full, rows or self.rows
        return State.fitted(full, rows, terms, self.share, self.model.weight)

    @cached_property
    def loss(self) -> float:
        """Nats from saying nothing, less a constant: smaller is better."""
        grams = self.model.design.fitted
        power = self.model.power(grams.together)[0]
        return float(0.5 * grams.count.sum() * (self.share * np.log(power)).sum())

    @cached_property
    def prediction(self) -> Prediction:
        """Torques of the model."""
        return predicted(self.full, self.model)

    def can_be(self, k: int) -> bool:
        """Whether a fitted term is physical."""
        term = self.terms[k]
        return term.admissible(term.context, self.model.parameters(k))

    def remade(self, prediction: Prediction, joint: int | None = None) -> State:
        """Terms made of predictions, at the same parameters or at those that say the same, whatever fits better.

        Args:
            prediction: what the columns are made of.
            joint: index of the one whose own terms are made again; None for all terms.
        """
        terms, carried = list(self.terms), list(self.terms)
        for k, term in enumerate(terms):
            if term.started or term.effect.is_body or (joint is not None and term.own != joint):
                continue
            context = prediction.without(k)
            maker = TermMaker(context, self.full.strict)
            theta = term.effect.carried_over(term.context, context, term.location, term.theta)
            terms[k] = made_like(maker, term, term.theta) or term
            carried[k] = terms[k] if theta == term.theta else made_like(maker, term, theta) or term
        here = self.changed(terms)
        if all(a is b for a, b in zip(terms, carried, strict=True)):
            return here
        return min(here, self.changed(carried), key=lambda state: state.loss)


def made_like(maker: TermMaker, like: Term, theta: Theta) -> Term | None:
    """A term at other non-linear parameters, with the same of its linear ones."""
    whole = len(like.kept) == len(like.effect.linear)
    return maker.make(like.effect, like.location, theta, None if whole else like.kept)
