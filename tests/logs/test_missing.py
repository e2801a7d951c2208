"""Rows that are missing are counted, jitter of stamps is not: against rows taken away from clocks of several kinds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from excite.logs.sampling import missing_rows

PERIOD = 0.005
N = 2750


def clock(kind: str, size: float, n: int, rng: np.random.Generator) -> np.ndarray:
    """Errors of stamps, in periods, whose standard deviation (of steps for ``wandering``) is ``size``."""
    return {
        "uniform": lambda: np.sqrt(3.0) * size * rng.uniform(-1.0, 1.0, n),
        "normal": lambda: size * rng.standard_normal(n),
        "late": lambda: rng.exponential(size, n),
        "wandering": lambda: np.cumsum(size * rng.standard_normal(n)),
    }[kind]()


def stamps(kind: str, size: float, lost: int, seed: int) -> np.ndarray:
    """Stamps in order, of a clock that is not quite as fast as it says, with that many rows taken away."""
    rng = np.random.default_rng(seed)
    n = N + lost
    time = PERIOD * 1.0004 * np.arange(n) + PERIOD * clock(kind, size, n, rng)
    gone = rng.choice(np.arange(20, n - 20), lost, replace=False)
    return np.unique(np.delete(time, gone))


KINDS = ("uniform", "normal", "late", "wandering")


@settings(max_examples=60, deadline=None)
@given(kind=st.sampled_from(KINDS), size=st.floats(0.0, 0.25), seed=st.integers(0, 2**32 - 1))
def test_jitter_alone_is_no_missing_row(kind: str, size: float, seed: int) -> None:
    found = int(missing_rows(stamps(kind, size, 0, seed)).sum())
    # Of some thousand steps of a clock that wanders, or hesitates often, a rare one is itself as long as two.
    assert found <= (size > 0.06 and kind in {"wandering", "late"})


@settings(max_examples=40, deadline=None)
@given(
    kind=st.sampled_from(KINDS),
    size=st.floats(0.0, 0.08),
    lost=st.integers(0, 60),
    seed=st.integers(0, 2**32 - 1),
)
@example(kind="late", size=0.078125, lost=2, seed=0)
@example(kind="late", size=0.08, lost=3, seed=37)
def test_under_slight_jitter_every_missing_row_is_counted(
    kind: str, size: float, lost: int, seed: int
) -> None:
    time = stamps(kind, size, lost, seed)
    assert abs(int(missing_rows(time).sum()) - lost) <= (size > 0.04)


@pytest.mark.parametrize("kind", ["uniform", "normal", "late"])
@pytest.mark.parametrize("size", [0.14, 0.2, 0.25])
def test_under_jitter_of_single_stamps_they_are_counted_nearly(kind: str, size: float) -> None:
    """At the largest of these, one step in six is as long as one and a half."""
    wrong = [int(missing_rows(stamps(kind, size, 15, seed)).sum()) - 15 for seed in range(20)]
    assert np.abs(wrong).max() <= 2
    assert abs(np.mean(wrong)) < 0.5


def test_long_gaps_and_neighbouring_ones() -> None:
    time = np.delete(PERIOD * np.arange(1000), [100, 101, 102, 300, 302, 304, *range(600, 700)])
    found = missing_rows(time)
    assert found.sum() == 106
    assert found[99] == 3 and found.max() == 100


def test_rows_that_waited_and_came_in_a_burst_are_not_missing() -> None:
    time = PERIOD * np.arange(1000)
    # Kept waiting until the sixth is there: stamped one after the other.
    for first in (200, 400, 401, 800):
        time[first : first + 6] = time[first + 5] + 1e-5 * np.arange(6)
    assert missing_rows(np.unique(time)).sum() <= 1
    time = PERIOD * np.arange(1000)
    time[[50, 500]] += 0.9 * PERIOD
    assert missing_rows(time).sum() == 0


def test_a_loop_that_is_held_up_for_part_of_a_period_misses_nothing_but_its_gaps() -> None:
    """Steps of a computer that shares its time: most as long as asked, some up to twice that, all values between."""
    rng = np.random.default_rng(4)
    step = 1.0 + 0.05 * rng.standard_normal(4000)
    held = rng.random(4000) < 0.15
    step[held] += rng.triangular(0.0, 0.0, 0.95, int(held.sum()))
    assert np.sum(step > 1.5) > 20
    step[2000] += 8.0
    assert missing_rows(0.001 * np.cumsum(step)).sum() == 8
