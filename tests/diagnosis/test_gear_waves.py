"""Waves of a strain-wave gear: two a turn of its motor, and as high as the load makes them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.logs.files import save_log
from tests.diagnosis.two_joints import URDF, moved, two_joint_log

PERIODS = 2 * 101.0


@pytest.mark.parametrize("by_load", [False, True])
def test_the_waves_of_a_gear_of_101_are_a_ripple(by_load: bool, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    trials = []
    for name, role, seconds in (
        ("a", "identification", 30.0),
        ("b", "identification", 30.0),
        ("c", "validation", 20.0),
    ):
        trial = moved(name, role, seconds, rng, np.eye(2))
        # They are seen where the joint turns slowly.
        height = 0.08 * np.abs(_weight(trial.q)) if by_load else 0.4
        wave = height * np.cos(PERIODS * trial.q[:, 0] + 0.5)
        assert trial.tau is not None
        trials.append(replace(trial, tau=trial.tau + np.column_stack([wave, np.zeros_like(wave)])))
    save_log(two_joint_log(tuple(trials)), tmp_path / "log")
    found = diagnose(tmp_path / "log")
    assert (found.verdict, found.effect, found.location) == ("effect", "torque_ripple", "first")
    assert found.effects[0].parameters["periods_per_rev"].value == pytest.approx(PERIODS, abs=0.5)


def _weight(q: np.ndarray) -> np.ndarray:
    """Torque of the first joint that holds the arm [N·m]."""
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    return np.array([pin.computeGeneralizedGravity(model, data, row)[0] for row in q])
