"""Columns that go through the filter side by side, or are kept, are those that each would be alone and anew."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.budget.fit.terms import TermMaker
from excite.diagnosis.budget.library import Library
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.friction_sign import SIGNS
from excite.diagnosis.equations.own_columns import own_rows, own_signals, own_terms
from tests.diagnosis.effects.arm_record import FULL, baseline


def test_own_terms_at_every_sign_change_are_those_of_each_alone() -> None:
    samples, terms = baseline(drives=True).samples, own_terms(FULL)
    for lead in (0.0, 0.004):
        led = samples.with_lead(lead)
        # The second time they are those that were kept.
        for _ in range(2):
            made = own_rows(led, terms, 1, SIGNS)
            assert len(made) == len(SIGNS)
            for sign, rows in zip(SIGNS, made, strict=True):
                np.testing.assert_allclose(rows, led.rows(own_signals(led, terms, 1, sign)), atol=1e-12)


def test_a_lead_moves_what_follows_the_sign_and_nothing_else() -> None:
    samples, terms = baseline(drives=True).samples, own_terms(FULL)
    early, late = (own_rows(samples.with_lead(s), terms, 1, SIGNS[:1])[0] for s in (0.006, 0.0))
    moved = np.abs(early - late).max(axis=0) > 1e-6
    assert moved.tolist() == [False, True, False]


def test_terms_made_together_are_those_made_one_by_one() -> None:
    base = baseline(drives=True)
    library = Library(FULL[:1], tuple(EFFECTS.values()))
    together = library.candidates(TermMaker(Context(base), base.strict))
    assert len(together) > 100
    base.derived.rows.clear()
    maker = TermMaker(Context(base), base.strict)
    for term in together:
        alone = maker.make(term.effect, term.location, term.theta)
        assert alone is not None and alone.kept == term.kept and set(alone.columns) == set(term.columns)
        for j, block in term.columns.items():
            np.testing.assert_allclose(alone.columns[j], block, rtol=1e-9, atol=1e-12)
