"""The diagnosis of arms, end to end, on cases whose hidden effect is known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.doctor.examine import examine
from excite.errors import LogError
from excite.logs.files import load_log
from excite.logs.robot import nominal_robot
from tests.diagnosis.few_trials import few_trials


def test_tilted_base_is_named_sized_and_closed(gap_dir: Path):
    result = diagnose(gap_dir / "arm" / "case_019")
    answer = json.loads((gap_dir / "arm" / "answers.json").read_text())["case_019"]
    assert (result.verdict, result.effect, result.location) == ("effect", "base_tilt", "base")
    assert [item.effect for item in result.effects] == ["base_tilt"]
    angle = result.effects[0].parameters["angle"].value
    assert angle == pytest.approx(answer["value"], rel=0.05)
    # The gap that is left is the one that the simulator's own author was left with.
    assert result.gap.after < 1.1 * answer["oracle"]["total_oracle"]
    assert result.gap.before == pytest.approx(answer["oracle"]["total_base"], rel=0.1)
    assert "base tilt at base" in result.sentence()


def test_offset_below_the_coulomb_level_is_ambiguous(gap_dir: Path):
    result = diagnose(few_trials(load_log(gap_dir / "arm" / "case_012")))
    assert result.verdict == "ambiguous"
    assert {item.effect for item in result.ambiguous_with} == {"torque_bias", "coulomb_asymmetry"}
    assert result.location == "joint7"
    assert result.next_experiment is not None
    document = result.to_json()
    assert [c["effect"] for c in document["candidates"][:2]] == ["torque_bias", "coulomb_asymmetry"]
    json.dumps(document, allow_nan=False)


def test_a_contact_that_no_effect_explains_is_unknown_and_placed(gap_dir: Path):
    result = diagnose(few_trials(load_log(gap_dir / "arm" / "case_015")))
    assert (result.verdict, result.effect, result.location) == ("unknown", None, "panda_joint3")
    assert result.where[0].channel == "panda_joint3"


def test_log_without_identification_trial_is_refused(gap_dir: Path):
    log = load_log(gap_dir / "arm" / "case_015")
    with pytest.raises(LogError, match="identification"):
        diagnose(replace(log, trials=log.role("validation")), None)


def test_repeated_rows_are_found_and_counted(gap_dir: Path):
    log = load_log(gap_dir / "arm" / "case_019")
    first = log.trials[0]
    q, tau = first.q.copy(), np.array(first.tau)
    for row in (100, 500, 900):
        q[row], tau[row] = q[row - 1], tau[row - 1]
    dirty = replace(log, trials=(replace(first, q=q, tau=-tau), *log.trials[1:3]))
    chart = examine(nominal_robot(log), dirty)
    kinds = [fault.kind for fault in chart.findings]
    assert kinds.count("repeated_rows") == 1
    assert len(chart.log.trials[0].time) == len(first.time) - 3
