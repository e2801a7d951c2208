"""A clock that runs too fast or too slow."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import scipy

from excite.doctor.doubt import Doubt
from excite.doctor.mistakes.mistake import Correction, Mistake
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples

# Inertias off by some tenths look like a clock off by half as much: less is not told by the torques.
_LEAST = 1.12
_TICKS = np.geomspace(0.1, 10.0, 41)
# A best clock this near to the slowest that is tried asks for a slower one still: inertial forces are not there at all.
_NEVER = 0.9 * _TICKS[-1]


class Clock(Mistake[TorqueSamples]):
    """Weights do not know the clock, inertial forces do: they grow with its square.

    Torques that lack inertial forces, or have too many, need not be a clock's: commands of gravity compensation and
    wrong inertias look alike. So the clock is put right where a second witness, the rate that the log states, says the
    same; where none does, or logged velocities agree with the stamps, it is asked for.
    """

    name = "clock"
    leaves = frozenset({Doubt.CLOCK})

    def corrections(self, samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
        # Without weight nothing stays while the clock changes.
        if reading.tick != 1.0 or reading.weightless:
            return

        by_clock = samples.by_clock(reading)

        def left(log_tick: float) -> float:
            return float(by_clock(float(np.exp(log_tick))).sum())

        grid = np.log(_TICKS)
        scores = [left(value) for value in grid]
        k = int(np.argmin(scores))
        # About the stamps' own clock, a step of the grid is what the torques do not tell.
        if k == len(grid) // 2:
            return
        low, high = grid[max(0, k - 1)], grid[min(len(grid) - 1, k + 1)]
        best = float(
            np.exp(
                scipy.optimize.minimize_scalar(
                    left, bounds=(low, high), method="bounded", options={"xatol": 0.003}
                ).x
            )
        )
        if 1.0 / _LEAST < best < _LEAST:
            return
        which = "fast" if best < 1.0 else "slow"
        text = f"the clock looks {which}: a second of the stamps is {best:.3g} s by the torques"
        stated = samples.rate_hz / samples.stated_hz
        if 1.0 / _LEAST < best / stated < _LEAST and not samples.speeds:
            text += f", {stated:.4g} s by rate_hz"
            yield Correction(self.name, replace(reading, tick=stated), text, ("time",), {"tick": stated})
            return
        ask = (
            f"the stamps are believed; if they are wrong, scale them (scale: {{time: {best:.3g}}} in map.yaml) and "
            "correct rate_hz; if the torques are commands, leave them out (log: {torque: none})"
        )
        but = (
            "logged velocities agree with the stamps, and a controller's commands or wrong lengths look so, too"
            if samples.speeds
            else "nothing but the torques says so, and wrong inertias or lengths or commands look so, too"
        )
        text = f"{text}; {but}"
        if best > _NEVER:
            text = (
                "the torques carry weight alone, and none of the inertial forces of this motion: what moves the robot "
                "is not in them, as where a person guides it by hand, or they are a gravity compensation's commands"
            )
            ask = (
                "record motion under the robot's own controller, with measured torques; if these are commands, leave "
                "them out (log: {torque: none})"
            )
        yield Correction(
            self.name,
            replace(reading, tick=best),
            text,
            ("time",),
            {"tick": best},
            ask=ask,
            as_logged=lambda read: replace(read, tick=1.0),
            certain=False,
        )
