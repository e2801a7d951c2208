"""What may not change what a record says: late torques, another joint's constant, what judging trials alone have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.diagnose import diagnose
from excite.logs.files import load_log, save_log
from excite.logs.log import Log, Trial
from tests.diagnosis.two_joints import moved, two_joint_log

ROLES = dict.fromkeys("abc", "identification") | {"d": "validation"}
GAIN = 1.15


def arm(gain: float = 1.0) -> tuple[Trial, ...]:
    """Trials of an arm whose second channel reads its torque larger by a factor."""
    rng = np.random.default_rng(7)
    trials = (moved(name, role, 12.0, rng, np.eye(2)) for name, role in ROLES.items())
    return tuple(replace(t, tau=t.tau * [1.0, gain]) for t in trials)


def said(trials: tuple[Trial, ...], folder: Path, modelled: tuple[str, ...]) -> Diagnosis:
    return diagnose(load_log(save_log(two_joint_log(trials, modelled=list(modelled)), folder)))


FIXED = ("rigid_body_fixed", "viscous_friction", "coulomb_friction")


def names(found: Diagnosis) -> set[tuple[str, str | None]]:
    return {(item.effect, item.location) for item in found.effects}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """With a gain of the second channel."""
    return said(arm(GAIN), tmp_path_factory.mktemp("plain"), FIXED)


def test_a_gain_is_named_with_one_deviation_wherever_it_is_told(plain: Diagnosis) -> None:
    item = next(e for e in plain.effects if (e.effect, e.location) == ("torque_gain", "second"))
    gain, error = item.parameters["gain"], item.parameters["gain_error"]
    assert error.value == pytest.approx(GAIN - 1.0, abs=0.02)
    assert gain.value == pytest.approx(1.0 + error.value)
    assert gain.std == error.std
    assert f"± {gain.std:.1g}" in plain.sentence()


def test_a_floor_does_not_move_with_the_torques(plain: Diagnosis, tmp_path: Path) -> None:
    late = tuple(replace(t, tau=np.vstack([t.tau[:3], t.tau[:-3]])) for t in arm(GAIN))
    _alike(plain, said(late, tmp_path, FIXED))


def test_a_floor_does_not_move_with_another_joints_constant(plain: Diagnosis, tmp_path: Path) -> None:
    off = tuple(replace(t, tau=t.tau + np.array([2.0, 0.0])) for t in arm(GAIN))
    found = said(off, tmp_path, FIXED)
    _alike(plain, found)
    assert names(plain) <= names(found)


def _alike(one: Diagnosis, other: Diagnosis) -> None:
    for name, channel in one.gap.per_channel.items():
        assert other.gap.per_channel[name].noise_floor == pytest.approx(channel.noise_floor, rel=0.2)


def test_what_the_judging_trials_alone_have_changes_no_name(plain: Diagnosis, tmp_path: Path) -> None:
    trials = tuple(
        replace(t, tau=t.tau + np.array([20.0, 0.0])) if t.role == "validation" else t for t in arm(GAIN)
    )
    found = said(trials, tmp_path, FIXED)
    assert names(found) <= names(plain)
    assert ("torque_gain", "second") in names(found)


def test_what_is_clear_at_its_own_joint_is_named_beside_what_has_no_name(tmp_path: Path) -> None:
    """A wave of each trial's own at the first joint, which no effect follows, weighs more than a constant elsewhere."""
    rng, trials = np.random.default_rng(3), []
    for t in arm():
        wave = 8.0 * np.sin(2.0 * np.pi * rng.uniform(0.5, 3.0) * t.time + rng.uniform(0.0, 6.0))
        trials.append(replace(t, tau=t.tau + np.column_stack([wave, np.full_like(wave, 0.2)])))
    found = said(tuple(trials), tmp_path, FIXED)
    assert found.verdict == "unknown" and found.location == "first" and found.effect is None
    assert names(found) == {("torque_bias", "second")}
    sentence = found.sentence()
    assert "torque bias at second" in sentence and "gap at first" in sentence and "no effect" in sentence
    assert found.gap.per_channel["second"].after < 0.5 * found.gap.per_channel["second"].before


@pytest.mark.slow
def test_late_torques_are_no_soft_gear(tmp_path: Path) -> None:
    """A delay acts on all joints: it is weighed against elasticities at each."""
    late = tuple(replace(t, tau=np.vstack([t.tau[:3], t.tau[:-3]])) for t in arm())
    found = said(late, tmp_path, ("rigid_body", "viscous_friction", "coulomb_friction"))
    assert names(found) == {("time_delay", "torque")}


def coarse(trials: tuple[Trial, ...], sigma: float) -> tuple[Trial, ...]:
    """Every fourth row, 50 Hz, with noise on the positions [rad]."""
    rng = np.random.default_rng(11)
    return tuple(
        replace(t, time=t.time[::4], q=t.q[::4] + sigma * rng.normal(size=t.q[::4].shape), tau=t.tau[::4])
        for t in trials
    )


def test_noise_of_coarse_encoders_in_a_slow_record_is_no_gap(tmp_path: Path) -> None:
    words = ["rigid_body", "viscous_friction", "coulomb_friction"]
    log: Log = two_joint_log(coarse(arm(), 1e-3), modelled=words, rate_hz=50)
    found = diagnose(load_log(save_log(log, tmp_path)))
    assert found.verdict == "none"
    # What noise of the positions makes of the torques is far above the torques' own.
    assert all(channel.noise_floor > 0.0 for channel in found.gap.per_channel.values())
