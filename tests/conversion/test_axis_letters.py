"""Axes that letters name, some of which are quantities elsewhere, and encoders' counts of a size that nobody states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import excite
from excite.conversion.columns.words import read_clue
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import UnclearError
from tests.conversion import written
from tests.conversion.written import JOINTS

pytestmark = pytest.mark.usefixtures("unexamined")

# Pulses a radian, by joint; T and U are a time and a voltage where no axis is called so.
PULSES = {"U": 76_800.0, "T": 57_300.0, "B": 35_600.0}


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written.arm_urdf(tmp_path_factory.mktemp("arm") / "arm.urdf")


@pytest.fixture(scope="module")
def data() -> dict[str, np.ndarray]:
    return written.motion(300)


@pytest.fixture(scope="module")
def source(data, tmp_path_factory) -> Path:
    names = [
        "Time(ms)",
        *(f"{axis}-axis Feedback Pulse" for axis in PULSES),
        *(f"{axis}-axis Torque [Nm]" for axis in PULSES),
    ]
    rows = np.column_stack(
        [1e3 * data["time"], np.round(data["q"] * np.array([*PULSES.values()])), data["tau"]]
    )
    file = tmp_path_factory.mktemp("log") / "a.csv"
    np.savetxt(file, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return file


def test_counts_are_asked_about_as_such(source, arm, tmp_path):
    with pytest.raises(UnclearError, match=r"whole numbers: an encoder's counts.*\{q.shoulder: FACTOR, …\}"):
        excite.convert([source], arm, tmp_path / "log")


def test_factors_by_joint_settle_them(source, data, arm, tmp_path):
    scale = {f"q.{joint}": 1.0 / pulses for joint, pulses in zip(JOINTS, PULSES.values(), strict=True)}
    rules = {"trials": {"validation": ["none"], "split": "none"}, "scale": scale}
    (trial,) = excite.convert([source], arm, tmp_path / "log", Map.model_validate(rules)).log.trials
    np.testing.assert_allclose(trial.q, data["q"], atol=1.0 / min(PULSES.values()))
    np.testing.assert_allclose(trial.tau, data["tau"], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("T-axis torque", "tau"),
        ("U-axis position", "q"),
        ("q-axis current", "i"),
        ("d axis voltage", "volt"),
        ("axis 1 t", "tau"),
    ],
)
def test_letters_of_axes_and_of_a_motors_field(name, quantity):
    assert read_clue(name, JOINTS).quantity == quantity
