"""The noise of measured positions is in predicted torques too; a term that only damps it is none."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from excite.arrays import Array
from excite.diagnosis.diagnose import diagnose
from excite.logs.log import Trial
from excite.robot.loading import load_robot
from tests.made_log import FRICTION, made_log

RATE_HZ, SECONDS = 250, 12.0


def turning(rng: np.random.Generator, time: Array, low: Array, high: Array, fastest: Array) -> Array:
    """Sums of sines within a part of the joints' ranges, ``(n, n_joints)``."""
    q = np.empty((len(time), len(low)))
    for j in range(len(low)):
        wave = sum(
            rng.normal() / h * np.sin(2.0 * np.pi * h * 0.08 * time + rng.uniform(0.0, 2.0 * np.pi))
            for h in range(1, 5)
        )
        wave *= 0.3 * (high[j] - low[j]) / np.abs(wave).max()
        wave *= min(1.0, 0.6 * fastest[j] / np.abs(np.gradient(wave, time)).max())
        q[:, j] = 0.5 * (low[j] + high[j]) + wave
    return q


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.battery)])
def test_an_arm_that_moves_as_modelled_has_no_gap_though_its_encoders_are_noisy(seed: int) -> None:
    """Encoders of 20 µrad beside torques of 2 %: the wrist's inertia torque is as much noise as motion."""
    robot = load_robot("jaco2")
    model, rng = robot.model, np.random.default_rng(seed)
    low, high = (np.clip(limit, -2.5, 2.5) for limit in (model.lowerPositionLimit, model.upperPositionLimit))
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    trials: list[Trial] = []
    scale = np.zeros(model.nv)
    for k in range(4):
        q = turning(rng, time, low, high, model.velocityLimit)
        v = np.gradient(q, time, axis=0)
        a = np.gradient(v, time, axis=0)
        data = model.createData()
        tau = np.array([pin.rnea(model, data, *sample) for sample in zip(q, v, a, strict=True)])
        scale = scale if k else np.sqrt((tau**2).mean(axis=0))
        tau += scale * (
            0.1 * np.tanh(v / 0.005) + 0.05 * v + 0.005 * a + 0.02 + 0.02 * rng.normal(size=v.shape)
        )
        role = "identification" if k < 3 else "validation"
        noisy = q + 2e-5 * rng.normal(size=q.shape)
        trials.append(Trial(name=f"trial_{k}", role=role, time=time, q=noisy, tau=tau))
    found = diagnose(
        made_log(
            trials,
            robot.joint_names,
            RATE_HZ,
            modelled=["rigid_body_fixed", *FRICTION, "armature", "torque_bias"],
        ),
        robot,
    )
    assert (found.verdict, [(e.effect, e.location) for e in found.effects]) == ("none", [])
