"""Effects as a servo's log shows them, in records whose effect is put in here."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.attribution import Scorer
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.readings import ActuatorLag
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.servo.diagnose import servo_effects
from excite.diagnosis.servo.servo import Servo, ServoRecord, delay_for_lag, read_signals
from excite.logs.files import load_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from tests.diagnosis.hypotheses import fitted


@pytest.fixture(scope="module")
def clean(gap_dir: Path) -> Log:
    """An arm with given inertial parameters, its torques those of its nominal model and friction but for noise."""
    return load_log(gap_dir / "arm" / "case_012")


def baseline_of(log: Log, trials: list[Trial]) -> Baseline:
    samples = arm_samples(nominal_robot(log), log, trials)
    return fit_baseline(samples, log.header.modelled, spectral_floor(samples))


@pytest.mark.parametrize("feedforward", ["none", "gravity"])
def test_an_offset_of_the_log_alone_is_told_from_a_constant_torque(clean: Log, feedforward: str):
    """Commands for the true positions; the log's are off."""
    robot, offset, joint = nominal_robot(clean), 0.03, 3
    servo = Servo(np.full(7, 300.0), np.full(7, 20.0), feedforward, True)
    off = offset * np.eye(7)[joint]
    made = []
    for trial in clean.trials[:3]:
        signals = read_signals(robot, clean, replace(trial, q_cmd=trial.q))
        needed = trial.tau - signals.feedforward_torque(feedforward)
        asked = replace(trial, q=trial.q + off, q_cmd=trial.q + (needed / servo.kp))
        rebuilt = read_signals(robot, clean, asked)
        made.append(
            replace(asked, tau=servo.kp * (asked.q_cmd - asked.q) + rebuilt.feedforward_torque(feedforward))
        )
    baseline = baseline_of(clean, made)
    library = {e.name: e for e in servo_effects(servo, clean.header.joints)}
    place = clean.header.joints[joint]
    followed, constant = library["encoder_offset"], fitted(baseline, library["torque_bias"], place)
    # The secant of one fit is that of the next.
    found = fitted(baseline, *followed.variant_forms, place, (1.0,))
    found = fitted(baseline, *followed.variant_forms, place, (float(np.exp(found.fit.extra[0])),))
    assert found.fit.extra[0] == pytest.approx(offset, rel=0.01)
    assert "in_log_only" in found.effect.to_estimates(Context(baseline), place, found.theta, found.fit)
    for other in (constant, fitted(baseline, followed, place, (1.0,))):
        assert np.log(found.fit.sigma).sum() < np.log(other.fit.sigma).sum() - 0.5


@pytest.mark.parametrize("lags", [True, False])
def test_a_lag_is_told_from_a_delay(clean: Log, lags: bool):
    """The servo asked for what acts 25 ms later, or for what a filter of 25 ms makes of it."""
    late, made = 0.025, []
    for trial in clean.trials[:4]:
        rate = np.gradient(trial.tau, trial.time, axis=0)
        early = np.column_stack([np.interp(trial.time + late, trial.time, c) for c in trial.tau.T])
        made.append(replace(trial, tau=trial.tau + late * rate if lags else early))
    baseline = baseline_of(clean, made)
    lag = fitted(baseline, ActuatorLag(), "torque")
    scored = Scorer(baseline, spectral_floor(baseline.samples), 0.0, np.ones(7)).score_fit(baseline.fit, lag)
    robot, servo = nominal_robot(clean), Servo(np.full(7, 1e3), np.zeros(7), "none", True)
    signals = {t.name: read_signals(robot, clean, replace(t, q_cmd=t.q + t.tau / servo.kp)) for t in made}
    record = ServoRecord(servo, signals, 0.0, {}, clean.header.joints)
    delay = delay_for_lag(SimpleNamespace(accepted=[scored]), record)
    assert (delay is None) is lags
    assert lags or delay.value == pytest.approx(late, rel=0.05)
