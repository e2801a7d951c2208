"""A delay of the torques in slow motion, where bristles would take it for their own."""

from __future__ import annotations

from pathlib import Path

import pytest

from excite.diagnosis.diagnose import diagnose
from tests.diagnosis.few_trials import few_trials
from tests.diagnosis.servo_arm import arm_log

SLOW = (0.06, 0.11, 0.17, 0.26, 0.37)


@pytest.mark.parametrize(
    ("name", "delay", "tilt"),
    [
        ("ur10", 0.02, 0.052),
        pytest.param("ur10", 0.012, 0.0, marks=pytest.mark.battery),
        pytest.param("iiwa14", 0.012, 0.052, marks=pytest.mark.battery),
    ],
)
def test_a_delay_is_named_and_sized(name: str, delay: float, tilt: float, tmp_path: Path) -> None:
    result = diagnose(few_trials(arm_log(tmp_path / "log", name, delay=delay, tilt=tilt, hertz=SLOW), 1))
    found = {item.effect: item for item in result.effects}
    assert set(found) == ({"time_delay", "base_tilt"} if tilt else {"time_delay"})
    assert found["time_delay"].parameters["delay"].value == pytest.approx(delay, abs=5e-4)
    if tilt:
        assert found["base_tilt"].parameters["angle"].value == pytest.approx(tilt, rel=0.02)


def test_bristles_alone_are_no_delay(tmp_path: Path) -> None:
    result = diagnose(few_trials(arm_log(tmp_path / "log", "ur10", hertz=SLOW, breakaway=2e-3), 1))
    assert "time_delay" not in {item.effect for item in result.effects}
