"""Files of bare numbers beside each other: times in a column of their own, none at all, other texts in the folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import excite
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import UnclearError
from tests.conversion.test_habits import check
from tests.conversion.written import RATE, WHOLE


def _bare(folder: Path, data: dict[str, np.ndarray]) -> Path:
    """As programs in C++ leave them: a file a quantity, the times in one column; differences have one row less."""
    folder.mkdir(parents=True)
    names = {"dataQ": "q", "dataDotQ": "v", "dataTorque": "tau", "dataTimeStamp": "time"}
    for name, channel in names.items():
        np.savetxt(folder / f"{name}.txt", data[channel])
    np.savetxt(folder / "dataDDotQ.txt", np.diff(data["v"], axis=0) * RATE)
    (folder / "CMakeLists.txt").write_text("cmake_minimum_required(VERSION 2.8)\nproject(Collection)\n")
    return folder


def test_times_in_a_column_of_their_own_beside_texts_that_are_no_recordings(data, arm, tmp_path):
    found = excite.convert([_bare(tmp_path / "run", data)], arm, tmp_path / "log", WHOLE)
    check(found, {key: values[:-1] for key, values in data.items()}, "q", "v", "tau")
    assert any("CMakeLists.txt" in note for note in found.notes)


def test_folders_of_trials_beside_a_text_are_read_and_called_after_what_they_are_for(data, arm, tmp_path):
    for name in ("testData", "trainData"):
        _bare(tmp_path / "all" / name, data)
    (tmp_path / "all" / "CMakeLists.txt").write_text("project(Collection)\n")
    found = excite.convert([tmp_path / "all"], arm, tmp_path / "log")
    assert {name: role for name, role, _ in found.trials} == {
        "testData": "validation",
        "trainData": "identification",
    }


def test_a_text_alone_is_refused(arm, tmp_path):
    (tmp_path / "CMakeLists.txt").write_text("project(Collection)\n1\n2\n")
    with pytest.raises(excite.errors.LogError, match="no columns of numbers"):
        excite.convert([tmp_path], arm, tmp_path / "log")


def test_a_rate_that_is_asked_for_settles_the_rest(data, arm, tmp_path):
    """Where two joints move so alike that their velocities are twins, too."""
    time, q, v = data["time"], data["q"].copy(), data["v"].copy()
    q[:, 2] = 0.95 * q[:, 0] + np.sin(0.3 * time)
    v[:, 2] = 0.95 * v[:, 0] + 0.3 * np.cos(0.3 * time)
    names = ",".join(f"{channel}{k}" for channel in ("q", "v", "tau") for k in (1, 2, 3))
    rows = np.hstack([q, v, data["tau"]])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=names, comments="")
    with pytest.raises(UnclearError, match="rate_hz") as asked:
        excite.convert([tmp_path / "run.csv"], arm, tmp_path / "log")
    assert len(asked.value.questions) == 1
    stated = Map.model_validate({"log": {"rate_hz": RATE}, **WHOLE.model_dump(exclude_defaults=True)})
    found = excite.convert([tmp_path / "run.csv"], arm, tmp_path / "log", stated)
    check(found, data | {"q": q, "v": v}, "q", "v", "tau")
