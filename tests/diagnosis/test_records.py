"""What records of real robots have and simulated ones have not: standstill, coupled motors, joints without torque."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.result import Diagnosis
from excite.logs.files import save_log
from excite.logs.log import Log, LogHeader, Trial

RATE_HZ = 200
COUPLING = {"second": {"first": 0.8}}
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


def moved(name: str, role: str, seconds: float, rng: np.random.Generator, matrix: np.ndarray) -> Trial:
    """A trial of rigid bodies with viscous and Coulomb friction of the motors, torques as the motors have them."""
    model = pin.buildModelFromXML(URDF)
    data = model.createData()
    fine = np.arange(10 * round(seconds * RATE_HZ)) / (10 * RATE_HZ)
    q = np.zeros((len(fine), 2))
    for j in range(2):
        for k, turn in enumerate((0.3, 0.7, 1.3)):
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


def diagnosed(folder: Path, trials: tuple[Trial, ...], **header) -> Diagnosis:
    """The diagnosis of trials with a model that has all that is there."""
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
    log = Log(LogHeader.model_validate(said | header), trials, robot_text=URDF)
    return diagnose(save_log(log, folder))


def two_trials(matrix: np.ndarray) -> tuple[Trial, ...]:
    rng = np.random.default_rng(11)
    return (moved("a", "identification", 15.0, rng, matrix), moved("b", "validation", 8.0, rng, matrix))


def test_friction_that_holds_a_robot_before_and_after_its_motion_is_no_gap(tmp_path: Path) -> None:
    """Static friction holds with any torque up to the breakaway, here a large one that no model has."""

    def held(trial: Trial) -> Trial:
        assert trial.tau is not None
        n = 3 * RATE_HZ
        q = np.vstack([np.tile(trial.q[0], (n, 1)), trial.q, np.tile(trial.q[-1], (n, 1))])
        # Wandering as with temperature, so that no row repeats the one before.
        creep = 3.0 + np.linspace(0.0, 1.0, n)[:, None] * np.ones(2)
        tau = np.vstack([trial.tau[0] + creep, trial.tau, trial.tau[-1] - creep])
        return replace(trial, time=np.arange(len(q)) / RATE_HZ, q=q, tau=tau)

    plain = two_trials(np.eye(2))
    moving = diagnosed(tmp_path / "moving", plain)
    standing = diagnosed(tmp_path / "standing", tuple(held(trial) for trial in plain))
    assert moving.verdict == standing.verdict == "none"
    assert standing.gap.before < 1.5 * moving.gap.before


def test_coupled_motors_are_no_gap_where_the_log_says_so(tmp_path: Path) -> None:
    """The second motor turns with the first joint: its torque acts on both, and its friction follows both."""
    matrix = np.array([[1.0, 0.0], [0.8, 1.0]])
    trials = two_trials(matrix)
    said = diagnosed(tmp_path / "said", trials, coupling=COUPLING)
    assert said.verdict == "none"
    assert said.gap.before < 1.5 * said.gap.noise_floor
    assert said.simulation is not None and "several joints" in said.simulation.warnings[0]
    unsaid = diagnosed(tmp_path / "unsaid", trials)
    assert unsaid.verdict != "none"
    assert unsaid.gap.before > 2.0 * said.gap.before


def test_a_joint_without_torque_moves_the_others(tmp_path: Path) -> None:
    """What was not measured is not judged, but its motion loads the joints before it."""
    trials = two_trials(np.eye(2))
    assert all(trial.tau is not None for trial in trials)
    blank = tuple(
        replace(t, tau=np.column_stack([t.tau[:, 0], np.full(t.n_samples, np.nan)]))
        for t in trials
        if t.tau is not None
    )
    result = diagnosed(tmp_path, blank, no_torque=["second"])
    assert set(result.gap.per_channel) == {"first"}
    assert result.verdict == "none"
    assert result.gap.per_channel["first"].before == pytest.approx(NOISE * np.sqrt(0.1), rel=0.5)
