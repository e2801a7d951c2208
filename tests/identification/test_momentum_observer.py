"""The momentum observer against its own differential equation and pinocchio."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError, LogError
from excite.identification.momentum_observer import momentum_and_rate, momentum_residual, observe_momentum
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import Log, LogHeader, Trial
from excite.robot.loading import load_robot
from excite.robot.robot import Robot

GAIN = 20.0
RATE = 1000.0


@pytest.fixture(scope="module")
def panda() -> Robot:
    return load_robot("panda")


@pytest.fixture(scope="module")
def motion(panda):
    """Time, q, v and the torque of the model over three seconds."""
    time = np.arange(0.0, 3.0, 1.0 / RATE)
    middle = 0.5 * (panda.limits.position_lower + panda.limits.position_upper)
    omega, phase = 2.0 + 0.4 * np.arange(7), np.linspace(0.0, 2.0, 7)
    angle = omega * time[:, None] + phase
    q, v, a = middle + 0.3 * np.sin(angle), 0.3 * omega * np.cos(angle), -0.3 * omega**2 * np.sin(angle)
    data = panda.model.createData()
    torque = np.array([pin.rnea(panda.model, data, *row) for row in zip(q, v, a, strict=True)])
    return time, q, v, torque


def test_terms_are_those_of_pinocchio(panda, motion):
    """p = M v and Cᵀv − g with pinocchio's mass, Coriolis and gravity terms."""
    _, q, v, _ = (part[::300] for part in motion)
    found = momentum_and_rate(panda, q, v, panda.nominal_parameters)
    model, data = panda.model, panda.model.createData()
    for k in range(len(q)):
        mass = pin.crba(model, data, q[k])
        mass = np.triu(mass) + np.triu(mass, 1).T
        np.testing.assert_allclose(found.momentum[k], mass @ v[k], atol=1e-10)
        coriolis = pin.computeCoriolisMatrix(model, data, q[k], v[k])
        rate = coriolis.T @ v[k] - pin.computeGeneralizedGravity(model, data, q[k])
        np.testing.assert_allclose(found.rate[k], rate, atol=1e-8)


def test_no_contact_no_residual(panda, motion):
    time, q, v, torque = motion
    found = observe_momentum(panda, time, q, v, torque, panda.nominal_parameters, gain=GAIN)
    assert max(found.largest().values()) < 1e-4


def test_contact_shows_through_a_first_order_lag(panda, motion):
    """r' = K (τ_ext − r): a push of 3 N·m on joint 4 from t = 1 s on rises as 1 − exp(−K (t − 1))."""
    time, q, v, torque = motion
    pushed = torque.copy()
    pushed[time >= 1.0, 3] -= 3.0
    found = observe_momentum(panda, time, q, v, pushed, panda.nominal_parameters, gain=GAIN).residual
    expected = np.where(time >= 1.0, 3.0 * (1.0 - np.exp(-GAIN * (time - 1.0))), 0.0)
    assert np.abs(found[:, 3] - expected).max() < 3.0 * GAIN / RATE
    assert np.abs(np.delete(found, 3, axis=1)).max() < 1e-4


def test_uneven_time_stamps(panda, motion):
    time, q, v, torque = motion
    kept = np.sort(np.random.default_rng(0).choice(len(time), len(time) // 2, replace=False))
    found = observe_momentum(
        panda, time[kept], q[kept], v[kept], torque[kept], panda.nominal_parameters, gain=GAIN
    )
    assert max(found.largest().values()) < 5e-3


def test_wrong_mass_shows(panda, motion):
    time, q, v, torque = motion
    wrong = panda.nominal_parameters.copy()
    wrong[-10:] *= 1.5
    found = observe_momentum(panda, time, q, v, torque, wrong, gain=GAIN)
    assert max(found.largest().values()) > 0.1


def test_parameters_of_no_body_are_no_obstacle(panda, motion):
    """Minimum-norm least squares may leave masses of zero."""
    time, q, v, torque = (part[:50] for part in motion)
    found = observe_momentum(panda, time, q, v, torque, 0.0 * panda.nominal_parameters, gain=GAIN)
    assert np.isfinite(found.residual).all()


@pytest.fixture(scope="module")
def log(panda, motion):
    time, q, v, torque = motion
    friction = 0.5 * v + 0.3 * np.tanh(v / 0.01)
    trial = Trial("free", "validation", time, q, tau=torque + friction)
    header = LogHeader(
        schema="excite.log/1",
        robot="panda.urdf",
        base="fixed",
        rate_hz=RATE,
        joints=panda.joint_names,
        torque="motor_side",
        trials=(TrialHeader(file="free.parquet", role="validation"),),
    )
    return Log(header, (trial,))


class TestOverALog:
    def test_friction_is_taken_off(self, panda, log):
        drives = {f"viscous.{joint}": 0.5 for joint in panda.joint_names}
        drives |= {f"coulomb.{joint}": 0.3 for joint in panda.joint_names}
        phi = panda.nominal_parameters
        with_friction = momentum_residual(panda, log, log.trials[0], phi, drives=drives).largest()
        without = momentum_residual(panda, log, log.trials[0], phi).largest()
        for joint in panda.joint_names:
            assert with_friction[joint] < 0.12 < without[joint]

    def test_unknown_drive_parameter(self, panda, log):
        with pytest.raises(InputError, match="elbow"):
            momentum_residual(
                panda, log, log.trials[0], panda.nominal_parameters, drives={"viscous.elbow": 1.0}
            )

    def test_no_torques(self, panda, log):
        with pytest.raises(LogError, match="no torques"):
            momentum_residual(panda, log, replace(log.trials[0], tau=None), panda.nominal_parameters)

    def test_floating_base(self, panda, log):
        header = log.header.model_copy(update={"base": "floating"})
        with pytest.raises(LogError, match="floating"):
            momentum_residual(panda, replace(log, header=header), log.trials[0], panda.nominal_parameters)


@pytest.mark.parametrize("gain", [0.0, -1.0, float("nan")])
def test_bad_gain(panda, motion, gain):
    with pytest.raises(InputError, match="gain"):
        observe_momentum(panda, *(part[:5] for part in motion), panda.nominal_parameters, gain=gain)


def test_bad_samples(panda, motion):
    time, q, v, torque = (part[:5] for part in motion)
    with pytest.raises(InputError, match="does not increase"):
        observe_momentum(panda, time[::-1], q, v, torque, panda.nominal_parameters, gain=GAIN)
    with pytest.raises(InputError, match="shapes"):
        observe_momentum(panda, time, q, v[:3], torque, panda.nominal_parameters, gain=GAIN)
