"""Logs of commands alone: what encoders' steps leave after the filter, and that a gap within it is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.answer.gap import ChannelGap, Gap
from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.servo.diagnose import joints_above_noise
from excite.diagnosis.servo.servo import position_floor
from excite.logs.files import load_log, save_log
from excite.logs.log import Trial
from excite.logs.robot import nominal_robot
from excite.logs.signals.butterworth import lowpass
from tests.diagnosis.encoder_leg import leg_log
from tests.diagnosis.two_joints import two_joint_log

RATE, SECONDS, BAND_HZ = 200.0, 20.0, 30.0
TIME = np.arange(round(RATE * SECONDS)) / RATE


def motion(speed: float, rests: bool, seed: int) -> np.ndarray:
    """Two joints that swing [rad], by about ``speed`` [rad/s], and stand half of the time where they rest."""
    rng = np.random.default_rng(seed)
    clock = np.cumsum(np.sin(2.0 * np.pi * 0.2 * TIME) > 0.0) / RATE if rests else TIME
    q = np.sin(2.0 * np.pi * rng.uniform(0.3, 1.0, (3, 2)) * clock[:, None, None] + rng.uniform(0, 6, (3, 2)))
    return np.asarray(q.sum(axis=1) * speed / np.gradient(q.sum(axis=1), 1.0 / RATE, axis=0).std())


def floor_of(folder: Path, positions: list[np.ndarray], repeats: str | None = None) -> np.ndarray:
    """The floor of a log of these positions, through its files."""
    trials = [
        Trial(f"t{k}", "identification", TIME, q, tau=1.0 + q, q_cmd=q) for k, q in enumerate(positions)
    ]
    if repeats:
        trials[1] = replace(trials[1], repeats=repeats)
    made = two_joint_log(tuple(trials))
    entries = [entry.model_copy(update={"repeats": None}) for entry in made.header.trials]
    if repeats:
        entries[1] = entries[1].model_copy(update={"repeats": f"{repeats}.parquet"})
    header = made.header.model_copy(update={"trials": tuple(entries)})
    log = load_log(save_log(replace(made, header=header), folder))
    samples = arm_samples(nominal_robot(log), log, log.trials)
    return position_floor(samples, {t.name: t for t in log.trials}, log.header.joints)


@pytest.mark.parametrize("rests", [False, True])
@pytest.mark.parametrize("speed", [0.003, 0.03, 1.0])
@pytest.mark.parametrize("bits", [12, 15])
def test_the_floor_is_what_an_encoders_steps_leave_after_the_filter(
    bits: int, speed: float, rests: bool, tmp_path: Path
) -> None:
    """Much where a joint creeps or rests; of one that moves, the share that the filter lets by."""
    step = 2.0 * np.pi / 2**bits
    true = [motion(speed, rests, seed) for seed in range(6)]
    read = [step * np.round(q / step) for q in true]
    left = np.sqrt(
        np.mean(
            [
                (lowpass(r, RATE, BAND_HZ) - lowpass(q, RATE, BAND_HZ)) ** 2
                for r, q in zip(read, true, strict=True)
            ]
        )
    )
    assert np.sqrt(np.mean(floor_of(tmp_path / "log", read) ** 2)) == pytest.approx(left, rel=0.25)


def test_noise_that_hides_the_steps_is_the_floor(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    noise = [1e-3 * rng.standard_normal((len(TIME), 2)) for _ in range(3)]
    left = np.sqrt(np.mean([lowpass(e, RATE, BAND_HZ) ** 2 for e in noise]))
    floor = floor_of(tmp_path / "log", [motion(1.0, False, k) + e for k, e in enumerate(noise)])
    assert floor == pytest.approx(np.full(2, left), rel=0.1)


def test_repeats_that_read_the_same_numbers_do_not_undo_the_encoders_steps(tmp_path: Path) -> None:
    """And what differs between them raises the floor, although it is slow."""
    step = 2.0 * np.pi / 2**12
    read = step * np.round(motion(1.0, False, 0) / step)
    alone = floor_of(tmp_path / "a", [read])
    assert floor_of(tmp_path / "b", [read, read.copy()], "t0") == pytest.approx(alone, rel=0.05)
    drifted = read + 0.01 * np.sin(2.0 * np.pi * 0.1 * TIME)[:, None]
    assert floor_of(tmp_path / "c", [read, drifted], "t0") == pytest.approx(np.full(2, 0.005), rel=0.2)


def test_only_what_stands_above_the_noise_of_positions_is_unexplained() -> None:
    channels = {"hip": ChannelGap(3.0, 3.0, 2.5, "rad"), "knee": ChannelGap(3.0, 3.0, 1.0, "rad")}
    gap = Gap(3.0, 3.0, 2.0, 0.0, channels)
    assert joints_above_noise(("hip", "knee", "ankle"), gap) == ("knee",)


def test_a_leg_that_its_model_explains_has_no_gap(tmp_path: Path) -> None:
    """Encoders of 15 bits, five decimals, a stiff servo, slow motion: a gap without a name was said to be there."""
    log = leg_log(tmp_path / "log")
    found = diagnose(log, None)
    assert found.verdict == "none", found.summary()
    # An encoder's step of 1.92e-4 rad, of whose noise a filter to 30 of 250 Hz lets a third by.
    for channel in found.gap.per_channel.values():
        assert 1e-5 < channel.noise_floor < 2.5e-5
        assert channel.before < 1.5 * channel.noise_floor
