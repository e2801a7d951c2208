"""An arm whose axes are all upright: a body on its second axis is, for the first motor, what a rotor is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.answer.answer import Diagnosis
from excite.logs.log import Trial
from tests.diagnosis.swung import ROLES, diagnosed_trials, swinging

RATE_HZ, LENGTH = 250, 0.325
JOINTS = ("shoulder", "elbow", "wrist")
VISCOUS, COULOMB, NOISE = np.array([1.5, 0.8, 0.05]), np.array([3.0, 1.8, 0.1]), np.array([0.3, 0.15, 0.01])
SIZES = np.array([0.5, 0.6, 0.8])
URDF = f"""<robot name="scara">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.15 0 0"/><mass value="6"/>
    <inertia ixx="0.02" iyy="0.08" izz="0.08" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.12 0 0"/><mass value="4"/>
    <inertia ixx="0.01" iyy="0.04" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="flange"><inertial><origin xyz="0 0 0.02"/><mass value="1.6"/>
    <inertia ixx="0.001" iyy="0.001" izz="0.0016" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-2.5" upper="2.5" effort="200" velocity="6"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 0 1"/>
    <origin xyz="{LENGTH} 0 0"/><limit lower="-2.5" upper="2.5" effort="100" velocity="6"/></joint>
  <joint name="wrist" type="revolute"><parent link="lower"/><child link="flange"/><axis xyz="0 0 1"/>
    <origin xyz="0.225 0 0"/><limit lower="-3" upper="3" effort="20" velocity="10"/></joint>
</robot>
"""


def moved(name: str, role: str, seed: int, rotors: np.ndarray, load: pin.Inertia) -> Trial:
    """A trial with rotors and a load at the flange that the model has not."""
    model = pin.buildModelFromXML(URDF)
    model.inertias[3] += load
    data, rng = model.createData(), np.random.default_rng(seed)
    t = np.arange(12 * RATE_HZ) / RATE_HZ
    q, v, a = swinging(t, SIZES, (0.25, 0.6, 1.1, 1.9), range(3), rng)
    tau = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
    tau += rotors * a + VISCOUS * v + COULOMB * np.tanh(v / 0.01) + NOISE * rng.normal(size=q.shape)
    return Trial(name=name, role=role, time=t, q=q + 2e-6 * rng.normal(size=q.shape), tau=tau)


def diagnosed(folder: Path, rotors: tuple[float, float, float], load: pin.Inertia) -> Diagnosis:
    trials = tuple(
        moved(name, role, k, np.array(rotors), load) for k, (name, role) in enumerate(ROLES.items())
    )
    return diagnosed_trials(folder, URDF, JOINTS, RATE_HZ, trials)


def test_a_rotor_and_a_body_that_say_the_same_are_rivals(tmp_path: Path) -> None:
    """A little rotor at the elbow as well, which a body's other parameters take up, is no sign of a body."""
    found = diagnosed(tmp_path, (0.5, 3e-4, 0.0), pin.Inertia.Zero())
    assert found.verdict == "ambiguous"
    rivals = {(item.effect, item.location): item.parameters for item in found.ambiguous_with}
    # Inertia about the shoulder's axis alone: of the upper link's body, or of a mass on the elbow's axis.
    (body,) = [key for key in rivals if key[0] == "payload"]
    assert set(rivals) == {body, ("armature", "shoulder")}
    told = rivals[body]
    inertia = told["Izz"].value if body[1] == "upper" else told["mass"].value * LENGTH**2
    assert inertia == pytest.approx(0.5, rel=0.01)
    assert rivals["armature", "shoulder"]["inertia"].value == pytest.approx(0.5, rel=0.01)
    assert found.next_experiment is not None
    assert "in any motion of these joints" in found.next_experiment.why
    assert "without the load" in found.next_experiment.why


def test_a_load_that_several_motors_feel_has_no_rotor_for_a_rival(tmp_path: Path) -> None:
    ball = pin.Inertia.FromSphere(5.0, 0.05).se3Action(pin.SE3(np.eye(3), np.array([0.03, 0.0, -0.05])))
    found = diagnosed(tmp_path, (0.0, 0.0, 0.0), ball)
    assert found.verdict == "effect"
    assert [(item.effect, item.location) for item in found.effects] == [("payload", "flange")]
    assert found.effects[0].parameters["mass"].value == pytest.approx(5.0, rel=0.01)
