"""Faults of a record are found by name and number, alone and together, and a sound record has none."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from benchmarks.blind.arm_case import FAULTS
from excite.doctor.examine import Chart, examine
from excite.logs.files import load_log, save_log
from excite.logs.log import Trial
from excite.logs.robot import nominal_robot
from tests.diagnosis.two_joints import RATE_HZ, moved, two_joint_log

NOISE_Q = 2e-5
STEP = 2.0 * np.pi / 2**14


@pytest.fixture(scope="module")
def sound() -> Trial:
    rng = np.random.default_rng(3)
    trial = moved("a", "identification", 12.0, rng, np.eye(2))
    return replace(trial, q=trial.q + NOISE_Q * rng.standard_normal(trial.q.shape))


def examined(trial: Trial, folder: Path) -> Chart:
    """What the doctor says of a log of one trial, through its file."""
    log = load_log(save_log(two_joint_log((trial,)), folder / "log"))
    return examine(nominal_robot(log), log)


def sampled(trial: Trial, taken: np.ndarray, stamped: np.ndarray) -> Trial:
    """The trial taken at other instants, with stamps of its own."""
    assert trial.tau is not None
    q, tau = (CubicSpline(trial.time, values)(taken) for values in (trial.q, trial.tau))
    return replace(trial, time=stamped, q=q, tau=tau)


def jittered(trial: Trial, rng: np.random.Generator, honest: bool) -> Trial:
    """Taken up to a quarter of a step early or late, or stamped so although taken on time."""
    other = trial.time + rng.uniform(-0.25, 0.25, trial.n_samples) / RATE_HZ
    other = np.clip(other, trial.time[0], trial.time[-1])
    return sampled(trial, other if honest else trial.time, other)


def quantised(trial: Trial, rng: np.random.Generator) -> Trial:
    return replace(trial, q=STEP * np.round(trial.q / STEP))


def clipped(trial: Trial, rng: np.random.Generator) -> Trial:
    assert trial.tau is not None
    low, high = np.quantile(trial.tau, [0.02, 0.96], axis=0)
    return replace(trial, tau=np.clip(trial.tau, low, high))


def lacking(trial: Trial, rng: np.random.Generator) -> Trial:
    gone = rng.choice(np.arange(20, trial.n_samples - 20), 15, replace=False)
    return trial.rows(np.delete(np.arange(trial.n_samples), gone))


def early_or_late(trial: Trial, rng: np.random.Generator) -> Trial:
    return jittered(trial, rng, honest=True)


def stamped_late(trial: Trial, rng: np.random.Generator) -> Trial:
    return jittered(trial, rng, honest=False)


Change = Callable[[Trial, np.random.Generator], Trial]
RECORDS: dict[str, tuple[tuple[Change, ...], set[str]]] = {
    "sound": ((), set()),
    "quantised": ((quantised,), {"quantised"}),
    "clipped": ((clipped,), {"clipped"}),
    "quantised, clipped": ((quantised, clipped), {"quantised", "clipped"}),
    "jitter": ((early_or_late,), {"jitter"}),
    "jitter, quantised": ((early_or_late, quantised), {"jitter", "quantised"}),
    "late stamps": ((stamped_late,), {"late_stamps"}),
    "late stamps, quantised": ((stamped_late, quantised), {"late_stamps", "quantised"}),
    "missing": ((lacking,), {"missing_rows"}),
    "jitter, missing": ((early_or_late, lacking), {"jitter", "missing_rows"}),
    "late stamps, missing": ((stamped_late, lacking), {"late_stamps", "missing_rows"}),
}


@pytest.mark.parametrize("record", RECORDS)
def test_faults_are_named_and_nothing_else(record: str, sound: Trial, tmp_path: Path) -> None:
    changes, kinds = RECORDS[record]
    trial, rng = sound, np.random.default_rng(8)
    for change in changes:
        trial = change(trial, rng)
    chart = examined(trial, tmp_path)
    assert {fault.kind for fault in chart.findings} == kinds
    missing = [fault.text for fault in chart.findings if fault.kind == "missing_rows"]
    assert missing == (["15 rows are missing, in a 15: packets were lost"] if lacking in changes else [])


def test_late_stamps_are_put_where_the_rows_were_taken(sound: Trial, tmp_path: Path) -> None:
    """Also beside gaps, which no even clock may close."""
    rng = np.random.default_rng(9)
    gone = np.delete(np.arange(sound.n_samples), rng.choice(np.arange(20, sound.n_samples - 20), 15, False))
    late = stamped_late(sound, rng).rows(gone)
    (trial,) = examined(late, tmp_path).log.trials
    assert trial.n_samples == len(gone)
    shift = trial.time - sound.time[gone]
    assert np.abs(shift - shift.mean()).max() < 0.1 / RATE_HZ
    assert np.abs(late.time - sound.time[gone]).max() > 0.2 / RATE_HZ


@pytest.mark.parametrize("kind", ["repeated_rows", "missing_rows", "late_stamps", "jitter", "quantised"])
def test_faults_of_drawn_cases_are_found_and_counted(kind: str, sound: Trial, tmp_path: Path) -> None:
    """By the injectors of the blind cases, which know nothing of the doctor."""
    trial = FAULTS[kind](sound, np.random.default_rng(10))
    chart = examined(trial, tmp_path)
    assert {fault.kind for fault in chart.findings} == {kind}
    if kind == "quantised":
        assert re.search(r"q\.\w+ [\d.e-]+ rad[,;]|tau\.\w+ [\d.e-]+ N·m[,;]", chart.findings[0].text)
    if kind in {"repeated_rows", "missing_rows"}:
        assert trial.tau is not None
        held = int(np.sum(np.all(np.diff(np.hstack([trial.q, trial.tau]), axis=0) == 0.0, axis=1)))
        gone = sound.n_samples - trial.n_samples
        assert [fault.figures["rows"] for fault in chart.findings] == [held or gone]


def stuck(trial: Trial, level: float) -> Trial:
    """The first joint held at one height by dry friction as it turns back, which it leaves at speed."""
    q = trial.q.copy()
    q[:, 0] = STEP * np.round(np.minimum(q[:, 0], level) / STEP)
    return replace(trial, q=q)


def test_a_joint_that_sticks_where_it_turns_back_is_not_clipped(sound, tmp_path):
    """Two motions that turn at different heights; a sensor's range ends at one."""

    def kinds(levels: tuple[float, float]) -> set[str]:
        trials = [replace(stuck(sound, level), name=name) for name, level in zip("ab", levels, strict=True)]
        log = load_log(save_log(two_joint_log(tuple(trials)), tmp_path / f"log{levels[1]:.3f}"))
        assert any(trial.cleaning.clipped for trial in log.trials)
        return {finding.kind for finding in examine(nominal_robot(log), log).findings}

    high, low = np.quantile(sound.q[:, 0], [0.9, 0.8])
    assert "clipped" in kinds((high, high))
    assert "clipped" not in kinds((high, low))
