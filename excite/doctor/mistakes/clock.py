"""A clock that runs too fast or too slow."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from excite.doctor.doubt import Doubt
from excite.doctor.mistakes.mistake import Correction, Mistake
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples

# Inertias off by some tenths look like a clock off by half as much: less is not told by the torques.
_LEAST = 1.12
_TICKS = np.geomspace(0.1, 10.0, 41)


class Clock(Mistake[TorqueSamples]):
    """Weights do not know the clock, inertial forces do: they grow with its square."""

    name = "clock"
    leaves = frozenset({Doubt.CLOCK})

    def corrections(self, samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
        if reading.tick != 1.0:
            return

        by_clock = samples.by_clock(reading)

        def left(log_tick: float) -> float:
            return float(by_clock(float(np.exp(log_tick))).sum())

        grid = np.log(_TICKS)
        scores = [left(value) for value in grid]
        k = int(np.argmin(scores))
        low, high = grid[max(0, k - 1)], grid[min(len(grid) - 1, k + 1)]
        best = float(
            np.exp(minimize_scalar(left, bounds=(low, high), method="bounded", options={"xatol": 0.003}).x)
        )
        if 1.0 / _LEAST < best < _LEAST:
            return
        which = "fast" if best < 1.0 else "slow"
        text = f"the clock looks {which}: a second of the stamps is {best:.3g} s by the torques"
        yield Correction(
            self.name, replace(reading, tick=best), text, ("time",), {"tick": best}, certain=False
        )
