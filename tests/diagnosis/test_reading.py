"""What a budget's effects have to be to be named: of some size, and nearer to the trials that judge."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.answer.gap import Budget
from excite.diagnosis.arm import diagnose as judged
from excite.diagnosis.arm.read import BudgetVerdict
from excite.diagnosis.attribution import Scorer
from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import fit_model
from excite.diagnosis.budget.record import GapModel
from excite.diagnosis.diagnose import diagnose
from excite.logs.files import load_log
from tests.diagnosis.few_trials import few_trials


@pytest.fixture(scope="module")
def reading(gap_dir: Path) -> BudgetVerdict:
    """Of an arm with a constant torque at one joint."""
    made: list[BudgetVerdict] = []

    def kept(found: GapModel, budget: Budget, scorer: Scorer) -> BudgetVerdict:
        made.append(BudgetVerdict(found, budget, scorer))
        return made[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judged, "BudgetVerdict", kept)
        diagnose(few_trials(load_log(gap_dir / "arm" / "case_006")))
    return made[0]


def test_an_effect_of_some_size_is_named(reading: BudgetVerdict):
    attribution, judgement = reading.decide_verdict()
    assert judgement.verdict == "effect"
    assert [(item.name, item.location) for item in attribution.accepted] == [("torque_bias", "panda_joint4")]


def blocks_apart(reading: BudgetVerdict, factor: float) -> BudgetVerdict:
    """The same where blocks of the record ask for sizes that differ by a multiple of each other's."""
    model = reading.found.model
    rows, rng = model.design.rows, np.random.default_rng(0)
    y = rows.y.copy()
    for block in np.unique(rows.block[rows.block >= 0]):
        y[:, rows.block == block] *= 1.0 + factor * rng.standard_normal()
    design = Design(replace(rows, y=y), model.design.terms)
    return replace(reading, found=replace(reading.found, model=fit_model(design, model.chosen)))


def test_a_size_that_blocks_do_not_agree_on_names_nothing(reading: BudgetVerdict):
    attribution, judgement = blocks_apart(reading, 30.0).decide_verdict()
    assert judgement.verdict != "effect"
    assert attribution.accepted == ()


def test_the_size_is_that_of_the_model_of_the_gap(reading: BudgetVerdict):
    attribution, _ = reading.decide_verdict()
    (item,) = attribution.accepted
    (named,) = (one for one in reading.budget.named if one.location == item.location)
    assert item.hypothesis.fit.extra[0] == pytest.approx(named.values["bias"][0], rel=1e-6)
    assert item.hypothesis.fit.extra_std[0] >= (1.0 - 1e-9) * named.values["bias"][1]
