"""A load that is there in some trials of a record and not in the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.logs.files import save_log
from excite.logs.log import Trial
from tests.diagnosis.effects.arm_record import COULOMB, URDF, VISCOUS
from tests.made_log import FRICTION, made_log

RATE_HZ, NOISE = 200, 0.05
MASS, PLACE = 0.4, np.array([0.3, 0.0, 0.04])
ROLES = ("identification",) * 4 + ("validation",) * 2


def trial(name: str, role: str, mass: float, dry: float, rng: np.random.Generator) -> Trial:
    """Sines of all joints, a point mass in the gripper, dry friction that is another in every trial."""
    model = pin.buildModelFromXML(URDF)
    model.inertias[3] = model.inertias[3] + pin.Inertia(mass, PLACE, np.zeros((3, 3)))
    data = model.createData()
    time = np.arange(12 * RATE_HZ) / RATE_HZ
    q, v, a = np.zeros((3, len(time), 3))
    for j in range(3):
        for k, turn in enumerate((0.23, 0.61, 1.1)):
            w, size, phase = 2.0 * np.pi * turn * (1.0 + 0.17 * j), 0.5 / (k + 1), rng.uniform(0.0, 6.28)
            q[:, j] += size * np.sin(w * time + phase)
            v[:, j] += size * w * np.cos(w * time + phase)
            a[:, j] -= size * w**2 * np.sin(w * time + phase)
    tau = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
    tau += VISCOUS * v + dry * COULOMB * np.sign(v) + NOISE * rng.normal(size=q.shape)
    return Trial(name=name, role=role, time=time, q=q, tau=tau)


def diagnosed(
    folder: Path, masses: tuple[float, ...], body: str, dry: tuple[float, ...] = (1.0,) * 6
) -> Diagnosis:
    rng = np.random.default_rng(7)
    trials = tuple(
        trial(f"run_{k}", role, *sizes, rng)
        for k, (role, *sizes) in enumerate(zip(ROLES, masses, dry, strict=True))
    )
    return diagnose(
        save_log(
            made_log(trials, ["yaw", "shoulder", "elbow"], RATE_HZ, URDF, modelled=[body, *FRICTION]), folder
        )
    )


@pytest.mark.parametrize("body", ["rigid_body", pytest.param("rigid_body_fixed", marks=pytest.mark.battery)])
def test_a_load_in_some_trials_is_weighed_and_these_are_named(tmp_path: Path, body: str) -> None:
    result = diagnosed(tmp_path, (0.0, MASS, 0.0, MASS, MASS, 0.0), body)
    assert (result.verdict, result.effect, result.location) == ("effect", "payload", "lower")
    parameters = result.effects[0].parameters
    assert parameters["mass"].value == pytest.approx(MASS, rel=0.05)
    assert parameters["mx"].value == pytest.approx(MASS * PLACE[0], rel=0.05)
    (said,) = [item for item in result.faults if item.kind == "some_trials"]
    assert said.trials == ("run_1", "run_3", "run_4")
    assert result.gap.share_closed > 0.95


def test_friction_that_differs_from_trial_to_trial_is_no_load(tmp_path: Path) -> None:
    result = diagnosed(tmp_path, (0.0,) * 6, "rigid_body", dry=(1.0, 1.3, 0.9, 1.2, 1.0, 1.3))
    assert not any(item.effect == "payload" for item in result.effects)
    assert not any(item.kind == "some_trials" for item in result.faults)


def test_a_load_in_all_trials_is_none_of_some(tmp_path: Path) -> None:
    result = diagnosed(tmp_path, (MASS,) * 6, "rigid_body_fixed")
    assert (result.verdict, result.effect, result.location) == ("effect", "payload", "lower")
    assert not any(item.kind == "some_trials" for item in result.faults)
