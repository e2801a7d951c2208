"""Trials that have the same command, and by how much what was measured in them differs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.repeats import Moving, lag_of

# Commands are the same where their difference is less than this share of their deviation, every joint taken together.
# Ten runs of one program on a walking robot, whose logger and program kept clocks of their own, differ by 0.03.
_SAME = 0.05
# Trials whose commands' means, deviations and speeds differ by more than this share of them are not looked at closer.
_LOOK = 0.1
# So many pairs tell what a repeat is worth; so many are looked at, on so many samples: a few milliseconds each.
_PAIRS, _LOOKS, _SAMPLES = 40, 200, 4000
# What two trials must share of the shorter one.
_SHARED = 0.8


class Commanded(Moving, Protocol):
    """A trial that may repeat another."""

    @property
    def name(self) -> str:
        """Stem of its file."""

    @property
    def repeats(self) -> str | None:
        """Name of the trial that it says it repeats."""


@dataclass(frozen=True)
class Alike:
    """Two trials of one command.

    Attributes:
        first: index of one.
        again: index of the other.
        lag_s: how much later the other runs it [s].
    """

    first: int
    again: int
    lag_s: float


@dataclass(frozen=True, eq=False)
class _Thinned:
    """Some samples of something that moves."""

    time: Array
    q: Array
    v: Array


def alike(trials: Sequence[Commanded]) -> tuple[Alike, ...]:
    """Pairs of trials that say that they repeat each other, or whose commands do."""
    if not trials:
        return ()
    rate = 1.0 / float(np.median(np.diff(trials[0].time)))
    step = max(1, max(len(t.time) for t in trials) // _SAMPLES)
    few = [_Thinned(t.time[::step], t.q[::step], t.v[::step]) for t in trials]
    apart = _apart(few)
    stated = {
        (i, k)
        for i, k in combinations(range(len(trials)), 2)
        if trials[i].name == trials[k].repeats or trials[k].name == trials[i].repeats
    }
    near = (
        pair for pair in combinations(range(len(trials)), 2) if apart[pair] <= _LOOK and pair not in stated
    )
    looked = [*sorted(stated), *sorted(near, key=lambda pair: float(apart[pair]))[:_LOOKS]]
    found: list[Alike] = []
    for i, k in looked:
        if (i, k) in stated or _same(few[i], few[k], lag_of(few[i], few[k], rate / step)):
            found.append(Alike(i, k, lag_of(trials[i], trials[k], rate)))
        if len(found) == _PAIRS:
            break
    return tuple(found)


def _apart(trials: Sequence[Moving]) -> Array:
    """Largest difference of what does not depend on when a logger was started, ``(n_trials, n_trials)``."""
    mean, spread, speed = (
        np.array([f(t) for t in trials])
        for f in (
            lambda t: t.q.mean(axis=0),
            lambda t: t.q.std(axis=0),
            lambda t: t.v.std(axis=0),
        )
    )

    def off(values: Array, scale: Array) -> Array:
        difference = np.abs(values[:, None] - values[None]).sum(axis=2)
        whole = scale.sum(axis=1)
        return np.asarray(difference / np.maximum(np.maximum(whole[:, None], whole[None]), 1e-300))

    return np.maximum(off(mean, spread), np.maximum(off(spread, spread), off(speed, speed)))


def _same(one: Moving, other: Moving, lag: float) -> bool:
    """Whether two commands are one."""
    here = _shared(one.time, other.time, lag)
    if here.sum() < _SHARED * min(len(one.time), len(other.time)):
        return False
    difference = one.q[here] - moved(other.time, other.q, one.time[here] + lag)
    scale = one.q[here].std(axis=0)
    return bool((difference**2).mean() < _SAME**2 * (scale**2).mean())


def _shared(time: Array, other: Array, lag: float) -> NDArray[np.bool_]:
    """Which instants both have, ``(n,)``."""
    return (time + lag >= other[0] - 1e-9) & (time + lag <= other[-1] + 1e-9)


def moved(time: Array, values: Array, instants: Array) -> Array:
    """Values ``(n, k)`` at other instants ``(m,)``, ``(m, k)``."""
    return np.column_stack([np.interp(instants, time, column) for column in values.T])


def difference(
    pair: Alike,
    times: Sequence[Array],
    values: Sequence[Array],
    rows: Sequence[NDArray[np.bool_]] | None = None,
) -> Array:
    """What two trials measured differently at the same instants of their command, ``(m, n_channels)``.

    Args:
        pair: the two.
        times: ``(n,)`` of every trial [s].
        values: ``(n, n_channels)`` of every trial.
        rows: which samples of each trial count, ``(n,)`` each; by default all.
    """
    here = _shared(times[pair.first], times[pair.again], pair.lag_s)
    if rows is not None:
        here = here & rows[pair.first]
    other = moved(times[pair.again], values[pair.again], times[pair.first][here] + pair.lag_s)
    return values[pair.first][here] - other


def turned(pair: Alike) -> Alike:
    """The same pair, seen from the other."""
    return Alike(pair.again, pair.first, -pair.lag_s)
