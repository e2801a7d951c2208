"""What a budget's effects have to be to be named: of some size, and nearer to the trials that judge."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from excite.diagnosis.answer.gap import Budget
from excite.diagnosis.arm import diagnose as judged
from excite.diagnosis.arm.read import Reading
from excite.diagnosis.attribution import Scorer
from excite.diagnosis.budget.record import Found
from excite.diagnosis.diagnose import diagnose
from excite.logs.files import load_log
from tests.diagnosis.few_trials import few_trials


@pytest.fixture(scope="module")
def reading(gap_dir: Path) -> Reading:
    """Of an arm with a constant torque at one joint."""
    made: list[Reading] = []

    def kept(found: Found, budget: Budget, scorer: Scorer) -> Reading:
        made.append(Reading(found, budget, scorer))
        return made[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judged, "Reading", kept)
        diagnose(few_trials(load_log(gap_dir / "arm" / "case_006"), 3, 1))
    return made[0]


def test_an_effect_of_some_size_is_named(reading: Reading):
    attribution, judgement = reading.verdict()
    assert judgement.verdict == "effect"
    assert [(item.name, item.location) for item in attribution.accepted] == [("torque_bias", "panda_joint4")]


def test_a_size_that_is_not_told_from_none_names_nothing(reading: Reading):
    unsure = [
        replace(item, values={name: (value, abs(value)) for name, (value, _) in item.values.items()})
        for item in reading.budget.named
    ]
    attribution, judgement = replace(reading, budget=replace(reading.budget, named=tuple(unsure))).verdict()
    assert judgement.verdict != "effect"
    assert attribution.accepted == ()


def test_what_leaves_the_trials_that_judge_no_better_explained_is_not_nearer(reading: Reading):
    attribution, _ = reading.verdict()
    assert reading._nearer(attribution.final)
    assert not reading._nearer(reading.scorer.baseline)
