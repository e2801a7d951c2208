"""Stäubli TX40: a coupled wrist, an impossible nominal inertia, and what its authors publish of the drives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.doctor.examine import examine
from excite.identification.identify import identify
from excite.identification.result import Identification
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from tests.reproduction.tx40 import (
    LARGEST_PERCENT,
    RANK,
    SETTINGS,
    ZEROS,
    drive_parameters,
    percent_left,
    tx40_log,
)


@pytest.fixture(scope="module")
def log(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Log:
    """The whole recording, coupled."""
    return tx40_log(data_dir, tmp_path_factory.mktemp("tx40"))


@pytest.fixture(scope="module")
def least_squares(log: Log) -> Identification:
    """Its weighted least squares."""
    return found(log)


def found(log: Log, method: str = "wls") -> Identification:
    """The log identified with the data set's settings."""
    return identify(nominal_robot(log), log, method, problem_settings=SETTINGS)


def test_residuals_and_rank_and_the_impossible_link(log: Log, least_squares: Identification) -> None:
    """Measured when written: 4.4 5.1 7.2 6.6 9.5 8.0 % left, by hand 6 to 13 %."""
    result = least_squares
    assert len(result.base) == RANK
    assert max(percent_left(result.fit)) <= LARGEST_PERCENT
    (finding,) = [item for item in result.findings if item.kind == "nominal_inertia"]
    assert finding.places == ("link_6",)
    # The consistent estimate of the same rows is a body all the same, and hardly worse.
    consistent = found(log, "cls3")
    assert consistent.consistency.pseudo_inertia_min_eigenvalue >= 0.0
    assert max(percent_left(consistent.fit)) <= LARGEST_PERCENT


def test_the_wrist_needs_its_coupling(log: Log, least_squares: Identification) -> None:
    separate = replace(log, header=log.header.model_copy(update={"coupling": {}}))
    coupled, apart = percent_left(least_squares.fit), percent_left(found(separate).fit)
    assert (np.divide(apart, coupled)[4:] > 1.5).all(), (coupled, apart)
    assert (np.divide(apart, coupled)[:4] < 1.1).all(), (coupled, apart)


def test_zeros_of_the_controller_are_named(log: Log) -> None:
    """Two joints whose zeros are a quarter turn from the model's, found by the torques alone."""
    raw = replace(log, trials=tuple(replace(trial, q=trial.q - ZEROS) for trial in log.trials))
    found = examine(nominal_robot(log), raw, SETTINGS).findings
    (finding,) = [item for item in found if item.severity == "spoils"]
    assert finding.kind == "zero_position"
    assert "add -90° to joint_2, +90° to joint_3" in finding.text
    assert examine(nominal_robot(log), log, SETTINGS).healthy


def test_published_drives_lie_in_the_intervals(data_dir: Path, log: Log) -> None:
    """Measured when written: all 19 of 19; a right interval misses two or more of 19 in a quarter of all cases."""
    drives = drive_parameters(data_dir, log)
    outside = [item.what for item in drives if abs(item.value - item.published) > item.half_width]
    assert len(drives) == 19
    assert len(outside) <= 3, outside
    # Viscous friction is known to within a fifth: the intervals are not idly wide.
    assert all(item.half_width < 0.2 * item.value for item in drives if item.what.startswith("fv"))


def test_seconds_left_out_are_predicted(data_dir: Path, tmp_path: Path) -> None:
    """Measured when written: 5.4 6.5 10.2 9.5 12.0 10.7 % left of the last two seconds."""
    result = found(tx40_log(data_dir, tmp_path, 4.0), "cls3")
    assert max(percent_left(result.validation)) <= LARGEST_PERCENT
