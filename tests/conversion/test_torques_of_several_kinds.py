"""Torques that a controller logs in several ways: measured, smoothed, by the currents."""

from __future__ import annotations

import pytest

import excite
from excite.conversion.guesses import UnclearError
from tests.conversion.test_habits import columns_of, table

pytestmark = pytest.mark.usefixtures("unexamined")


def test_external_torques_alone_are_said_to_be_left_out(data, arm, tmp_path):
    """What a robot's observer makes of torques is none that was measured; that nothing was recorded is not so."""
    columns = columns_of(data, q="q_msr_{n}", tau="tau_ext_{n}")
    found = excite.convert([table(tmp_path / "run.csv", columns)], arm, tmp_path / "log")
    (because,) = (why for what, _, why in found.guesses if what == "torque")
    assert "tau_ext_1, tau_ext_2, tau_ext_3 are no measured torques" in because
    assert found.log.header.torque == "none"


def test_which_of_three_torques_is_asked_once(data, arm, tmp_path):
    """As a Kinova's controller writes them; each pair was a question with the same answer."""
    columns = columns_of(data, q="Position{n}", tau="Torque{n}")
    for k in range(3):
        columns[f"TorqueSm{k + 1}"] = data["tau"][:, k] + 0.1 * data["v"][:, k]
        columns[f"TorqueCur{k + 1}"] = 1.1 * data["tau"][:, k] + 0.2
    with pytest.raises(UnclearError) as asked:
        excite.convert([table(tmp_path / "run.csv", columns)], arm, tmp_path / "log")
    (question,) = asked.value.questions
    assert question.what == "tau may be Torque1 … or TorqueSm1 … or TorqueCur1 …"
