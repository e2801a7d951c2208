"""Shortcuts of the model of the gap against plain least squares of all rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import Model, fit
from excite.diagnosis.budget.screening import screened
from tests.diagnosis.test_budget import FRICTION, bias_and_stribeck, searched, two_joints


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Model:
    """A model with some of its design's terms."""
    folder = tmp_path_factory.mktemp("joints")
    found = searched(two_joints(folder, bias_and_stribeck), FRICTION)
    return fit(found.search.design, found.search.model.chosen[:1])


def others(model: Model) -> list[int]:
    keys = {term.key for term in model.terms}
    return [k for k, term in enumerate(model.design.terms) if term.key not in keys]


def test_a_model_with_a_further_term_is_the_same_from_the_one_without_it(model: Model) -> None:
    for k in others(model):
        plain = fit(model.design, (*model.chosen, k), model.weight)
        short = fit(model.design, (*model.chosen, k), model.weight, beside=model)
        np.testing.assert_allclose(short.x, plain.x, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(short.predicted, plain.predicted, rtol=1e-6)
        np.testing.assert_allclose(short.residual, plain.residual, atol=1e-6 * np.abs(plain.residual).max())


def test_screening_tells_what_least_squares_of_all_rows_gain(model: Model) -> None:
    """Weighted rows one below the other, the model's prior as rows of their own (its normal matrix tells it)."""
    design, layout = model.design, model.layout
    use = design.rows.block >= 0
    blocks, rests = [], []
    for j, (m, c, p) in enumerate(zip(design.matrices, layout.columns, layout.numbers, strict=True)):
        wide = np.zeros((int(use.sum()), layout.size))
        wide[:, p] = m[use][:, c]
        blocks.append(np.sqrt(model.weight[j]) * wide)
        rests.append(np.sqrt(model.weight[j]) * m[use, -1])
    rows, y = np.vstack(blocks), np.concatenate(rests)
    prior = np.sqrt(np.maximum(np.diag(model.normal - rows.T @ rows), 0.0))
    count, n_joints = int(use.sum()), len(blocks)

    def left(matrix: np.ndarray, side: np.ndarray) -> np.ndarray:
        rest = side - matrix @ np.linalg.lstsq(matrix, side, rcond=None)[0]
        return (rest[: n_joints * count].reshape(n_joints, count) ** 2).sum(axis=1)

    ranking = screened(model, others(model))
    assert ranking
    before = left(np.vstack([rows, np.diag(prior)]), np.append(y, np.zeros(len(prior))))
    for item in ranking:
        term = design.terms[item.index]
        if term.known:
            continue
        parts = [
            np.sqrt(model.weight[j]) * term.columns.get(j, np.zeros((len(use), term.size)))[use]
            for j in range(n_joints)
        ]
        wide = np.block([[rows, np.vstack(parts)], [np.diag(prior), np.zeros((len(prior), term.size))]])
        after = left(wide, np.append(y, np.zeros(len(prior))))
        # No joint counts for more than its noise says: weights are no larger than that.
        nats = -0.5 * count * float(model.share @ np.log(1.0 - (before - after) / count))
        assert item.nats == pytest.approx(nats - 0.5 * term.n_parameters, rel=0.02, abs=0.5)


def test_a_size_that_is_known_can_be_let_free(model: Model) -> None:
    """A gear's torque has the size one; let free it has what the same column has that nobody calls known."""
    term = next(design_term for k in others(model) if (design_term := model.design.terms[k]).size == 1)
    chosen = range(len(model.chosen) + 1)
    sizes = {}
    for name, known, freed in (("known", True, None), ("freed", True, chosen[-1]), ("fitted", False, None)):
        last = replace(term, known=known)
        design = Design(model.design.rows, (*model.terms, last))
        found = fit(design, chosen, model.weight, freed=freed)
        sizes[name] = float(found.x[found.layout.begin[-1]])
    assert sizes["known"] == pytest.approx(1.0, abs=1e-3)
    assert sizes["freed"] == pytest.approx(sizes["fitted"], rel=1e-3)
    assert abs(sizes["freed"] - 1.0) > 0.1


def test_what_a_model_began_with_is_tried_again_whatever_is_screened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks that are left out may miss what a fit of all of them hardly does."""
    search = searched(two_joints(tmp_path), FRICTION[:1]).search
    keys = {term.key for term in search.model.terms}
    lost = ("viscous_friction", "first")
    assert lost in keys
    others = [k for k in search.model.chosen if search.design.terms[k].key != lost]
    search.model = fit(search.design, others)
    monkeypatch.setattr("excite.diagnosis.budget.search.screened", lambda model, candidates: [])
    search.forward()
    assert {term.key for term in search.model.terms} == keys
