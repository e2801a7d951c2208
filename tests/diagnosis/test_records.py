"""What records of real robots have and simulated ones have not: standstill, coupled motors, joints without torque."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.logs.files import save_log
from excite.logs.log import Trial
from tests.diagnosis.two_joints import NOISE, RATE_HZ, moved, two_joint_log

COUPLING = {"second": {"first": 0.8}}


def diagnosed(folder: Path, trials: tuple[Trial, ...], **header) -> Diagnosis:
    return diagnose(save_log(two_joint_log(trials, **header), folder))


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
