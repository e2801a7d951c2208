"""Curves and masses for the report."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from excite.campaign.result import Campaign
from excite.report.data import load_report_data


def test_forces_are_shown_at_the_rate_of_the_log(small_campaign: tuple[Campaign, Path]) -> None:
    result, folder = small_campaign
    forces = load_report_data(folder / "report_data.npz").forces
    assert np.median(np.diff(forces.time)) < 0.011 and len(forces.time) > 500
    for channel, measured, nominal, identified in zip(
        forces.channels, forces.measured.T, forces.nominal.T, forces.identified.T, strict=True
    ):
        shown = [np.sqrt(np.mean((measured - model) ** 2)) for model in (nominal, identified)]
        assert shown[1] < shown[0], channel
        assert shown[1] < 3.0 * result.identification.validation[channel].rmse
