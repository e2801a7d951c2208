"""Friction that a robot's description states as found is part of the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.diagnosis.equations.known_drives import known_terms, subtract_known_torques
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.own_columns import COULOMB, VISCOUS
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.equations.samples import ArmSamples
from excite.robot.description import FrictionBlock
from excite.robot.loading import load_robot
from excite.robot.quantities import DriveFrictions
from tests.identification.practice_log import arm_log, changed

ELBOW = 2


@pytest.fixture(scope="module")
def samples() -> ArmSamples:
    """A UR10 with dry friction of 4 N·m at its elbow, which it knows of."""
    robot = load_robot("ur10")

    def rubbed(trial):
        v = np.gradient(trial.q, trial.time, axis=0)
        return replace(trial, tau=trial.tau + 4.0 * np.tanh(v / 0.01) * np.eye(6)[ELBOW])

    log = changed(arm_log(robot, 3, torque="link_side", true=robot.nominal_parameters), rubbed)
    drives = FrictionBlock(
        coulomb=DriveFrictions(joints={"elbow_joint": 4.0}, source="found"),
        viscous=DriveFrictions(joints={"elbow_joint": 0.5}, source="found"),
        found=True,
    )
    robot = replace(robot, description=robot.description.model_copy(update={"drives": drives}))
    return arm_samples(robot, log, log.trials)


def test_terms_are_known_where_they_were_found_and_are_not_fitted(samples: ArmSamples) -> None:
    terms = known_terms(samples, ("rigid_body_fixed",))
    assert {item.term for item in terms} == {VISCOUS, COULOMB}
    assert terms[1].values.tolist() == [0.0, 0.0, 4.0, 0.0, 0.0, 0.0]
    assert [item.term for item in known_terms(samples, ("viscous_friction",))] == [COULOMB]
    description = samples.robot.description
    guess = description.model_copy(update={"drives": description.drives.model_copy(update={"found": False})})
    guessed = replace(samples, robot=replace(samples.robot, description=guess))
    assert known_terms(guessed, ("rigid_body_fixed",)) == ()


def test_what_is_known_is_taken_off_and_the_reading_stays(samples: ArmSamples) -> None:
    modelled = ("rigid_body_fixed", "viscous_friction")
    less = subtract_known_torques(samples, modelled, spectral_floor(samples))
    for before, after in zip(samples.trials, less.trials, strict=True):
        assert after.measured_torque == pytest.approx(before.tau, abs=1e-9)
        gone = before.tau - after.tau
        assert np.abs(gone[:, [0, 1, 3, 4, 5]]).max() == 0.0
        fast = np.abs(before.v[:, ELBOW]) > 0.1
        assert gone[fast, ELBOW] == pytest.approx(4.0 * np.sign(before.v[fast, ELBOW]), rel=0.01)
    assert (
        subtract_known_torques(samples, (*modelled, "coulomb_friction"), spectral_floor(samples)) is samples
    )


def test_a_motor_that_turns_with_two_joints_rubs_by_its_own_speed(samples: ArmSamples) -> None:
    """Equations are the motors': what one of them does stands in its own."""
    coupling = np.eye(6)
    coupling[ELBOW, ELBOW + 1] = 0.5
    less = subtract_known_torques(
        replace(samples, coupling=coupling), ("rigid_body_fixed", "coulomb_friction"), spectral_floor(samples)
    )
    for before, after in zip(samples.trials, less.trials, strict=True):
        turns, gone = before.v[:, ELBOW] + 0.5 * before.v[:, ELBOW + 1], before.tau - after.tau
        assert gone[:, ELBOW] == pytest.approx(0.5 * turns)
        assert not gone[:, [0, 1, 3, 4, 5]].any()
