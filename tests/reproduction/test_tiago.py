"""TIAGo: currents of the arm's first joints, predicted; the wrist's torques are not known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.reproduction.tiago import BY_HAND, tiago_log
from tests.reproduction.tiago import percents as left


def test_rows_not_used_are_predicted_as_well_as_least_squares_by_hand_fits_its_own(
    data_dir: Path, tmp_path: Path
) -> None:
    """In whole per cent, as those by hand are stated; measured when written: 14.6 16.5 14.6 11.3."""
    percents = left(tiago_log(data_dir, tmp_path))
    assert (np.round(percents) <= BY_HAND).all(), np.round(percents, 2)
