"""Sensor readings brought to the base, against pinocchio's own transforms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError, UnknownNameError
from excite.regressor.columns import base_wrench
from excite.robot.robot import Robot
from tests.regressor.conftest import sample


def test_ankle_sensors_and_plates(g1: Robot) -> None:
    tilted = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), np.array([0.4, 0.5, 0.1]))
    ankle = replace(g1.sensors[0], placement=tilted * g1.sensors[0].placement)
    plate = replace(g1.sensors[1], name="plate", kind="force_plate", joint=0, placement=tilted)
    robot = replace(g1, sensors=(ankle, plate))
    s = sample(g1.model, 6)
    random = np.random.default_rng(5)
    readings = {"left_foot": random.normal(size=(6, 6)), "plate": random.normal(size=(6, 6))}
    found = base_wrench(robot, s.q, readings)
    data = g1.model.createData()
    for i, q in enumerate(s.q):
        pin.forwardKinematics(g1.model, data, q)
        total = pin.Force.Zero()
        for sensor in (ankle, plate):
            pose = data.oMi[1].actInv(data.oMi[sensor.joint] * sensor.placement)
            total += pose.act(pin.Force(readings[sensor.name][i]))
        np.testing.assert_allclose(found[i], total.vector, atol=1e-12)


def test_a_standing_robots_plates_carry_its_weight(g1: Robot) -> None:
    plate = replace(g1.sensors[0], name="plate", kind="force_plate", joint=0, placement=pin.SE3.Identity())
    weight = np.array([[0.0, 0.0, 9.81 * g1.mass, 0.0, 0.0, 0.0]])
    wrench = base_wrench(replace(g1, sensors=(plate,)), g1.rest[None], {"plate": weight})
    assert wrench[0, 2] == pytest.approx(9.81 * g1.mass)


def test_faults(g1: Robot) -> None:
    q = g1.rest[None]
    with pytest.raises(UnknownNameError, match="hand"):
        base_wrench(g1, q, {"hand": np.zeros((1, 6))})
    with pytest.raises(InputError, match="shape"):
        base_wrench(g1, q, {"left_foot": np.zeros((2, 6))})
    fixed = replace(g1, description=g1.description.model_copy(update={"base": "fixed"}))
    with pytest.raises(InputError, match="fixed base"):
        base_wrench(fixed, q, {})
