"""Clocks of days, as spreadsheets and MATLAB count them, and arrays of one row less than others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.conversion.guesses import UnclearError
from tests.conversion.written import JOINTS, whole

pytestmark = pytest.mark.usefixtures("unexamined")


def in_days(file: Path, name: str, first: float, data: dict[str, np.ndarray]) -> Path:
    names = [name, *(f"q_{joint}" for joint in JOINTS), *(f"tau_{joint}" for joint in JOINTS)]
    rows = np.column_stack([first + data["time"] / 86_400.0, data["q"], data["tau"]])
    np.savetxt(file, rows, delimiter=",", header=",".join(names), comments="", fmt="%.12f")
    return file


@pytest.mark.parametrize("first", [45_987.5, 739_946.25])
@pytest.mark.parametrize("name", ["Date", "column"])
def test_days_of_spreadsheets_and_of_matlab_are_a_clock(first, name, data, arm, tmp_path):
    trial = whole(in_days(tmp_path / "a.csv", name, first, data), arm, tmp_path).log.trials[0]
    # Doubles of days tell ten microseconds.
    np.testing.assert_allclose(trial.time - trial.time[0], data["time"], atol=2e-5)
    np.testing.assert_allclose(trial.tau, data["tau"], atol=1e-6)


def test_days_that_are_no_date_are_asked_about_and_may_be_stated(data, arm, tmp_path):
    source = in_days(tmp_path / "a.csv", "time", 3.0, data)
    with pytest.raises(UnclearError, match="unit of the clock time cannot be told"):
        whole(source, arm, tmp_path)
    trial = whole(source, arm, tmp_path, units={"time": "d"}).log.trials[0]
    np.testing.assert_allclose(trial.time - trial.time[0], data["time"], atol=1e-6)


def test_arrays_of_one_row_less_with_a_clock_of_their_own_stay_apart(data, arm, tmp_path):
    np.savez(
        tmp_path / "a.npz",
        t=data["time"],
        q=data["q"],
        t_tau=data["time"][:-1] + 0.004,
        tau=data["tau"][:-1],
    )
    found = whole(tmp_path / "a.npz", arm, tmp_path).log.trials[0]
    expected = np.interp(found.time, data["time"][:-1] + 0.004, data["tau"][:-1, 0])
    np.testing.assert_allclose(found.tau[:, 0], expected, atol=0.05 * np.ptp(expected))
