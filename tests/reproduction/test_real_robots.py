"""Recordings of real machines as logs, and diagnoses of those that are quick; all are in `make reproduce`."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.reproduction import bam, brfd, dvrk, franka_joint2, hsm150
from tests.reproduction.real_robots import dvrk as dvrk_entries
from tests.reproduction.real_robots import emps as emps_entries
from tests.reproduction.real_robots.page import page

PAGE = Path(__file__).resolve().parents[2] / "docs" / "real_robots.md"


@pytest.mark.parametrize("place", ["insertion", "parallel"])
def test_dvrk_runs_follow_one_command(place: dvrk.Place, data_dir: Path, tmp_path: Path) -> None:
    """What the weight changes is torque, not motion."""
    log = dvrk.dvrk_log(data_dir, tmp_path, place)
    assert [trial.role for trial in log.trials] == ["identification", "validation"]
    assert sum(trial.n_samples for trial in log.trials) == 5999
    assert dvrk.typical_difference(data_dir, place) < 3e-3
    tau = np.vstack([trial.tau for trial in log.trials if trial.tau is not None])
    rms = np.sqrt((tau[:, :2] ** 2).mean(axis=0))
    # By hand, of the weight at the insertion axis [N·m]; the parallelogram carries it nearer to the axes.
    assert rms == pytest.approx([0.23, 0.26], rel=0.1) if place == "insertion" else (rms > 0.05).all()


def test_hsm150_turns_both_ways_and_repeats_every_step(data_dir: Path, tmp_path: Path) -> None:
    log = hsm150.hsm150_log(data_dir, tmp_path)
    assert len(log.role("identification")) == len(log.role("validation")) == len(hsm150.STEPS)
    ends = {trial.name: float(trial.q[-1, 0]) for trial in log.trials}
    assert all(value > 1000.0 for name, value in ends.items() if "pos" in name)
    assert all(value < -1000.0 for name, value in ends.items() if "neg" in name)


def test_bam_torque_holds_the_weight(data_dir: Path, tmp_path: Path) -> None:
    """Duty has a sign, and the motor pushes against gravity: its torque follows the weight's."""
    log = bam.bam_log(data_dir, tmp_path)
    assert len(log.trials) == 9
    for trial in log.trials:
        assert trial.tau is not None
        assert np.abs(trial.tau).max() < 1.1 * bam.TORQUE_PER_VOLT * 7.4
        # Slow motion: nothing but weight and friction.
        if "up_and_down" in trial.name:
            weight = bam.MASS * 9.81 * bam.LENGTH * np.sin(trial.q[:, 0])
            assert np.corrcoef(trial.tau[:, 0], weight)[0, 1] > 0.8, trial.name
    assert min(float(trial.tau.min()) for trial in log.trials if trial.tau is not None) < -0.5


def test_brfd_force_rises_with_the_tension(data_dir: Path, tmp_path: Path) -> None:
    def reach(pounds: int) -> float:
        log = brfd.brfd_log(data_dir, tmp_path / str(pounds), brfd.at_tension(pounds))
        tau = np.concatenate([trial.tau[:, 0] for trial in log.trials if trial.tau is not None])
        return float(np.ptp(tau)) / brfd.NEWTON_PER_KIP

    # Peak to peak as stated with the recordings [kip].
    assert reach(20) == pytest.approx(4.3, rel=0.05)
    assert reach(80) == pytest.approx(6.8, rel=0.05)


def test_franka_torque_is_what_was_published(data_dir: Path, tmp_path: Path) -> None:
    log = franka_joint2.franka_joint2_log(data_dir, tmp_path)
    std = {trial.name.split("_")[1]: trial.tau[:, 0].std() for trial in log.trials if trial.tau is not None}
    assert {name: round(float(value), 2) for name, value in std.items()} == {
        "slow": pytest.approx(0.353, abs=0.01),
        "high": pytest.approx(0.461, abs=0.01),
        "middle": pytest.approx(0.311, abs=0.01),
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "recordings", [emps_entries, pytest.param(dvrk_entries, marks=pytest.mark.battery)], ids=["emps", "dvrk"]
)
def test_quick_recordings_say_what_is_known_of_them(
    recordings: ModuleType, data_dir: Path, tmp_path: Path
) -> None:
    """EMPS without friction and without its offset, and the weights on the surgical arm: ticks as on the page.

    The page is what readers trust: a bar that is met no longer has to become a cross on it, and the other way round.
    """
    entries = recordings.entries(data_dir, tmp_path)
    assert "## " + entries[0].title in page(entries)
    for entry in entries:
        section = PAGE.read_text(encoding="utf-8").split(f"## {entry.title}\n")[1].split("\n## ")[0]
        shown = re.findall(r"^([✓✗]) ", section, flags=re.M)
        assert shown == ["✓" if bar.met else "✗" for bar in entry.bars], entry.title
