"""Torques that were logged long after, or before, the positions that they belong to."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import scipy

from excite.doctor.doubt import Doubt
from excite.doctor.mistakes.mistake import Correction, Mistake, Samples
from excite.doctor.reading import OWN_SHARE, Reading

# Buses are late by up to 20 ms or so, and logged commands early by a drive's lag, some 50 ms where it is slow: a
# diagnosis names these ``time_delay`` and ``actuator_lag``. What is later or earlier comes from another computer's
# clock, or from columns that were put together wrongly [s].
_LATE_S, _EARLY_S = 0.03, 0.08
_GRID_S = np.arange(-25, 26) * 0.02
# Files of two loggers whose clocks began at zero differ by what a person takes to start the second one [s]. A motion
# that repeats itself agrees one period later, too: at every joint that tells 0.35 nat more have to go. Of a UR10 whose
# torques were logged from 1.5 s on 4.1 nats go at three joints.
_FAR_S, _FAR_NATS = np.arange(-50, 51) * 0.1, 0.35


class TorqueLate(Mistake[Samples]):
    """The shift at which the torques agree with the motion."""

    name = "torque_late"
    leaves = frozenset({Doubt.DELAY})

    def corrections(self, samples: Samples, reading: Reading) -> Iterable[Correction]:
        if reading.late_s != 0.0:
            return

        # Friction that builds up over a way after each reversal looks late, too; weights and inertia do not.
        tells = samples.tells(reading)
        if not tells.any():
            return

        def left(late: float) -> float:
            return float(samples.left(replace(reading, late_s=float(late)))[tells].sum())

        scores = [left(late) for late in _GRID_S]
        best, around = float(_GRID_S[int(np.argmin(scores))]), 0.02
        shortest = float((samples.last - samples.first).min()) / samples.rate_hz
        seconds = _FAR_S[np.abs(_FAR_S) + 0.1 <= (1.0 - OWN_SHARE) * shortest]
        far = [left(late) for late in seconds]
        if far and min(far) < min(scores) - _FAR_NATS * float(tells.sum()):
            best, around = float(seconds[int(np.argmin(far))]), 0.1
        bounds = (best - around, best + around)
        if -_EARLY_S < bounds[0] and bounds[1] < _LATE_S:
            return
        best = float(
            scipy.optimize.minimize_scalar(left, bounds=bounds, method="bounded", options={"xatol": 5e-4}).x
        )
        if -_EARLY_S < best < _LATE_S:
            return
        which = "late" if best > 0.0 else "early"
        text = f"{samples.measured_name} look {1e3 * abs(best):.0f} ms {which} beside the positions"
        yield Correction(
            self.name,
            replace(reading, late_s=best),
            text,
            (samples.measured_name,),
            {"late_s": best},
            certain=False,
        )
