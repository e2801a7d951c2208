"""Bodies on a machine that is larger than an arm: an excavator of three joints, its friction and noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.effects.bodies import largest_reach
from excite.logs.log import Trial
from excite.robot.loading import load_robot
from tests.diagnosis.swung import ROLES, diagnosed_trials, swinging

RATE_HZ = 200
JOINTS = ("swing", "lift", "crowd")
VISCOUS, COULOMB, NOISE = (
    np.array([150.0, 120.0, 60.0]),
    np.array([80.0, 60.0, 25.0]),
    np.array([5.0, 4.0, 2.0]),
)
SIZES, REST = np.array([0.3, 0.25, 0.4]), np.array([0.0, 0.5, -0.9])
URDF = """<robot name="excavator">
  <link name="base"/>
  <link name="house"><inertial><origin xyz="-0.2 0 0.5"/><mass value="400"/>
    <inertia ixx="80" iyy="90" izz="120" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="boom"><inertial><origin xyz="0.9 0.1 0"/><mass value="85"/>
    <inertia ixx="4" iyy="28" izz="28" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="stick"><inertial><origin xyz="0.5 0.03 0"/><mass value="55"/>
    <inertia ixx="1.5" iyy="7.5" izz="7.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="swing" type="revolute"><parent link="base"/><child link="house"/><axis xyz="0 0 1"/>
    <origin xyz="4 0 0.6"/><limit lower="-3" upper="3" effort="9000" velocity="2"/></joint>
  <joint name="lift" type="revolute"><parent link="house"/><child link="boom"/><axis xyz="0 0 1"/>
    <origin xyz="0.15 0 0.3" rpy="1.5707963 0 0"/><limit lower="-3" upper="3" effort="9000" velocity="2"/></joint>
  <joint name="crowd" type="revolute"><parent link="boom"/><child link="stick"/><axis xyz="0 0 1"/>
    <origin xyz="1.9 0 0"/><limit lower="-3" upper="3" effort="9000" velocity="2"/></joint>
</robot>
"""


def dug(name: str, role: str, seed: int, body: tuple[int, pin.Inertia], moving: tuple[int, ...]) -> Trial:
    """A trial with a body that the model has not, on the link after a joint; some joints stand still."""
    model = pin.buildModelFromXML(URDF)
    model.inertias[body[0]] += body[1]
    data, rng = model.createData(), np.random.default_rng(seed)
    t = np.arange(20 * RATE_HZ) / RATE_HZ
    q, v, a = swinging(t, SIZES, (0.12, 0.3, 0.55, 0.9), moving, rng)
    q += REST
    tau = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
    tau += VISCOUS * v + COULOMB * np.tanh(v / 0.01) + NOISE * rng.normal(size=q.shape)
    return Trial(name=name, role=role, time=t, q=q + 5e-6 * rng.normal(size=q.shape), tau=tau)


def diagnosed(folder: Path, body: tuple[int, pin.Inertia], moving: tuple[int, ...] = (0, 1, 2)) -> Diagnosis:
    trials = tuple(dug(name, role, k, body, moving) for k, (name, role) in enumerate(ROLES.items()))
    return diagnosed_trials(folder, URDF, JOINTS, RATE_HZ, trials)


def ball(mass: float, at: tuple[float, float, float]) -> pin.Inertia:
    return pin.Inertia.FromSphere(mass, 0.15).se3Action(pin.SE3(np.eye(3), np.array(at)))


@pytest.mark.battery
def test_a_load_at_the_end_of_a_long_stick_is_one_body(tmp_path: Path) -> None:
    """Held within 0.6 m of its joint, it was told as gains of two joints, a lighter stick, backlash and more."""
    found = diagnosed(tmp_path, (3, ball(12.0, (0.9, 0.0, 0.0))), moving=(1, 2))
    assert [(item.effect, item.location) for item in found.effects] == [("payload", "stick")]
    assert found.effects[0].parameters["mass"].value == pytest.approx(12.0, rel=0.01)


def test_a_body_far_out_on_a_boom_is_told_beside_constants_that_look_like_weight(tmp_path: Path) -> None:
    """Beside a gap of which a body takes all, what a body is like a priori weighed as much as the record."""
    found = diagnosed(tmp_path, (2, ball(20.0, (1.2, 0.2, 0.0))))
    assert [(item.effect, item.location) for item in found.effects] == [("payload", "boom")]
    parameters = found.effects[0].parameters
    # No joint tells its mass: at the boom's own joint it is as if it were not there, and a house is heavy.
    assert next(iter(parameters)) in {"first_moment", "mass"}
    assert parameters["mx"].value == pytest.approx(24.0, rel=0.01)
    assert parameters["my"].value == pytest.approx(4.0, rel=0.05)


def test_reach_grows_with_a_machine_and_not_with_where_it_stands() -> None:
    model = pin.buildModelFromXML(URDF)
    long = np.hypot(0.15, 0.3) + 1.9 + 2.0 * np.hypot(0.5, 0.03)
    assert largest_reach(model) == pytest.approx(0.5 * long)
    assert largest_reach(load_robot("panda").model) == 0.6
