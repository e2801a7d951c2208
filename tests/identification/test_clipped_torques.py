"""Parameters of arms whose torques are cut off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.identification.identify import identify
from excite.identification.result import Identification
from excite.robot.loading import load_robot
from excite.rows.settings import ProblemSettings
from tests.diagnosis.servo_arm import clipped_log, whole

# The same parameters, whatever the evidence of each log is.
TERMS = ProblemSettings(drive_terms=("viscous", "coulomb", "offset", "armature"))


@pytest.mark.parametrize(
    ("name", "joint", "share"),
    [
        ("ur10", 1, 0.3),
        pytest.param("panda", 3, 0.05, marks=pytest.mark.battery),
        pytest.param("iiwa14", 1, 0.5, marks=pytest.mark.battery),
    ],
)
def test_rows_that_are_cut_off_bend_nothing(name: str, joint: int, share: float, tmp_path: Path) -> None:
    robot = load_robot(name)
    log = clipped_log(tmp_path / "log", name, joint, share)
    true = _values(identify(robot, clipped_log(tmp_path / "whole", name, joint, 0.0), problem_settings=TERMS))
    errors = []
    for tried in (log, whole(log)):
        found = _values(identify(robot, tried, problem_settings=TERMS))
        away = [(value - true[key][0]) / true[key][1] for key, (value, _) in found.items()]
        errors.append(float(np.sqrt(np.mean(np.square(away)))))
    assert errors[0] < 3.0
    assert errors[1] > 3.0 * errors[0]


def _values(found: Identification) -> dict[str, tuple[float, float]]:
    """Base parameters with their standard deviations, by expression."""
    return {item["expression"]: (item["value"], item["std"]) for item in found.to_json()["base_parameters"]}
