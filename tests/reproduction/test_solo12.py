"""Solo12 without any force sensor: rows left out are predicted better than by its URDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.conftest import lacking
from tests.reproduction.solo12 import FILES, fits_left_out


def test_rows_left_out_are_predicted_better_than_by_the_urdf(data_dir: Path, tmp_path: Path) -> None:
    if not (data_dir / FILES).is_dir():
        lacking(f"no records of Solo12: {data_dir / FILES} is not there")
    fits = fits_left_out(data_dir, tmp_path)
    assert len(fits) == 12
    assert {name for name, fit in fits.items() if fit.rmse >= fit.reference_rmse} == set()
    assert np.median([fit.rmse / fit.reference_rmse for fit in fits.values()]) < 0.5
