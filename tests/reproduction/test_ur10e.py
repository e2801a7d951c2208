"""UR10e: motor currents of a run that was not used for identification, predicted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.identification.estimators.method_settings import estimator_settings
from excite.identification.estimators.registry import find_estimator
from excite.identification.problem import build_problem
from excite.logs.robot import nominal_robot
from excite.rows.settings import ProblemSettings
from tests.reproduction.recordings import UR10E_GAINS, ur10e_log

# Motions have harmonics up to 0.6 Hz; both sides of the regression pass the same 5 Hz zero-phase filter.
SETTINGS = ProblemSettings(cutoff_hz=5.0, drive_gains=UR10E_GAINS)
LARGEST_PERCENT = 7.5


@pytest.mark.parametrize("method", ["wls", "map"])
def test_validation_residual_is_below_the_target(method: str, data_dir: Path, tmp_path: Path) -> None:
    """RMS of measured minus predicted over the standard deviation of measured, both filtered alike."""
    log = ur10e_log(data_dir, tmp_path)
    robot = nominal_robot(log)
    problem = build_problem(robot, log, SETTINGS)
    judge = build_problem(robot, log, SETTINGS, role="validation")
    estimate = find_estimator(method).estimate(problem, estimator_settings(method))
    residual = judge.residual(estimate.parameters)
    percent = [
        100.0 * np.sqrt(np.mean(residual[rows] ** 2)) / np.std(judge.y[rows])
        for rows in map(judge.rows_of, judge.channel_names)
    ]
    assert max(percent) <= LARGEST_PERCENT, np.round(percent, 2)
    # The nominal inertias without friction are far off: the test can tell models apart.
    nominal = judge.residual(judge.prior)
    for joint, value in zip(judge.channel_names, percent, strict=True):
        rows = judge.rows_of(joint)
        assert 100.0 * np.sqrt(np.mean(nominal[rows] ** 2)) / np.std(judge.y[rows]) > 1.5 * value
