"""The diagnosis of arms whose torques are cut off."""

from __future__ import annotations

from pathlib import Path

import pytest

from excite.diagnosis.diagnose import diagnose
from tests.diagnosis.few_trials import few_trials
from tests.diagnosis.servo_arm import MASS, clipped_log

ARMS = {"ur10": 1, "panda": 3, "iiwa14": 1}


@pytest.mark.parametrize(
    ("name", "share"),
    [
        ("ur10", 0.3),
        pytest.param("panda", 0.05, marks=pytest.mark.battery),
        pytest.param("iiwa14", 0.5, marks=pytest.mark.battery),
    ],
)
def test_nothing_is_found_where_a_torque_is_cut_off_by_its_sensor(
    name: str, share: float, tmp_path: Path
) -> None:
    result = diagnose(few_trials(clipped_log(tmp_path / "log", name, ARMS[name], share), 1))
    assert (result.verdict, result.effects) == ("none", ())
    # What stands in the rows that are left out is no part of the gap.
    assert result.gap.before < 1.2 * result.gap.noise_floor
    assert any("clipped" in text and "left out" in text for text in result.warnings)


@pytest.mark.parametrize(
    ("name", "share"),
    [
        ("ur10", 0.5),
        pytest.param("panda", 0.3, marks=pytest.mark.battery),
        pytest.param("iiwa14", 0.05, marks=pytest.mark.battery),
    ],
)
def test_what_is_there_is_found_beside_torques_that_are_cut_off(
    name: str, share: float, tmp_path: Path
) -> None:
    result = diagnose(few_trials(clipped_log(tmp_path / "log", name, ARMS[name], share, payload=True), 1))
    assert [item.effect for item in result.effects] == ["payload"]
    assert result.effects[0].parameters["mass"].value == pytest.approx(MASS, rel=0.01)
    assert result.gap.share_closed > 0.99


def test_a_drive_at_its_limit_is_as_good_as_one_that_is_not(tmp_path: Path) -> None:
    result = diagnose(few_trials(clipped_log(tmp_path / "log", "ur10", 1, 0.0, limit=1.1), 1))
    assert (result.verdict, result.effects) == ("none", ())
    assert "drive_limit" in {finding.kind for finding in result.faults}
    assert not any("clipped" in text for text in result.warnings)
