"""A record that was computed: nothing but the digits of the file is left, and that is no gap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.logs.files import load_log, save_log
from excite.logs.log import Trial
from tests.diagnosis.two_joints import URDF, two_joint_log

RATE_HZ, SECONDS = 50, 30


def computed(name: str, role: str, phase: float, decimals: int) -> Trial:
    """Inverse dynamics of a motion, no noise and no friction, so many decimals."""
    t = np.arange(RATE_HZ * SECONDS) / RATE_HZ
    sizes, turns = np.array([0.5, 0.2, 0.1]), 2.0 * np.pi * np.array([0.11, 0.27, 0.45])
    angles = turns[:, None] * t + phase * np.arange(3)[:, None]
    shift = angles + 0.7
    q = np.column_stack([sizes @ np.sin(angles), sizes @ np.sin(1.1 * shift)])
    v = np.column_stack([(sizes * turns) @ np.cos(angles), (1.1 * sizes * turns) @ np.cos(1.1 * shift)])
    a = -np.column_stack(
        [(sizes * turns**2) @ np.sin(angles), (1.21 * sizes * turns**2) @ np.sin(1.1 * shift)]
    )
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    tau = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    return Trial(name=name, role=role, time=t, q=np.round(q, decimals), tau=np.round(tau, decimals))


def diagnosed(folder: Path, decimals: int) -> Diagnosis:
    """The diagnosis of two computed trials."""
    trials = (
        computed("a", "identification", 0.4, decimals),
        computed("b", "validation", 1.3, decimals),
    )
    return diagnose(load_log(save_log(two_joint_log(trials, rate_hz=RATE_HZ), folder)))


def test_what_digits_leave_of_exact_torques_is_no_gap(tmp_path: Path) -> None:
    """What rounded positions make of accelerations is noise, and the floor knows it."""
    found = diagnosed(tmp_path / "log", 6)
    assert found.gap.before < 1e-3
    assert found.gap.before == pytest.approx(found.gap.noise_floor, rel=0.3)
    assert found.verdict == "none"


def test_what_filters_leave_of_exact_torques_is_no_gap(tmp_path: Path) -> None:
    found = diagnosed(tmp_path / "log", 12)
    # Far above its floor, and nothing beside the torques.
    assert found.gap.before > 3.0 * found.gap.noise_floor and found.gap.before < 1e-3
    assert found.verdict == "none"
