"""KUKA LWR 4+: prediction of what was left out, and the warning where a trajectory is too poor to predict another."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.reproduction.lwr import (
    HALF,
    LARGEST,
    LARGEST_2,
    OTHER,
    OTHER_TRAJECTORY_2,
    found,
    left,
    lwr_log,
    unexcited,
)


def test_half_a_run_is_predicted(data_dir: Path, tmp_path: Path) -> None:
    """Measured when written: 0.286 0.191 0.241 0.253 0.214 0.195 0.183 N·m."""
    rmse = left(found(lwr_log(data_dir, tmp_path, HALF), "wls"))
    assert (rmse <= LARGEST).all(), np.round(rmse, 3)
    assert rmse[1] <= LARGEST_2


def test_a_poor_trajectory_is_said_to_be_poor_and_rightly(data_dir: Path, tmp_path: Path) -> None:
    """Measured when written: joint 2 of the other trajectory 2.85 N·m without, 0.37 with the nominal model's help."""
    log = lwr_log(data_dir, tmp_path, OTHER)
    data_alone, with_model = found(log, "wls"), found(log, "cls3")
    warning = unexcited(data_alone)
    assert warning.figures["directions"] > 0.3 * len(data_alone.base)
    assert "data say less than the nominal model" in warning.text
    # True: numbers from the data alone predict another motion worse than the nominal model does, …
    nominal = np.array([fit.reference_rmse for fit in data_alone.validation.values()])
    assert left(data_alone).sum() > nominal.sum()
    assert any(item.kind in {"no_better", "validation_gap"} for item in data_alone.findings)
    # … and where the nominal model fills in they predict it well.
    assert left(with_model).sum() < 0.5 * nominal.sum()
    assert left(with_model)[1] <= OTHER_TRAJECTORY_2
