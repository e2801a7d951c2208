"""What is modelled takes power and has mass: a rotor of negative inertia hides no spring; errors of what is fitted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from tests.diagnosis.two_joints import moved, two_joint_log

STIFFNESS = 1.5
MODELLED = ["rigid_body_fixed", "viscous_friction", "coulomb_friction", "armature"]


def _one_tone(folder: Path, stiffness: float) -> Log:
    """Of three trials in which each joint swings at one frequency, the second one on a spring."""
    rng, trials = np.random.default_rng(2), []
    for name, role in (("a", "identification"), ("b", "identification"), ("c", "validation")):
        made = moved(name, role, 15.0, rng, np.eye(2), tones=(0.4,))
        assert made.tau is not None
        tau = made.tau + stiffness * made.q * [0.0, 1.0]
        trials.append(Trial(name=name, role=role, time=made.time, q=made.q, tau=tau))
    return load_log(save_log(two_joint_log(tuple(trials), modelled=MODELLED), folder))


def test_a_spring_is_no_rotor_of_negative_inertia(tmp_path: Path) -> None:
    found = diagnose(_one_tone(tmp_path / "log", STIFFNESS)).to_json()
    (effect,) = found["effects"]
    assert (effect["effect"], effect["location"]) == ("joint_spring", "second")
    stiffness = effect["parameters"]["stiffness"]
    assert abs(stiffness["value"] - STIFFNESS) < 3.0 * stiffness["std"] < 0.5 * STIFFNESS
    sizes = {item["parameter"]: item["value"] for item in found["baseline"] if item["joint"] == "second"}
    assert sizes["armature"] == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(("stiffness", "kept"), [(-2.0, True), (0.0, True), (0.02, True), (2.0, False)])
def test_a_rotor_is_left_out_that_would_make_all_inertia_negative(
    tmp_path: Path, stiffness: float, kept: bool
) -> None:
    log = _one_tone(tmp_path / "log", stiffness)
    samples = arm_samples(nominal_robot(log), log, log.trials)
    fitted = fit_baseline(samples, log.header.modelled, spectral_floor(samples))
    free = fitted.with_signs(fitted.signs, [False] * 2)
    rotor = free.with_fit(free.solver.fit_columns()).fit.own_coefs[1][2]
    assert fitted.rotorless[1] is not kept
    assert fitted.fit.own_coefs[1][2] == pytest.approx(rotor if kept else 0.0)
    # The second link's inertia about its joint.
    assert samples.motor_inertias[1] == pytest.approx(0.01 + 0.1**2, rel=1e-6)
    assert bool(rotor + samples.motor_inertias[1] >= 0.0) is kept
