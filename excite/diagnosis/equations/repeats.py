"""Trials that run one command again, brought to the same clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial

# A lag of less than this share of a sample is none.
_NONE = 0.1
_ITERATIONS = 3


class Moving(Protocol):
    """Something that moves, on an even clock."""

    @property
    def time(self) -> Array:
        """``(n,)`` [s]."""

    @property
    def q(self) -> Array:
        """Positions ``(n, n_joints)`` [rad or m]."""

    @property
    def v(self) -> Array:
        """Velocities ``(n, n_joints)``."""


@dataclass(frozen=True)
class Repeat:
    """Two trials of one command.

    Attributes:
        first: index of the trial that is repeated.
        again: index of the one that repeats it.
        lag_s: how much later after its start the latter moves: loggers are started by hand [s].
    """

    first: int
    again: int
    lag_s: float


def find_repeats(trials: Sequence[ArmTrial], rate_hz: float) -> tuple[Repeat, ...]:
    """The pairs of trials that say that they repeat each other, with their lags.

    Args:
        trials: all trials.
        rate_hz: their rate [Hz].
    """
    names = [trial.name for trial in trials]
    pairs = [(names.index(t.repeats), k) for k, t in enumerate(trials) if t.repeats in names]
    return tuple(Repeat(i, k, estimate_lag(trials[i], trials[k], rate_hz)) for i, k in pairs)


def estimate_lag(first: Moving, again: Moving, rate_hz: float) -> float:
    """How much later the second moves: where the velocities of both correlate most [s].

    To a fraction of a sample by Gauss and Newton.
    """
    size = len(first.v) + len(again.v)
    spectra = [np.fft.rfft(trial.v, size, axis=0) for trial in (first, again)]
    products = np.fft.irfft(spectra[0].conj() * spectra[1], size, axis=0).sum(axis=1)
    shift = int(np.argmax(products))
    lag = float(shift if shift < len(again.v) else shift - size) / rate_hz
    for _ in range(_ITERATIONS):
        inside = (first.time + lag >= again.time[0]) & (first.time + lag <= again.time[-1])
        there = first.time[inside] + lag
        q, v = (
            np.column_stack([np.interp(there, again.time, x) for x in signal.T])
            for signal in (again.q, again.v)
        )
        lag += float(((first.q[inside] - q) * v).sum() / max(float((v**2).sum()), 1e-300))
    return lag if abs(lag) > _NONE / rate_hz else 0.0


def align_repeat(repeat: Repeat, trials: Sequence[ArmTrial], values: Sequence[Array]) -> Array:
    """Rows of both trials at the same instants of the command, ``(2, n_joints, n)``.

    Args:
        repeat: the pair.
        trials: all trials.
        values: of each trial, ``(n_joints, n_rows)``.

    Returns:
        The first's rows that the other has as well, and the other's between its own rows where there is a lag.
    """
    here, there = trials[repeat.first], trials[repeat.again]
    asked, known = here.time[here.rows], there.time[there.rows] - repeat.lag_s
    if np.array_equal(asked, known):
        return np.array([values[repeat.first], values[repeat.again]])
    from scipy.interpolate import CubicSpline

    both = (asked >= known[0] - 1e-9) & (asked <= known[-1] + 1e-9)
    again = CubicSpline(known, values[repeat.again], axis=1)(asked[both])
    return np.array([values[repeat.first][:, both], again])
