"""Standing robots: what the judging trials alone hold changes no name and no size."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from excite.diagnosis.floating.diagnose import diagnose_floating
from excite.logs.files import load_log
from excite.logs.log import Log
from tests.diagnosis.few_trials import few_trials

# Plates under a TALOS, nominal inertials given and right, nothing hidden.
_CLEAN = "case_013"


@pytest.fixture(scope="module")
def gained(gap_dir: Path) -> Log:
    """One plate reads 3 % too much."""
    log = few_trials(load_log(gap_dir / "floating" / _CLEAN))
    trials = tuple(
        replace(t, wrenches=t.wrenches | {"left_plate": t.wrenches["left_plate"] * [1, 1, 1.03, 1, 1, 1]})
        for t in log.trials
    )
    return replace(log, trials=trials)


def pushed(log: Log, role: str, force: float) -> Log:
    """The log with a constant on a plate's vertical reading in the trials of a role [N]."""
    trials = []
    for trial in log.trials:
        wrenches = dict(trial.wrenches)
        if trial.role == role:
            wrenches["right_plate"] = wrenches["right_plate"] + [0.0, 0.0, force, 0.0, 0.0, 0.0]
        trials.append(replace(trial, wrenches=wrenches))
    return replace(log, trials=tuple(trials))


def test_a_push_in_the_judging_trial_alone_changes_no_name_and_no_size(gained: Log) -> None:
    plain = diagnose_floating(gained)
    other = diagnose_floating(pushed(gained, "validation", 20.0))
    assert (plain.verdict, plain.effect, plain.location) == ("effect", "sensor_gain", "left_plate.fz")
    assert plain.effects[0].parameters["gain"].value == pytest.approx(1.03, abs=0.003)
    assert (other.verdict, other.tied_locations) == (plain.verdict, plain.tied_locations)
    told = [[(e.effect, e.location, e.parameters) for e in found.effects] for found in (plain, other)]
    assert told[0] == told[1]
    # It is seen all the same: in the gap of the trial that judges.
    assert other.gap.after > plain.gap.after + 0.01
