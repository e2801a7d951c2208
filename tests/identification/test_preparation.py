"""Delay of torques and coupled drives on the way from a log to rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.identification.problem import advance_torques, build_problem
from excite.logs.log import Log, LogHeader, Trial
from excite.logs.signals.coupling import coupling_matrix
from excite.regressor.kernels import inverse_dynamics
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.rows.joint_rows import SHARED_GEAR_TERMS
from excite.rows.settings import ProblemSettings

RATE, PERIOD = 200.0, 8.0
COUPLING = {"wrist_3_joint": {"wrist_2_joint": 1.0}}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("ur10")


def periodic_motion(time: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Five harmonics of one period, as in eq. 8 of Xu et al. 2020; q, v, a ``(n, 6)``."""
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi / PERIOD * np.arange(1, 6)[:, None]
    size, phase = 0.35 * rng.uniform(0.3, 1.0, (5, 6)), rng.uniform(0, 2 * np.pi, (5, 6))
    angle = omega * time[:, None, None] + phase
    return (
        (size * np.sin(angle)).sum(1),
        (size * omega * np.cos(angle)).sum(1),
        (-size * omega**2 * np.sin(angle)).sum(1),
    )


def made_log(
    robot: Robot, *, periods: int = 4, noise: float = 0.0, delay: float = 0.0, coupled: bool = False
) -> Log:
    """A log of the nominal arm with friction, torques logged ``delay`` late."""
    time = np.arange(int(periods * PERIOD * RATE)) / RATE
    matrix = coupling_matrix(robot.joint_names, COUPLING if coupled else {})

    def torque(at: np.ndarray) -> np.ndarray:
        q, v, a = periodic_motion(at)
        motor = v @ matrix.T
        joint = inverse_dynamics(robot.model, q, v, a)
        return joint @ np.linalg.inv(matrix) + 2.0 * motor + 3.0 * np.tanh(motor / 0.01)

    rng = np.random.default_rng(1)
    tau = torque(time - delay) + noise * rng.normal(size=(len(time), 6))
    header = LogHeader.model_validate(
        {
            "schema": "excite.log/1",
            "robot": "robot.yaml",
            "base": "fixed",
            "rate_hz": RATE,
            "joints": robot.joint_names,
            "torque": "motor_side",
            "modelled": ["rigid_body", "viscous_friction", "coulomb_friction"],
            "trials": [{"file": "one.parquet", "role": "identification"}],
        }
    )
    return Log(header, (Trial("one", "identification", time, periodic_motion(time)[0], tau=tau),))


def truth(problem, viscous: float = 2.0, coulomb: float = 3.0) -> np.ndarray:
    """Parameters that :func:`made_log` was made with."""
    values = problem.prior.copy()
    for k, name in enumerate(problem.parameter_names):
        values[k] = {"viscous": viscous, "coulomb": coulomb}.get(name.split(".")[0], values[k])
    return values


def misfit(problem) -> float:
    """Largest residual of the truth, relative to the measurement's."""
    return float(np.abs(problem.residual(truth(problem))).max() / np.abs(problem.y).max())


@pytest.mark.parametrize("delay", [0.004, 0.0173, -0.011])
def test_a_stated_delay_of_torques_is_taken_out(robot: Robot, delay: float) -> None:
    log = made_log(robot, periods=2, noise=0.5, delay=delay)
    late, mended = (
        float(
            np.std(
                build_problem(robot, log, ProblemSettings(torque_delay_s=value)).residual(
                    truth(build_problem(robot, log))
                )
            )
        )
        for value in (0.0, delay)
    )
    assert mended <= 0.9 * late


def test_shifting_takes_all_forces_and_no_positions(robot: Robot) -> None:
    trial = made_log(robot).trials[0]
    trial = replace(trial, wrenches={"foot": np.column_stack([np.sin(trial.time)] * 6)})
    shifted = advance_torques(trial, 0.0123)
    assert shifted.q is trial.q
    inner = slice(10, -10)
    expected = np.sin(trial.time + 0.0123)[inner]
    np.testing.assert_allclose(shifted.wrenches["foot"][inner, 3], expected, atol=1e-5)


def test_a_coupled_wrist_is_explained_with_its_matrix_alone(robot: Robot) -> None:
    log = made_log(robot, coupled=True)
    stated = replace(log, header=log.header.model_copy(update={"coupling": COUPLING}))
    assert misfit(build_problem(robot, stated)) < 2e-3
    assert misfit(build_problem(robot, log)) > 0.02
    free = ProblemSettings(drive_terms=("viscous", *SHARED_GEAR_TERMS))
    names = build_problem(robot, stated, free).parameter_names
    columns = build_problem(robot, stated, free).Y[
        :, [k for k, n in enumerate(names) if n.startswith("joint_")]
    ]
    # Friction and inertia behind the gear are told apart only where two motors share a joint.
    moved = np.abs(columns).max(axis=0) > 0.0
    assert moved.tolist() == [name == "wrist_3_joint" for name in robot.joint_names] * 3
