"""Currents whose torque constants nobody stated, of an arm whose bodies are given and that carries a load."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.servo.gains import torque_constants
from excite.diagnosis.servo.servo import read_signals
from excite.logs.log import Log, Trial
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.made_log import FRICTION, made_log

RATE_HZ = 100
CONSTANTS = np.array([9.0, 11.0, 8.0, 2.5, 3.0, 2.0])
LINK, MASS = "wrist_3_link", 2.0


@cache
def arm() -> Robot:
    return load_robot("ur10")


def log_of(load: float, tilt: float = 0.0, modelled: str = "rigid_body_fixed") -> Log:
    """Sines at every joint, dry and viscous friction, a little noise."""
    robot, rng = arm(), np.random.default_rng(4)
    model = robot.model.copy()
    # Aside of the last axis: on it the load would be one more turn of the wrist.
    model.appendBodyToJoint(
        6, pin.Inertia(load, np.array([0.05, 0.03, 0.08]), 0.002 * load * np.eye(3)), pin.SE3.Identity()
    )
    model.gravity.linear = 9.81 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    data, time = model.createData(), np.arange(10 * RATE_HZ) / RATE_HZ
    trials = []
    for role in ("identification", "identification", "validation"):
        w = 2.0 * np.pi * rng.uniform(0.1, 0.5, (3, 6))
        p, size = rng.uniform(0.0, 6.28, (3, 6)), rng.uniform(0.2, 0.5, (3, 6))
        angle = w * time[:, None, None] + p
        q = (size * np.sin(angle)).sum(axis=1) + np.array([0.0, -1.2, 1.0, 0.3, 0.4, 0.0])
        v, a = (size * w * np.cos(angle)).sum(axis=1), -(size * w**2 * np.sin(angle)).sum(axis=1)
        tau = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
        tau += np.array([8.0, 8.0, 5.0, 1.0, 1.0, 0.5]) * (np.tanh(v / 0.004) + 0.5 * v)
        tau += 0.02 * rng.standard_normal(tau.shape)
        name = f"run_{len(trials)}"
        trials.append(Trial(name=name, role=role, time=time, q=q, current=tau / CONSTANTS))
    return made_log(
        trials,
        list(robot.model.names)[1:],
        RATE_HZ,
        robot.urdf,
        torque="current",
        modelled=[modelled, *FRICTION],
    )


def constants_of(log: Log) -> np.ndarray:
    inside = log.role("identification")
    signals = {
        t.name: read_signals(arm(), log, Trial(t.name, t.role, t.time, t.q, q_cmd=t.q)) for t in inside
    }
    currents = {t.name: t.current for t in inside}
    return torque_constants(arm(), log, signals, currents, np.full(6, np.nan))


@pytest.mark.parametrize(("load", "tilt"), [(0.0, 0.0), (MASS, 0.0), (0.7, 0.0), (0.0, 0.06)])
def test_constants_are_told_beside_what_the_model_lacks(load: float, tilt: float) -> None:
    """Given bodies fix the scale. The last wrist carries next to nothing: its friction says little of its constant."""
    np.testing.assert_allclose((constants_of(log_of(load, tilt)) / CONSTANTS)[:5], 1.0, atol=0.02)


def test_a_load_that_motor_currents_carry_is_its_own_name_alone() -> None:
    result = diagnose(log_of(MASS), arm())
    assert (result.verdict, [e.effect for e in result.effects]) == ("effect", ["payload"])
    assert result.effects[0].location == LINK
    assert result.effects[0].parameters["mass"].value == pytest.approx(MASS, rel=0.01)
    told = {item.parameter for item in result.absorbed}
    assert "torque_constant" in told
    assert "torque_scale" not in told
