"""Columns that go through the filter side by side, or are kept, are those that each would be alone and anew."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.budget.fit.terms import TermMaker
from excite.diagnosis.budget.library import Library
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.dry_friction.friction_sign import SIGNS
from excite.diagnosis.equations.own_columns import own_rows, own_signals, own_terms
from tests.diagnosis.effects.arm_record import FULL, baseline


def test_own_terms_at_every_sign_change_are_those_of_each_alone() -> None:
    samples, terms = baseline(drives=True).samples, own_terms(FULL)
    # The second time they are those that were kept.
    for _ in range(2):
        made = own_rows(samples, terms, 1, SIGNS)
        assert len(made) == len(SIGNS)
        for sign, rows in zip(SIGNS, made, strict=True):
            signals = own_signals(samples, terms, 1, sign)
            np.testing.assert_allclose(rows, samples.to_rows(signals, [1] * signals.shape[1]), atol=1e-12)


def test_terms_made_together_are_those_made_one_by_one() -> None:
    base = baseline(drives=True)
    library = Library(FULL[:1], tuple(EFFECTS.values()))
    together = library.make_candidate_terms(TermMaker(Context(base), base.strict), Context(base))
    assert len(together) > 100
    base.derived.rows.clear()
    maker = TermMaker(Context(base), base.strict)
    for term in together:
        alone = maker.make_term(term.effect, term.location, term.theta)
        assert alone is not None and alone.kept == term.kept and set(alone.columns) == set(term.columns)
        for j, block in term.columns.items():
            np.testing.assert_allclose(alone.columns[j], block, rtol=1e-9, atol=1e-12)
