"""Noise of measured positions names nothing: a slow lift keeps its weight, and what is there is found all the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.equations.arm_trial import Bands
from excite.diagnosis.equations.noise_floor import bands_by_noise, noise_density
from excite.logs.log import Log, Trial
from tests.made_log import made_log

RATE, SECONDS = 200.0, 12.0
URDF = """<robot name="lift">
  <link name="base"/>
  <link name="carriage"><inertial><origin xyz="0.1 0 0.2"/><mass value="12"/>
    <inertia ixx="0.3" iyy="0.3" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0.3 0 0"/><mass value="3"/>
    <inertia ixx="0.01" iyy="0.08" izz="0.08" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="lift" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.4" effort="500" velocity="0.1"/></joint>
  <joint name="elbow" type="revolute"><parent link="carriage"/><child link="arm"/><origin xyz="0.2 0 0.3"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="60" velocity="2"/></joint>
</robot>
"""


def _log(noise: float, rng: np.random.Generator, *, constant: float = 0.0, lift: float = 1.0) -> Log:
    """Torques by MuJoCo of a lift that moves ``lift`` times 0.05 m and an elbow, with noise of positions [m, rad]."""
    model = mujoco.MjModel.from_xml_string(URDF)
    data = mujoco.MjData(model)
    time = np.arange(round(RATE * SECONDS)) / RATE
    window = np.sin(0.5 * np.pi * np.clip(np.minimum(time, time[-1] - time), 0.0, 1.0)) ** 2
    trials = []
    for k in range(5):
        q = np.zeros((len(time), 2))
        for turn in (0.11, 0.19, 0.31):
            phase = rng.uniform(0.0, 2.0 * np.pi, 2)
            q += (
                np.array([0.05 * lift, 0.5])
                / 3
                * np.sin(2.0 * np.pi * turn * (1 + 0.1 * k) * time[:, None] + phase)
            )
        q = q * window[:, None] + np.array([0.2, 0.0])
        v = np.gradient(q, time, axis=0)
        a = np.gradient(v, time, axis=0)
        tau = np.empty_like(q)
        for i in range(len(time)):
            data.qpos[:], data.qvel[:], data.qacc[:] = q[i], v[i], a[i]
            mujoco.mj_inverse(model, data)
            tau[i] = data.qfrc_inverse
        tau += np.array([8.0, 1.0]) * np.tanh(v / np.array([2e-3, 2e-2])) + np.array([60.0, 0.3]) * v
        tau[:, 0] += constant
        tau += np.array([0.4, 0.05]) * rng.standard_normal(q.shape)
        measured = q + noise * rng.standard_normal(q.shape)
        role = "identification" if k < 3 else "validation"
        trials.append(Trial(name=f"trial_{k}", role=role, time=time, q=measured, tau=tau))
    return made_log(trials, ["lift", "elbow"], RATE, URDF)


def test_bands_are_lower_where_noise_would_bend_what_is_fitted() -> None:
    quiet, noisy = _log(1e-7, np.random.default_rng(0)), _log(1e-4, np.random.default_rng(0))
    assert bands_by_noise(quiet, quiet.trials) == Bands()
    low = bands_by_noise(noisy, noisy.trials)
    assert low.rows_hz < 6.0
    assert low.kinematics_hz == pytest.approx(3.0 * low.rows_hz)
    # The share that noise has of the lift's acceleration then says less than any name costs.
    time = noisy.trials[0].time
    power = (2.0 * np.pi) ** 4 * 1e-8 / (0.5 * RATE) * low.rows_hz**5 / 5.0
    a = np.gradient(np.gradient(quiet.trials[0].q[:, 0], time), time)[300:-300]
    assert 0.5 * 36.0 * 2.0 * low.rows_hz * power / a.var() < 5.0
    found = noise_density([t.q for t in noisy.trials], RATE, low.kinematics_hz)
    np.testing.assert_allclose(found, 1e-8 / (0.5 * RATE), rtol=0.2)


def test_a_joint_that_stands_has_no_say_in_the_bands() -> None:
    log = _log(2e-6, np.random.default_rng(0), lift=0.0)
    assert bands_by_noise(log, log.trials) == Bands()


def test_steps_of_an_encoder_count_as_noise_long_before_they_bend_a_single_column() -> None:
    """Arms with 14 bits a turn had false soft gears: beside whole bodies a tenth of what bends one column is enough."""
    log = _log(0.0, np.random.default_rng(0), lift=0.0)
    seen = {}
    for bits in (15, 17):
        step = 2.0 * np.pi / 2**bits
        trials = tuple(replace(t, q=step * np.round(t.q / step)) for t in log.trials)
        seen[bits] = bands_by_noise(log, trials).rows_hz
    assert seen[15] < Bands().rows_hz == seen[17]


@pytest.mark.parametrize("constant", [0.0, 25.0])
def test_noise_of_a_slow_lift_is_no_constant_torque_and_hides_none(constant: float, tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(URDF)
    log = _log(1e-4, np.random.default_rng(1), constant=constant)
    result = diagnose(replace(log, folder=tmp_path))
    named = [(e.effect, e.location) for e in result.effects]
    if not constant:
        assert (result.verdict, named) == ("none", [])
        return
    # One axis has its weight, a constant and its friction's asymmetry for one and the same.
    assert named[0][1] == "lift"
    assert named[0][0] in {"torque_bias", "coulomb_asymmetry"}
