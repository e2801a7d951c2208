"""Tables in which each clock stands before its signals."""

from __future__ import annotations

import numpy as np
import pytest

import excite
from excite.conversion.recording import Column, Stream
from excite.conversion.shapes import by_clock
from tests.conversion.test_habits import table
from tests.conversion.written import WHOLE

pytestmark = pytest.mark.usefixtures("unexamined")


def test_channels_of_a_slower_task_keep_their_pace(data, arm, tmp_path):
    """As TwinCAT's Scope exports positions of a task of 10 ms and torques of one of 20 ms, whose columns end sooner."""
    slow = [None] * 300
    columns: dict[str, object] = {}
    for k in range(3):
        columns |= {f"Name~{k + 1}": 1e3 * data["time"], f"Axis{k + 1}.ActPos": data["q"][:, k]}
    for k in range(3):
        columns |= {f"Name~{k + 4}": [*(1e3 * data["time"][::2]), *slow]}
        columns |= {f"Axis{k + 1}.ActTorque": [*data["tau"][::2, k], *slow]}
    found = excite.convert([table(tmp_path / "a.csv", columns, "\t")], arm, tmp_path / "log", WHOLE)
    (trial,) = found.log.trials
    assert np.ptp(trial.time) > 5.9
    np.testing.assert_allclose(trial.tau, data["tau"][::2], atol=1e-6)
    np.testing.assert_allclose(trial.q, data["q"][::2], atol=1e-6)


def _stream(**columns: np.ndarray) -> Stream:
    return Stream("a", tuple(Column(name, np.asarray(values, float)) for name, values in columns.items()))


def test_one_clock_in_two_units_or_from_two_zeros_is_one():
    time, moves = np.arange(100) / 100.0, np.sin(np.arange(100.0))
    for other in (1e3 * time, time + 1.7e9, 1e6 * time + 5.0):
        stream = _stream(time=time, q=moves, time_2=other, tau=moves)
        assert by_clock(stream) == ([stream], "")


def test_two_clocks_side_by_side_are_no_clocks_of_single_signals():
    time, moves = np.arange(100) / 100.0, np.sin(np.arange(100.0))
    stream = _stream(time=time, stamp=2.0 * time, q=moves)
    assert by_clock(stream) == ([stream], "")


def test_a_joint_that_turns_evenly_is_no_clock():
    time, moves = np.arange(100) / 100.0, np.sin(np.arange(100.0))
    stream = _stream(time=time, q1=moves, q2=3.0 * time, tau=moves)
    assert by_clock(stream) == ([stream], "")
