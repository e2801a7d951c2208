"""What closed-loop roll-outs say of effects."""

from __future__ import annotations

import numpy as np
import pytest

from excite.diagnosis.answer.gap import ChannelGap, Gap
from excite.diagnosis.servo.diagnose import is_confirmed
from excite.diagnosis.servo.servo import measure_rollout_agreement

SHAPE = (8, 400, 3)


def unmoved() -> Gap:
    """A gap that the effects take nothing of."""
    return Gap(1.0, 1.0, 0.0, 0.0, {"joint1": ChannelGap(1.0, 1.0, 0.0, "rad")})


def rough(rng: np.random.Generator) -> np.ndarray:
    """Errors that are slow, as those of roll-outs are."""
    return np.cumsum(rng.standard_normal(SHAPE), axis=1) / 20.0


def test_a_small_change_that_goes_the_right_way_counts():
    """Three parts in a hundred of the error's power: too little to be seen in what is left."""
    rng = np.random.default_rng(0)
    effect, rest = 0.2 * rough(rng), rough(rng)
    said = measure_rollout_agreement(rest - effect, rest)
    assert said.slope == pytest.approx(1.0, abs=3.0 * said.error)
    assert not said.is_contradicting
    assert is_confirmed(unmoved(), said)


def test_a_change_that_has_nothing_to_do_with_the_error_speaks_against_it():
    rng = np.random.default_rng(1)
    error = rough(rng)
    said = measure_rollout_agreement(error, error + rough(rng))
    assert abs(said.slope) < 4.0 * said.error
    assert said.is_contradicting
    assert not is_confirmed(unmoved(), said)


def test_a_change_the_wrong_way_speaks_against_it():
    error = rough(np.random.default_rng(2))
    assert measure_rollout_agreement(error, 1.5 * error).slope == pytest.approx(-2.0)
    assert measure_rollout_agreement(error, 1.5 * error).is_contradicting


def test_what_is_lost_in_the_error_or_gets_nowhere_says_nothing():
    rng = np.random.default_rng(3)
    error = rough(rng)
    assert not measure_rollout_agreement(error, error + 0.01 * rough(rng)).is_contradicting
    assert not measure_rollout_agreement(error, error + 100.0 * rough(rng)).is_contradicting
    wild = error.copy()
    wild[0, -1] = np.nan
    assert not measure_rollout_agreement(error, wild).is_contradicting
    assert not measure_rollout_agreement(error, error).is_contradicting


def test_joints_are_weighed_by_their_own_errors():
    """A joint that swings widely for reasons of its own does not drown one that the effect puts right."""
    rng = np.random.default_rng(4)
    before = rough(rng)
    before[..., 2] *= 1000.0
    after = before.copy()
    after[..., 0] *= 0.1
    said = measure_rollout_agreement(before, after)
    assert said.slope == pytest.approx(1.0 / 0.9, rel=1e-6)
    assert not said.is_contradicting


def test_slow_errors_do_not_drown_a_quick_change_that_is_right():
    """A soft gear rings at 5 Hz; friction's slow errors are ten times that, and a refit adds slow ones of its own."""
    rng = np.random.default_rng(5)
    time = np.arange(SHAPE[1]) / 200.0
    rings = np.sin(2.0 * np.pi * 5.0 * time[:, None] + rng.uniform(0.0, 6.0, (8, 1, 3)))
    slow, refit = (np.sin(2.0 * np.pi * 0.4 * time[:, None] + rng.uniform(0.0, 6.0, (8, 1, 3))) for _ in "ab")
    noise = 0.02 * rng.standard_normal(SHAPE)
    before = slow - 0.1 * rings + noise
    said = measure_rollout_agreement(before, before + 0.1 * rings + 0.2 * refit)
    assert said.slope > 0.5
    assert not said.is_contradicting
    # What rings without being in the record is against it.
    assert measure_rollout_agreement(slow + noise, slow + noise + 0.1 * rings + 0.2 * refit).is_contradicting


def test_what_is_beyond_the_band_that_effects_were_fitted_in_does_not_count():
    """The record is filtered; a simulation shakes at its start."""
    rng = np.random.default_rng(6)
    effect, rest = 0.5 * rough(rng), rough(rng)
    effect, rest = (
        np.apply_along_axis(np.convolve, 1, x, np.ones(20) / 20.0, "same") for x in (effect, rest)
    )
    shakes = 0.05 * np.sin(2.0 * np.pi * 80.0 * np.arange(SHAPE[1]) / 200.0)[:, None]
    before, after = rest - effect, rest + shakes
    assert measure_rollout_agreement(before, after, 0.1).slope == pytest.approx(1.0, abs=0.1)
    assert measure_rollout_agreement(before, after, 1.0).slope < 0.5
