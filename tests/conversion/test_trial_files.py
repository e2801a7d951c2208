"""Trials that have a file for each quantity, in one folder."""

from __future__ import annotations

import numpy as np
import pytest

import excite
from excite.errors import LogError
from tests.conversion.test_habits import check, columns_of, table
from tests.conversion.written import motion

SEEDS = {"slow": 0, "fast": 1, "sweep": 2}


@pytest.mark.parametrize("every", [1, 5])
def test_a_file_for_each_quantity_of_each_trial(arm, tmp_path, every):
    """Positions at one rate, torques at another or at the same, called after the trial and the quantity."""
    for name, seed in SEEDS.items():
        data = motion(seed=seed)
        table(tmp_path / f"{name}_Positions.csv", columns_of(data, q="pos_{n}"))
        seldom = {channel: values[::every] for channel, values in data.items()}
        table(tmp_path / f"{name}_Torques.csv", columns_of(seldom, tau="torque_{n}"))
    found = excite.convert([tmp_path], arm, tmp_path / "log")
    assert sorted(name for name, _, _ in found.trials) == sorted(SEEDS)
    for k, trial in enumerate(found.log.trials):
        data = motion(seed=SEEDS[trial.name])
        check(found, {channel: values[::every] for channel, values in data.items()}, "q", "tau", trial=k)


def test_a_trial_without_one_of_its_files_is_refused(data, arm, tmp_path):
    for k in range(2):
        table(tmp_path / f"run{k}_positions.csv", columns_of(data, q="pos_{n}"))
    table(tmp_path / "run0_torques.csv", columns_of(data, tau="torque_{n}"))
    with pytest.raises(LogError, match="lacks the columns"):
        excite.convert([tmp_path], arm, tmp_path / "log")


def test_trials_of_the_same_columns_stay_apart(arm, tmp_path):
    for name, seed in SEEDS.items():
        table(tmp_path / f"{name}_run.csv", columns_of(motion(seed=seed), q="pos_{n}", tau="torque_{n}"))
    assert len(excite.convert([tmp_path], arm, tmp_path / "log").log.trials) == len(SEEDS)
    assert np.ptp([len(trial.time) for trial in excite.load_log(tmp_path / "log").trials]) == 0
