"""Sizes that are known in the model of the gap."""

from __future__ import annotations

from dataclasses import replace

import pytest

from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import Model, fit_model
from tests.diagnosis.test_budget import FRICTION, bias_and_stribeck, searched, two_joints


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Model:
    """A model with some of its design's terms."""
    folder = tmp_path_factory.mktemp("joints")
    found = searched(two_joints(folder, bias_and_stribeck), FRICTION)
    return fit_model(found.design, found.model.chosen[:1])


def others(model: Model) -> list[int]:
    keys = {term.key for term in model.terms}
    return [k for k, term in enumerate(model.design.terms) if term.key not in keys]


def test_a_size_that_is_known_can_be_let_free(model: Model) -> None:
    """A gear's torque has the size one; let free it has what the same column has that nobody calls known."""
    term = next(design_term for k in others(model) if (design_term := model.design.terms[k]).n_free == 1)
    chosen = range(len(model.chosen) + 1)
    sizes = {}
    for name, known, freed in (("known", True, None), ("freed", True, chosen[-1]), ("fitted", False, None)):
        last = replace(term, known=known)
        design = Design(model.design.rows, (*model.terms, last))
        found = fit_model(design, chosen, model.weight, freed=freed)
        sizes[name] = float(found.x[found.layout.begin[-1]])
    assert sizes["known"] == pytest.approx(1.0, abs=1e-3)
    assert sizes["freed"] == pytest.approx(sizes["fitted"], rel=1e-3)
    assert abs(sizes["freed"] - 1.0) > 0.1
