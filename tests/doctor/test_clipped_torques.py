"""A torque that is cut off in most rows is smaller than the model's, and in no other unit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.doctor.examine import examine
from excite.logs.files import load_log, save_log
from excite.logs.robot import nominal_robot
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log, changed


@pytest.mark.parametrize(("factor", "kinds"), [(1.0, {"clipped"}), (0.1, {"clipped", "torque_scale"})])
def test_a_torque_clipped_in_most_rows(factor: float, kinds: set[str], tmp_path: Path) -> None:
    robot = load_robot("ur10")
    log = arm_log(robot, 3, duration=10.0)
    j = 2
    most = float(np.quantile(np.abs(np.concatenate([t.tau[:, j] for t in log.trials])), 0.1))
    trials = []
    for trial in log.trials:
        tau = np.array(trial.tau)
        tau[:, j] = factor * np.clip(tau[:, j], -most, most)
        trials.append(replace(trial, tau=tau))
    ill = load_log(
        save_log(replace(log, trials=tuple(trials), robot_text=robot.urdf), tmp_path / "log"), robot
    )
    assert all(2 * sum(trial.cleaning.clipped.values()) > len(trial.time) for trial in ill.trials)
    found = examine(robot, ill).findings
    assert {finding.kind for finding in found} - {"quantised"} == kinds


def test_a_torque_that_is_clipped_now_and_then_is_in_no_other_unit(gap_dir: Path, tmp_path: Path) -> None:
    """Coulomb friction makes most of this torque, and what is cut off of it looked like a smaller unit."""
    log = load_log(gap_dir / "arm" / "case_023")
    most = float(np.quantile(np.abs(np.concatenate([t.tau[:, 0] for t in log.trials])), 0.8))
    trials = []
    for trial in log.trials:
        tau = np.array(trial.tau)
        tau[:, 0] = np.clip(tau[:, 0], -most, most)
        trials.append(replace(trial, tau=tau))
    robot = nominal_robot(log)
    ill = load_log(
        save_log(replace(log, trials=tuple(trials), robot_text=robot.urdf), tmp_path / "log"), robot
    )
    chart = examine(robot, ill)
    assert {finding.kind for finding in chart.findings} - {"quantised"} == {"clipped"}
    for trial, before in zip(chart.log.trials, ill.trials, strict=True):
        assert np.array_equal(trial.tau, before.tau)
        at = np.abs(before.tau[:, 0]) == most
        assert np.array_equal(at, np.zeros_like(at) if trial.beyond is None else trial.beyond[:, 0])


@pytest.mark.parametrize(("joint", "ends"), [(1, (0.45, 0.52)), (1, (0.1, 0.35)), (2, (0.3, 0.6))])
def test_noise_stops_at_the_ends_of_a_narrow_range(
    joint: int, ends: tuple[float, float], tmp_path: Path
) -> None:
    """Neither a unit, nor friction that is missing, is read from a torque that hardly leaves its ends."""
    robot = load_robot("ur10")
    log = arm_log(robot, 5, duration=10.0)
    low, high = np.quantile(np.concatenate([t.tau[:, joint] for t in log.trials]), ends)
    trials = []
    for trial in log.trials:
        tau = np.array(trial.tau)
        tau[:, joint] = np.clip(tau[:, joint], low, high)
        trials.append(replace(trial, tau=tau))
    ill = load_log(
        save_log(replace(log, trials=tuple(trials), robot_text=robot.urdf), tmp_path / "log"), robot
    )
    chart = examine(robot, ill)
    assert {finding.kind for finding in chart.findings} - {"quantised"} == {"clipped"}


def test_what_is_cut_off_of_a_torque_is_no_other_mistake(tmp_path: Path) -> None:
    robot, j = load_robot("ur10"), 1
    log = arm_log(robot, 4, duration=10.0)
    most = float(np.quantile(np.abs(np.concatenate([t.tau[:, j] for t in log.trials])), 0.1))
    clipped = changed(
        log,
        lambda t: replace(
            t, tau=np.where(np.arange(robot.n_joints) == j, np.clip(t.tau, -most, most), t.tau)
        ),
    )
    folder = save_log(replace(clipped, robot_text=robot.urdf), tmp_path / "log")
    chart = examine(robot, load_log(folder, robot))
    assert {found.kind for found in chart.findings} - {"quantised"} == {"clipped"}
    assert chart.log.header.no_torque == ()
