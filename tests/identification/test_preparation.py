"""Clock, outliers, delay, periods and coupled drives on the way from a log to rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import InputError, LogError
from excite.identification.preparation import advance_torques, prepare_trial
from excite.identification.problem import build_problem
from excite.identification.torque_delay import estimate_torque_delay
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


def test_default_settings_leave_a_trial_alone(robot: Robot) -> None:
    trial = made_log(robot).trials[0]
    settings = ProblemSettings()
    assert prepare_trial(trial, settings, settings.filters(floating=False)).trial is trial


def test_averaged_periods_have_less_noise_and_the_same_rows(robot: Robot) -> None:
    """Xu et al. 2020, eq. 11: M periods leave noise over the root of M."""
    settings = ProblemSettings(period_s=PERIOD, differentiation="fourier")
    log = made_log(robot, periods=9, noise=1.0)
    clean = build_problem(robot, made_log(robot, periods=9), settings)
    assert misfit(clean) < 2e-3
    noisy = build_problem(robot, log, settings)
    once = build_problem(robot, replace(log, trials=(_cut(log.trials[0]),)), settings)
    spread = [float(np.std(problem.y - clean.y)) for problem in (noisy, once)]
    assert spread[1] / spread[0] == pytest.approx(3.0, rel=0.15)
    # Exactly one period of rows: nothing twice, nothing lost to the filters' ends.
    span = clean.time.max() - clean.time.min()
    assert PERIOD - 0.25 < span + 1.0 / 10.0 < PERIOD + 0.25
    prepared = prepare_trial(log.trials[0], settings, settings.filters(floating=False))
    assert prepared.n_periods == 9 and prepared.period_std[0] == pytest.approx(1.0, rel=0.05)


def _cut(trial: Trial) -> Trial:
    n = int(PERIOD * RATE)
    return replace(trial, time=trial.time[:n], q=trial.q[:n], tau=trial.tau[:n])


def test_a_wrong_period_is_refused(robot: Robot) -> None:
    with pytest.raises(LogError, match="jumps"):
        build_problem(robot, made_log(robot), ProblemSettings(period_s=7.3))
    with pytest.raises(LogError, match="hold no period"):
        build_problem(robot, made_log(robot), ProblemSettings(period_s=50.0))
    with pytest.raises(InputError, match="period_s"):
        ProblemSettings(differentiation="fourier")
    with pytest.raises(InputError, match="choose stamps or positions"):
        ProblemSettings(clock="sundial")


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.0173, -0.011])
def test_a_delay_of_torques_is_estimated_and_taken_out(robot: Robot, delay: float) -> None:
    log = made_log(robot, periods=2, noise=0.5, delay=delay)
    lag = estimate_torque_delay(robot, log)
    assert lag.lag_s == pytest.approx(delay, abs=4.0 * lag.std_s + 1e-4) and lag.std_s < 1e-3
    late, mended = (
        float(
            np.std(
                build_problem(robot, log, ProblemSettings(torque_delay_s=value)).residual(
                    truth(build_problem(robot, log))
                )
            )
        )
        for value in (0.0, lag.lag_s)
    )
    assert mended <= late * (1.001 if delay == 0.0 else 0.9)


def test_shifting_takes_all_forces_and_no_positions(robot: Robot) -> None:
    trial = made_log(robot).trials[0]
    trial = replace(trial, wrenches={"foot": np.column_stack([np.sin(trial.time)] * 6)})
    shifted = advance_torques(trial, 0.0123)
    assert shifted.q is trial.q
    inner = slice(10, -10)
    expected = np.sin(trial.time + 0.0123)[inner]
    np.testing.assert_allclose(shifted.wrenches["foot"][inner, 3], expected, atol=1e-5)


def test_spikes_do_not_reach_the_rows(robot: Robot) -> None:
    log = made_log(robot, noise=0.05)
    trial = log.trials[0]
    spiked = trial.tau.copy()
    spiked[np.arange(100, 6000, 401)] += 80.0
    bad = replace(log, trials=(replace(trial, tau=spiked),))
    clean, left, mended = (
        build_problem(robot, data, ProblemSettings(outlier_sigma=sigma)).y
        for data, sigma in ((log, None), (bad, None), (bad, 6.0))
    )
    assert np.std(left - clean) > 20.0 * np.std(mended - clean)


def test_a_regular_clock_behind_late_stamps_is_used_where_it_is_asked_for(robot: Robot) -> None:
    log = made_log(robot)
    trial = log.trials[0]
    late = np.random.default_rng(0).exponential(0.002, len(trial.time))
    stamps = np.maximum.accumulate(trial.time + late) + 1e-8 * np.arange(len(late))
    bad = replace(log, trials=(replace(trial, time=stamps),))
    settings = (ProblemSettings(), ProblemSettings(clock="positions"))
    left, mended = (misfit(build_problem(robot, bad, item)) for item in settings)
    assert mended < 0.3 * left


def test_a_coupled_wrist_is_explained_with_its_matrix_alone(robot: Robot) -> None:
    log = made_log(robot, coupled=True)
    coupled = build_problem(robot, log, ProblemSettings(coupling=COUPLING))
    assert misfit(coupled) < 2e-3
    assert misfit(build_problem(robot, log)) > 0.02
    # The log may say it itself.
    stated = replace(log, header=log.header.model_copy(update={"coupling": COUPLING}))
    np.testing.assert_array_equal(build_problem(robot, stated).Y, coupled.Y)
    free = ProblemSettings(coupling=COUPLING, drive_terms=("viscous", *SHARED_GEAR_TERMS))
    names = build_problem(robot, log, free).parameter_names
    columns = build_problem(robot, log, free).Y[:, [k for k, n in enumerate(names) if n.startswith("joint_")]]
    # Friction and inertia behind the gear are told apart only where two motors share a joint.
    moved = np.abs(columns).max(axis=0) > 0.0
    assert moved.tolist() == [name == "wrist_3_joint" for name in robot.joint_names] * 3
