"""Positions that single rows lack stand on the curve of those beside them, whose accelerations are the motion's."""

from __future__ import annotations

import numpy as np
import pytest

import excite
from tests.conversion.test_habits import columns_of, table
from tests.conversion.written import JOINTS, WHOLE

pytestmark = pytest.mark.usefixtures("unexamined")


def test_positions_of_missing_rows_are_on_the_curve(data, arm, tmp_path):
    columns = columns_of(data, q="q{n}", tau="tau{n}")
    holes = np.arange(300, 303)
    for k in range(3):
        columns[f"q{k + 1}"] = np.where(np.isin(np.arange(600), holes), np.nan, data["q"][:, k])
    found = excite.convert([table(tmp_path / "run.csv", columns)], arm, tmp_path / "log", WHOLE)
    assert any("stand between their neighbours" in note for note in found.notes)
    (trial,) = found.log.trials
    assert trial.q.shape == (600, len(JOINTS))
    straight = np.abs(data["q"][[299, 303]].mean(axis=0) - data["q"][301]).max()
    assert np.abs(trial.q - data["q"]).max() < 0.05 * straight
