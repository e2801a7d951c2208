"""Trials in which a robot is held still: their weights are used, whatever friction holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.identification.identify import identify
from excite.identification.problem import build_problem
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import Log, Trial
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.joint_rows import AT_REST
from excite.rows.settings import ProblemSettings
from tests.identification.practice_log import arm_log

HOLDS = np.array([12.0, 12.0, 8.0, 3.0, 3.0, 2.0])


def still(robot: Robot, name: str, rng: np.random.Generator) -> Trial:
    """Six seconds in one posture; friction holds each joint with what it had when it stopped."""
    q = np.tile(rng.uniform(-1.2, 1.2, 6), (600, 1))
    rest = np.zeros_like(q)
    tau = inverse_dynamics(robot.model, q, rest, rest) + HOLDS * rng.uniform(-1.0, 1.0, 6)
    noise = rng.standard_normal((2, *q.shape))
    return Trial(
        name=name,
        role="identification",
        time=np.arange(600) / 100.0,
        q=q + 1e-5 * noise[0],
        tau=tau + 0.1 * noise[1],
    )


@pytest.fixture(scope="module")
def moving(ur10: Robot) -> Log:
    log = arm_log(ur10, 3, duration=10.0, true=ur10.nominal_parameters)
    modelled = ("rigid_body", "viscous_friction", "coulomb_friction", "armature")
    return replace(log, robot_text=ur10.urdf, header=log.header.model_copy(update={"modelled": modelled}))


@pytest.fixture(scope="module")
def log(ur10: Robot, moving: Log) -> Log:
    """Motions, and eight postures."""
    rng = np.random.default_rng(4)
    trials = (*moving.trials, *(still(ur10, f"still_{k}", rng) for k in range(8)))
    named = tuple(TrialHeader(file=f"{trial.name}.csv", role=trial.role) for trial in trials)
    return replace(moving, trials=trials, header=moving.header.model_copy(update={"trials": named}))


def test_a_posture_is_one_row_a_joint_where_friction_holds_it(ur10: Robot, log: Log, moving: Log) -> None:
    assert build_problem(ur10, log).n_rows == build_problem(ur10, moving).n_rows + 8 * 6


def test_without_dry_friction_a_posture_counts_as_long_as_it_was_held(
    ur10: Robot, log: Log, moving: Log
) -> None:
    bare = ProblemSettings(drive_terms=("viscous", "armature"))
    more = build_problem(ur10, log, bare).n_rows - build_problem(ur10, moving, bare).n_rows
    assert more > 8 * 6 * 20


def test_a_row_at_rest_is_the_posture_s_weight(ur10: Robot, log: Log) -> None:
    problem = build_problem(ur10, log)
    rows = problem.trial == problem.trial_names.index("still_0")
    q = log.trials[-8].q.mean(axis=0)[None]
    weight = inverse_dynamics(ur10.model, q, np.zeros((1, 6)), np.zeros((1, 6)))[0]
    body = problem.Y[rows][:, : problem.n_inertial] @ ur10.nominal_parameters
    np.testing.assert_allclose(body, AT_REST * weight, atol=1e-3)


def test_postures_make_what_is_identified_no_worse(ur10: Robot, log: Log, moving: Log) -> None:
    with_them, without = identify(ur10, log, "wls"), identify(ur10, moving, "wls")
    assert "standing" in {item.kind for item in with_them.findings}
    for name, fit in without.validation.items():
        assert with_them.validation[name].rmse < 1.1 * fit.rmse


def test_a_diagnosis_uses_them_too(ur10: Robot, log: Log, moving: Log) -> None:
    found = [(item.effect, item.location) for item in diagnose(log, ur10).effects]
    assert found == [(item.effect, item.location) for item in diagnose(moving, ur10).effects]
