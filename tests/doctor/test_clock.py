"""A clock is put right on two witnesses, asked for on one, and no friction's shape is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.doctor.doubt import Doubt
from excite.doctor.examine import Chart, examine
from excite.logs.log import Log, Trial
from excite.regressor.kernels import inverse_dynamics
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log, changed

FAST = 1.8


@pytest.fixture(scope="module")
def arm():
    return load_robot("panda")


@pytest.fixture(scope="module")
def log(arm) -> Log:
    return arm_log(arm)


def _fast(trial: Trial) -> Trial:
    return replace(trial, time=trial.time * FAST)


def _clock(chart: Chart):
    (found,) = [item for item in chart.findings if item.kind == "clock"]
    return found


def test_torques_alone_ask(arm, log) -> None:
    ill = changed(log, _fast, rate_hz=log.header.rate_hz / FAST)
    chart = examine(arm, ill)
    found = _clock(chart)
    assert not found.repaired and found.severity == "spoils"
    assert found.figures["tick"] == pytest.approx(1.0 / FAST, rel=0.05)
    assert "scale: {time: 0.5" in found.remedy and "rate_hz" in found.remedy
    np.testing.assert_array_equal(chart.log.trials[0].time, ill.trials[0].time)
    assert Doubt.CLOCK in chart.doubts


def test_the_stated_rate_is_a_second_witness_and_exact(arm, log) -> None:
    chart = examine(arm, changed(log, _fast))
    assert _clock(chart).repaired
    np.testing.assert_allclose(chart.log.trials[0].time, log.trials[0].time, atol=1e-9)
    assert Doubt.CLOCK not in chart.doubts


def test_velocities_that_agree_with_the_stamps_contradict_the_torques(arm, log) -> None:
    def differentiated(trial: Trial) -> Trial:
        late = _fast(trial)
        return replace(late, v=np.gradient(late.q, late.time, axis=0))

    found = _clock(examine(arm, changed(log, differentiated, rate_hz=log.header.rate_hz / FAST)))
    assert not found.repaired
    assert "velocities agree with the stamps" in found.text


@pytest.mark.parametrize(("unit", "size"), [("deg/s", np.pi / 180.0), ("rpm", np.pi / 30.0)])
def test_velocities_in_another_unit_are_no_clock(unit: str, size: float, arm, log) -> None:
    other = changed(log, lambda t: replace(t, v=np.gradient(t.q, t.time, axis=0) / size))
    chart = examine(arm, other)
    assert [item.kind for item in chart.findings] == ["velocity"]
    assert unit in chart.findings[0].text
    np.testing.assert_array_equal(chart.log.trials[0].time, log.trials[0].time)


def test_the_shape_of_dry_friction_says_nothing_of_the_clock(arm, log) -> None:
    """Friction that comes up over 0.3 rad/s and outweighs what bodies make, as in a small arm with large gears."""

    def soft(trial: Trial) -> Trial:
        v = np.gradient(trial.q, trial.time, axis=0)
        a = np.gradient(v, trial.time, axis=0)
        bodies = inverse_dynamics(arm.model, trial.q, v, a)
        return replace(trial, tau=bodies + 5.0 * bodies.std(axis=0) * np.tanh(v / 0.3))

    assert "clock" not in {item.kind for item in examine(arm, changed(log, soft)).findings}


def test_commands_of_weights_are_not_put_right(arm, log) -> None:
    """A gravity compensation has no inertial forces, as if the robot had moved slowly."""

    def commanded(trial: Trial) -> Trial:
        still = np.zeros_like(trial.q)
        return replace(trial, tau=inverse_dynamics(arm.model, trial.q, still, still))

    found = [item for item in examine(arm, changed(log, commanded)).findings if item.kind == "clock"]
    assert all(not item.repaired and "commands" in item.text for item in found)


def test_a_robot_that_is_guided_by_hand_has_no_slow_clock(arm, log) -> None:
    """Its motors hold the weight, and the hand does the rest: no clock that can be is as slow as that looks."""
    rng = np.random.default_rng(4)
    # As fast as a hand moves it.
    quick = 2.0

    def guided(trial: Trial) -> Trial:
        still = np.zeros_like(trial.q)
        weight = inverse_dynamics(arm.model, trial.q, still, still)
        noise = 0.003 * weight.std() * rng.normal(size=weight.shape)
        return replace(trial, time=trial.time / quick, tau=weight + noise)

    found = _clock(examine(arm, changed(log, guided, rate_hz=quick * log.header.rate_hz)))
    assert not found.repaired
    assert "by hand" in found.text and "clock" not in found.text
    assert "scale" not in found.remedy and "controller" in found.remedy


def test_stamps_of_joints_that_rest_are_kept(arm, log) -> None:
    """Positions that do not change say of no clock that it is the truer one, and numpy says nothing of them."""
    rng = np.random.default_rng(5)
    step = 1.0 / log.header.rate_hz

    def resting(trial: Trial) -> Trial:
        late = trial.time + rng.uniform(0.0, 0.3 * step, len(trial.time))
        return replace(trial, time=late, q=np.tile(trial.q[:1], (len(late), 1)))

    ill = changed(log, resting)
    chart = examine(arm, ill)
    assert "jitter" in {item.kind for item in chart.findings}
    np.testing.assert_array_equal(chart.log.trials[0].time, ill.trials[0].time)
