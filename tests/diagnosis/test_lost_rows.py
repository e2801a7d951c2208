"""Rows that a logger lost: what was interpolated over a long gap says nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.equations.resampling import arm_samples
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from tests.diagnosis.two_joints import RATE_HZ, moved, two_joint_log

AT = 5 * RATE_HZ


def lost(trial: Trial, rows: int) -> Trial:
    """A trial without so many rows in its middle."""
    left = np.r_[0:AT, AT + rows : len(trial.time)]
    assert trial.tau is not None
    return replace(trial, time=trial.time[left], q=trial.q[left], tau=trial.tau[left])


def recorded(folder: Path, rows: int) -> Log:
    rng = np.random.default_rng(5)
    roles = ("identification", "identification", "validation")
    trials = tuple(lost(moved(f"t{k}", role, 10.0, rng, np.eye(2)), rows) for k, role in enumerate(roles))
    return load_log(save_log(two_joint_log(trials), folder / "log"))


@pytest.mark.parametrize(("rows", "left_out"), [(0, False), (4, False), (12, True), (40, True)])
def test_what_was_interpolated_over_a_long_gap_is_left_out(tmp_path: Path, rows: int, left_out: bool):
    log = recorded(tmp_path, rows)
    samples = arm_samples(nominal_robot(log), log, log.trials)
    if not left_out:
        assert samples.known_torque_rows is None
        return
    told = samples.known_torque_rows
    assert told is not None
    for trial, flags in zip(
        samples.trials, np.split(told.T, np.cumsum([len(t.rows) for t in samples.trials])), strict=False
    ):
        at = trial.time[trial.rows]
        gap = (at > (AT + 1) / RATE_HZ) & (at < (AT + rows - 2) / RATE_HZ)
        assert gap.any() and not flags[gap].any()
        assert flags[np.abs(at - (AT + 0.5 * rows) / RATE_HZ) > 0.5].all()


def test_lost_rows_are_no_gap_of_the_model(tmp_path: Path):
    whole, holed = (diagnose(recorded(tmp_path / str(rows), rows)) for rows in (0, 40))
    assert whole.verdict == holed.verdict == "none"
    assert holed.gap.before < 1.1 * whole.gap.before
