"""A delay of a servo's commands, or of all that it asks for, in the place of a lag of its drives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.effects.readings import ActuatorLag
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.servo.servo import Servo, ServoRecord, delay_for_lag, read_signals
from excite.logs.files import load_log, save_log
from excite.logs.robot import nominal_robot
from tests.diagnosis.hypotheses import fitted
from tests.diagnosis.two_joints import moved, two_joint_log

LATE = 0.012


@pytest.mark.parametrize("of_commands", [True, False])
def test_a_delay_in_the_place_of_a_lag_has_its_own_size(tmp_path: Path, of_commands: bool) -> None:
    """By its first order it is less, with all that the gains make of commands that are late."""
    rng = np.random.default_rng(0)
    made_here = two_joint_log(tuple(moved(name, "identification", 12.0, rng, np.eye(2)) for name in "abc"))
    log = load_log(save_log(made_here, tmp_path / "log"))
    robot, servo = nominal_robot(log), Servo(np.full(2, 300.0), np.full(2, 5.0), "none", False)
    made, signals = [], {}
    for trial in log.trials:

        def early(values: np.ndarray, time: np.ndarray = trial.time) -> np.ndarray:
            return np.column_stack([np.interp(time + LATE, time, column) for column in values.T])

        needed = trial.tau if of_commands else early(trial.tau)
        v = read_signals(robot, log, replace(trial, q_cmd=trial.q)).measured.first
        q_cmd = trial.q + (needed + servo.kd * v) / servo.kp
        asked = replace(trial, q_cmd=early(q_cmd) if of_commands else q_cmd)
        signals[trial.name] = read_signals(robot, log, asked)
        made.append(replace(asked, tau=signals[trial.name].servo_torque(servo)))
    samples = arm_samples(robot, log, made)
    modelled = ("rigid_body_fixed", "viscous_friction", "coulomb_friction", "armature")
    baseline = fit_baseline(samples, modelled, spectral_floor(samples))
    lag = fitted(baseline, ActuatorLag(), "torque")
    assert abs(lag.fit.extra[0] - LATE) > 0.05 * LATE

    def told(accepted: SimpleNamespace | None):
        record = ServoRecord(servo, signals, 0.0, {}, log.header.joints)
        return delay_for_lag(SimpleNamespace(accepted=() if accepted is None else (accepted,)), record)

    size = told(SimpleNamespace(name="actuator_lag", hypothesis=lag, count=np.ones((2, 2))))
    assert size is not None and size.std is not None
    assert size.value == pytest.approx(LATE, rel=0.02)
    assert 0.0 < size.std < 0.03 * LATE
    assert told(None) is None
