"""What predictors far simpler than a simulator reach where it is judged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from excite.diagnosis.answer.gap import TrivialErrors, find_beaten_channels
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.trivial import (
    EvenTrial,
    even_trials,
    find_repeated_commands,
    fit_delayed_command,
    fit_fir,
    of_positions,
    of_torques,
)
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, LogHeader, Trial
from excite.logs.robot import nominal_robot
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.conftest import lacking
from tests.diagnosis.two_joints import RATE_HZ, moved, two_joint_log

NOISE = 1e-3


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    folder = save_log(command_log(run("a", "identification", 1, 1)), tmp_path_factory.mktemp("log"))
    return nominal_robot(load_log(folder))


def command(seed: int, seconds: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """A chirp of two joints, with the phase of the seed."""
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    phase = np.random.default_rng(seed).uniform(0.0, 6.28, 2)
    turns = 0.2 * time + (1.5 - 0.2) * time**2 / (2.0 * seconds)
    return time, 0.1 + 0.4 * np.sin(2.0 * np.pi * turns[:, None] + phase)


def run(name: str, role: str, seed: int, noise_seed: int, pole: float = 0.95, **other) -> Trial:
    """A command followed by a first-order servo to nine tenths of it and three hundredths off, with noise."""
    time, wanted = command(seed)
    followed = lfilter([1.0 - pole], [1.0, -pole], wanted, axis=0, zi=pole * wanted[:1])[0]
    noise = NOISE * np.random.default_rng(noise_seed).standard_normal(wanted.shape)
    return Trial(name, role, time, 0.9 * followed + 0.03 + noise, q_cmd=wanted, **other)


def command_log(*trials: Trial) -> Log:
    return two_joint_log(trials, torque="none", modelled=["rigid_body"])


def test_predictors_are_ranked_as_their_physics_asks(robot: Robot):
    log = command_log(
        run("a", "identification", 1, 1), run("b", "identification", 2, 2), run("c", "validation", 1, 3)
    )
    told = of_positions(robot, log, ("second", "first"))
    assert list(told) == ["second", "first"]
    for item in told.values():
        assert item.unit == "rad"
        # A first-order filter is one of finite response: only noise is left. A delay is not quite the same.
        assert item.fir == pytest.approx(NOISE, rel=0.1)
        assert 1.5 * item.fir < item.delayed_command < 0.3 * item.command
        # The mean age of a sample in the filter, 19 periods.
        assert item.delay_s == pytest.approx(19.0 / RATE_HZ, rel=0.15)
        # The same command, found without being told: two noises.
        assert item.repeat == pytest.approx(np.sqrt(2.0) * NOISE, rel=0.1)


def test_nothing_is_learnt_from_what_judges(robot: Robot):
    learnt = run("a", "identification", 1, 1)
    once = of_positions(robot, command_log(learnt, run("b", "validation", 2, 2)), ("first",))["first"]
    other = of_positions(robot, command_log(learnt, run("b", "validation", 2, 2, pole=0.8)), ("first",))[
        "first"
    ]
    assert other.delay_s == once.delay_s and other.fir_s == once.fir_s
    assert other.fir > 5.0 * once.fir


def test_a_pure_delay_is_found_to_a_fraction_of_a_sample():
    time, wanted = command(1)
    late = np.column_stack([np.interp(time - 0.0335, time, c) for c in wanted.T])
    trial = EvenTrial("a", True, None, time, 0.8 * late - 0.1, wanted, np.ones(len(time), dtype=bool))
    found = fit_delayed_command([trial])
    assert found.length_s == pytest.approx(0.0335, abs=5e-4)
    scale, offset = np.array(found.weights).T
    assert scale == pytest.approx(0.8, abs=1e-3)
    assert offset == pytest.approx(-0.1, abs=1e-3)


def test_a_command_that_stands_is_no_trouble():
    time = np.arange(1000) / RATE_HZ
    still = np.full((1000, 1), 0.4)
    trial = EvenTrial("a", True, None, time, still - 0.05, still, np.ones(1000, dtype=bool))
    for predictor in (fit_delayed_command([trial]), fit_fir([trial])):
        assert predictor.predict_positions(trial) == pytest.approx(trial.position, abs=1e-6)


def test_only_the_pieces_that_judge_count(robot: Robot):
    spoilt = run("b", "validation", 2, 2)
    q = spoilt.q.copy()
    q[: len(q) // 2] += 1.0
    log = command_log(run("a", "identification", 1, 1), replace(spoilt, q=q))
    half = float(spoilt.time[-1]) / 2.0
    whole = of_positions(robot, log, ("first",))["first"]
    second = of_positions(robot, log, ("first",), [("b", half + 0.1, 2.0 * half)])["first"]
    assert whole.fir > 0.5
    assert second.fir == pytest.approx(NOISE, rel=0.15)


def test_one_command_is_known_again_when_the_logger_started_later():
    first = run("a", "identification", 1, 1)
    later = run("b", "validation", 1, 2)
    shift = 37
    later = replace(
        later,
        time=later.time[:-shift],
        q=later.q[shift:],
        q_cmd=None if later.q_cmd is None else later.q_cmd[shift:],
    )
    trials = even_trials(command_log(first, later, run("c", "validation", 3, 3)), ("first", "second"))
    (pair,) = find_repeated_commands(trials)
    assert (pair.first, pair.again) == (0, 1)
    assert pair.lag_s == pytest.approx(-shift / RATE_HZ, abs=1e-3)


def test_torques_have_repeats_alone(robot: Robot):
    rng = np.random.default_rng(0)
    trials = [
        moved(n, r, 8.0, np.random.default_rng(s), np.eye(2))
        for n, r, s in (("a", "identification", 1), ("b", "validation", 1), ("c", "identification", 2))
    ]
    trials[1] = replace(trials[1], tau=trials[1].tau + 0.05 * rng.standard_normal(trials[1].tau.shape))
    samples = arm_samples(robot, two_joint_log(tuple(trials)), trials)
    after = np.ones((2, len(samples.trial_of_row)))
    told = of_torques(samples, after)
    for item in told.values():
        assert (item.command, item.delayed_command, item.fir) == (None, None, None)
        assert (item.unit, item.model) == ("N·m", 1.0)
        # White noise at 200 Hz through a filter of 10 Hz.
        assert 0.2 * 0.05 < item.repeat < 0.6 * 0.05


def test_a_simulator_that_a_filter_beats_is_told_so():
    good = TrivialErrors(0.1, 0.01, 0.005, None, model=0.004)
    worse = TrivialErrors(0.1, 0.01, 0.005, None, model=0.006)
    assert find_beaten_channels({"first": good}) == ()
    (finding,) = find_beaten_channels({"first": good, "second": worse})
    assert (finding.kind, finding.places) == ("no_better_than_trivial", ("second",))
    assert "0.006 rad against 0.005 of the filter" in finding.text
    # At the floor nothing is left to be better at.
    assert find_beaten_channels({"second": replace(worse, floor=0.005)}) == ()
    # Torques have no such neighbours.
    assert find_beaten_channels({"second": TrivialErrors(repeat=0.1, model=3.0, unit="N·m")}) == ()


def test_a_walking_robots_chirps(data_dir: Path):
    """Figures published beside the recordings: command .0794, delay .0100, filter .0050 rad."""
    folder = data_dir / "quadruped_chirp_pace"
    if not folder.is_dir():
        lacking(f"{folder} is not here")
    trials = []
    for k in range(7):
        with np.load(folder / f"go2_traj_{k}.npz") as file:
            time, q, wanted = file["time"].astype(float), file["dof_pos"][:, :3], file["des_dof_pos"][:, :3]
        trials.append(Trial(f"t{k}", "identification" if k < 5 else "validation", time, q, q_cmd=wanted))
    joints = ["hip", "thigh", "calf"]
    header = {
        "schema": "excite.log/1", "robot": "go2.xml", "base": "fixed", "rate_hz": 199.957, "torque": "none",
        "joints": joints, "trials": [{"file": f"{t.name}.csv", "role": t.role} for t in trials],
    }  # fmt: skip
    log = Log(LogHeader.model_validate(header), tuple(trials))
    told = of_positions(load_robot("ur10"), log, joints).values()

    def rms(name: str) -> float:
        return float(np.sqrt(np.mean([getattr(item, name) ** 2 for item in told])))

    assert rms("command") == pytest.approx(0.0794, rel=0.05)
    assert rms("delayed_command") == pytest.approx(0.0100, rel=0.2)
    assert rms("fir") == pytest.approx(0.0050, rel=0.25)
    # On the clock of the command; 0.0076 where each logger's own clock is taken.
    assert rms("repeat") == pytest.approx(0.0050, rel=0.3)
