"""Trials that have a file for each quantity, in one folder."""

from __future__ import annotations

import numpy as np
import pytest

import excite
from excite.conversion.explicit_mapping import Map
from excite.errors import LogError
from tests.conversion.test_habits import check, columns_of, table
from tests.conversion.written import motion

pytestmark = pytest.mark.usefixtures("unexamined")

SEEDS = {"slow": 0, "fast": 1, "sweep": 2}


@pytest.mark.parametrize("every", [1, 5])
def test_a_file_for_each_quantity_in_a_folder_for_each_trial(arm, tmp_path, every):
    """Positions at one rate, torques at another or at the same."""
    for name, seed in SEEDS.items():
        data = motion(seed=seed)
        (tmp_path / "all" / name).mkdir(parents=True)
        table(tmp_path / "all" / name / "Positions.csv", columns_of(data, q="pos_{n}"))
        seldom = {channel: values[::every] for channel, values in data.items()}
        table(tmp_path / "all" / name / "Torques.csv", columns_of(seldom, tau="torque_{n}"))
    found = excite.convert([tmp_path / "all"], arm, tmp_path / "log")
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


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"trials": {"validation": ["typo"]}}, "names no trial: typo.*the trials are run"),
        ({"trials": {"validation": ["run*", "*_val"]}}, r"names no trial: \*_val"),
        (
            {"log": {"torque": "current", "torque_constants": {"shoulder": 0.1, "elbow": 0.0, "wrist": 0.1}}},
            "constant of 0.*elbow.*no_torque",
        ),
    ],
)
def test_what_says_nothing_in_a_map_is_refused(data, arm, tmp_path, stated, said):
    file = table(tmp_path / "run.csv", columns_of(data | {"i": data["tau"]}, q="pos_{n}", i="current_{n}_A"))
    with pytest.raises(LogError, match=rf"map\.yaml.*{said}"):
        excite.convert([file], arm, tmp_path / "log", Map.model_validate(stated))
    none = Map.model_validate({"trials": {"validation": ["none"]}})
    assert {role for _, role, _ in excite.convert([file], arm, tmp_path / "log", none).trials} == {
        "identification"
    }
