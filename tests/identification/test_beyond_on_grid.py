"""Rows that hold a torque beyond its range, of motors that turn joints together."""

from __future__ import annotations

import numpy as np

from excite.logs.log import Trial
from excite.rows.saturation import beyond_on_grid


def test_a_sum_and_a_difference_of_torques_that_are_both_beyond_their_ranges_are_no_torques() -> None:
    time = np.arange(4.0)
    beyond = np.array([[False, False], [True, False], [False, True], [True, True]])
    trial = Trial(
        name="t", role="identification", time=time, q=np.zeros((4, 2)), tau=np.zeros((4, 2)), beyond=beyond
    )
    mixing = np.array([[1.0, 1.0], [1.0, -1.0]])
    expected = beyond.any(axis=1)[:, None].repeat(2, axis=1)
    np.testing.assert_array_equal(beyond_on_grid(trial, [0, 1], time, mixing), expected)
