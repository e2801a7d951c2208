"""Records of an arm with two joints: rigid bodies, friction of the motors, noise of the torques."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.logs.log import Log, LogHeader, Trial

RATE_HZ = 200
VISCOUS, COULOMB, NOISE = np.array([0.6, 0.4]), np.array([1.5, 1.0]), 0.05
URDF = """<robot name="two">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.15 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.005" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="first" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
  <joint name="second" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.3 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
</robot>
"""


def moved(
    name: str,
    role: str,
    seconds: float,
    rng: np.random.Generator,
    matrix: np.ndarray,
    tones: tuple[float, ...] = (0.3, 0.7, 1.3),
) -> Trial:
    """A trial of rigid bodies with viscous and Coulomb friction of the motors, torques as the motors have them."""
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    fine = np.arange(10 * round(seconds * RATE_HZ)) / (10 * RATE_HZ)
    q = np.zeros((len(fine), 2))
    for j in range(2):
        for k, turn in enumerate(tones):
            w, size, p = 2.0 * np.pi * turn * (1.0 + 0.15 * j), 0.4 / (k + 1), rng.uniform(0.0, 6.28)
            q[:, j] += size * np.sin(w * fine + p)
    # It starts and ends at rest.
    q *= np.sin(0.5 * np.pi * np.clip(np.minimum(fine, seconds - fine), 0.0, 1.0))[:, None] ** 2
    v = np.gradient(q, fine, axis=0)
    a = np.gradient(v, fine, axis=0)
    t, q, v, a = fine[::10], q[::10], v[::10], a[::10]
    rigid = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
    turning = v @ matrix.T
    motor = rigid @ np.linalg.inv(matrix) + VISCOUS * turning + COULOMB * np.sign(turning)
    return Trial(name=name, role=role, time=t, q=q, tau=motor + NOISE * rng.normal(size=q.shape))


def two_joint_log(trials: tuple[Trial, ...], **header) -> Log:
    """A log whose model has all that is there."""
    said = {
        "schema": "excite.log/1",
        "robot": "two.urdf",
        "base": "fixed",
        "rate_hz": RATE_HZ,
        "joints": ["first", "second"],
        "torque": "motor_side",
        "modelled": ["rigid_body", "viscous_friction", "coulomb_friction"],
        "trials": [{"file": f"{trial.name}.parquet", "role": trial.role} for trial in trials],
    }
    return Log(LogHeader.model_validate(said | header), trials, robot_text=URDF)
