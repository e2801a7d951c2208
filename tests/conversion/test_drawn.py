"""Drawn recordings of arms whose columns nobody explained: columns and units, and the torque that was turned."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from excite.conversion.explicit_mapping import Map
from excite.conversion.guess import guess_columns
from excite.conversion.recording import load_machine, merged_names
from excite.conversion.sources.registry import read_source
from excite.logs.files import load_log
from tests.benchmarks.conversion import judge
from tests.conversion.drawn import Drawn, draw
from tests.conversion.drawn_habits import draw_habits

CASES, LEAST = 20, 19


def understood(case: Drawn) -> bool:
    (recording,) = read_source(case.file)
    found = guess_columns(merged_names(recording), load_machine(case.robot), Map())
    columns = {item.target: item.source for item in found.mapped}
    right = all(
        np.isclose(item.factor, case.factors[item.channel], rtol=1e-6)
        for item in found.mapped
        if item.channel in case.factors
    )
    return columns == case.columns and right and not found.questions


def test_columns_and_units_are_understood(tmp_path):
    assert sum(understood(draw(seed, tmp_path)) for seed in range(CASES)) >= LEAST


def test_habits_of_loggers_are_understood(tmp_path):
    """Dates, decimal commas, lines of units, encodings of Windows, currents in mA, lost rows."""
    assert sum(understood(draw_habits(seed, tmp_path)) for seed in range(CASES)) >= LEAST


@pytest.mark.parametrize("seed", [1, 5])
def test_the_turned_torque_is_found_and_no_other(seed, tmp_path):
    case = draw(seed, tmp_path)
    assert judge(case, tmp_path / "log") == []
    said = yaml.safe_load((tmp_path / "log" / "log.yaml").read_text())["guessed"]
    signs = [row for row in said if row["what"].startswith("torque_sign")]
    assert [case.turned in row["what"] for row in signs] == ([True] if case.turned else [])
    assert load_log(tmp_path / "log").header.guessed
