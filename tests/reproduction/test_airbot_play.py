"""AirBot Play: recordings that were not used, sessions pooled, and a load that weighs the torque scale."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.reproduction import airbot_play_load as pair
from tests.reproduction import airbot_play_sessions as sessions


def test_recordings_not_used_are_predicted(data_dir: Path, tmp_path: Path) -> None:
    """Measured when written: 42.4 6.0 9.9 26.2 9.2 18.7 % of the torques' deviation."""
    percents = sessions.percents(data_dir, tmp_path)
    assert (percents <= sessions.BY_HAND).all(), np.round(percents, 1)


@pytest.mark.slow
def test_intervals_across_sessions_hold_a_motion_that_was_left_out(data_dir: Path, tmp_path: Path) -> None:
    """Measured when written: 94 % with the variance between sessions, 68 % without."""
    held = sessions.motions_left_out(data_dir, tmp_path)
    assert held.n_motions == 4
    assert held.share > 0.9
    assert held.share_without_between < 0.85


@pytest.mark.slow
def test_every_joint_is_fitted_as_by_hand(data_dir: Path, tmp_path: Path) -> None:
    """Measured when written: 22.7 15.4 11.0 8.0 3.9 10.6 % bare, 20.8 11.7 11.1 12.0 8.2 25.0 % loaded."""
    for loaded in (False, True):
        percents = pair.percents(data_dir, tmp_path, loaded)
        assert (percents <= pair.LARGEST_BY_HAND).all(), np.round(percents, 1)


@pytest.mark.battery
def test_the_load_shows_that_torque_scales_differ(data_dir: Path, tmp_path: Path) -> None:
    """Torques as given weigh 0.27 kg of the 0.48 stated; the two large drives are to blame, not the wrist's."""
    found = pair.weighed(data_dir, tmp_path)
    assert found.as_given < 0.8 * pair.STATED_MASS
    # Measured when written: 0.44 and 0.51 kg, the halves of the loaded run with gains from the other half.
    assert all(abs(mass / pair.STATED_MASS - 1.0) < 0.1 for mass in found.halves), found
    shoulder, elbow, roll, pitch = (found.gains[name] for name in pair.JOINTS[1:5])
    assert min(shoulder, elbow) > 1.25
    assert abs(roll - 1.0) < 0.1
    assert abs(pitch - 1.0) < 0.1
