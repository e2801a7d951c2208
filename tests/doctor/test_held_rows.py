"""Rows that were read twice are told from joints whose encoders show the same number again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.doctor.checks.clock import held_rows
from excite.doctor.examine import examine
from excite.logs.files import load_log, save_log
from excite.logs.log import Trial
from excite.logs.robot import nominal_robot
from excite.robot.loading import load_robot
from tests.diagnosis.two_joints import two_joint_log
from tests.identification.practice_log import arm_log, changed

RATE = 500.0
TIME = np.arange(5000) / RATE
STEP = 2.0 * np.pi / 2**14


def arm(speed: float, seed: int = 0) -> np.ndarray:
    """Two joints that swing, stand for two seconds and swing on; speeds in steps a row."""
    rng = np.random.default_rng(seed)
    running = (TIME < 4.0) | (TIME > 6.0)
    clock = np.cumsum(running) / RATE
    swing = np.sin(
        2.0 * np.pi * rng.uniform(0.2, 0.6, (3, 2)) * clock[:, None, None] + rng.uniform(0, 6, (3, 2))
    )
    q = swing.sum(axis=1)
    return np.asarray(q * speed * STEP / np.abs(np.diff(q, axis=0)).std())


def read(q: np.ndarray, flicker: float, rng: np.random.Generator) -> np.ndarray:
    return np.asarray(STEP * np.round(q / STEP + flicker * rng.standard_normal(q.shape)))


@pytest.mark.parametrize("flicker", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("speed", [0.1, 1.0, 8.0])
def test_encoders_that_show_the_same_number_again_are_no_rows_read_twice(
    speed: float, flicker: float
) -> None:
    q = read(arm(speed), flicker, np.random.default_rng(1))
    assert np.all(np.diff(q, axis=0) == 0.0, axis=1).sum() > 5
    assert held_rows(TIME, q).sum() <= 1


@pytest.mark.parametrize("every", [200, 10, 2])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_rows_read_twice_are_found_while_joints_move(every: int, noise: float) -> None:
    """With torques beside the positions or without; where the logger is twice as fast as the robot, too."""
    rng = np.random.default_rng(2)
    q = read(arm(12.0), 0.3, rng)
    values = np.hstack([q, noise * rng.standard_normal(q.shape)]) if noise else q
    again = np.arange(every, len(TIME), every)
    repeated = values.copy()
    repeated[again] = values[again - 1]
    moves = np.abs(np.diff(arm(12.0), axis=0)).max(axis=1) > 5.0 * STEP
    found = held_rows(TIME, repeated)
    assert found[again][moves[again - 1]].mean() > 0.95
    # Next to a row read twice, one that shows the same number by chance cannot be told from it.
    assert np.delete(found, again).mean() < 0.005


def test_a_leg_that_rests_in_a_log_of_commands_loses_no_row(tmp_path: Path) -> None:
    """As a robot's logger writes it, with five decimals."""
    trials = tuple(
        Trial(name, "identification", TIME, np.round(read(arm(2.0, k), 0.0, np.random.default_rng(k)), 5))
        for k, name in enumerate("ab")
    )
    trials = tuple(replace(trial, q_cmd=arm(2.0, k)) for k, trial in enumerate(trials))
    log = load_log(save_log(two_joint_log(trials, torque="none"), tmp_path / "log"))
    chart = examine(nominal_robot(log), log)
    assert "repeated_rows" not in {finding.kind for finding in chart.findings}
    assert [trial.n_samples for trial in chart.log.trials] == [len(TIME)] * 2


def test_velocities_that_are_pulses_beside_positions_read_thrice_say_nothing_of_the_clock() -> None:
    """A controller asks its drives every third cycle: what moved since stands in one row as a velocity, zero in two."""
    arm = load_robot("panda")

    def thrice(trial: Trial) -> Trial:
        fresh = np.arange(trial.n_samples) % 3 == 0
        at = np.flatnonzero(fresh)[np.cumsum(fresh) - 1]
        v = np.zeros_like(trial.q)
        v[fresh] = np.diff(trial.q[fresh], axis=0, prepend=trial.q[:1]) / np.median(np.diff(trial.time))
        return replace(trial, q=trial.q[at], tau=trial.tau[at], v=v)

    log = changed(arm_log(arm, 2), thrice)
    chart = examine(arm, log)
    kinds = {finding.kind for finding in chart.findings}
    assert "repeated_rows" in kinds
    assert not kinds & {"clock", "velocity", "rate"}
    assert np.ptp(chart.log.trials[0].time) == pytest.approx(np.ptp(log.trials[0].time), abs=0.02)
