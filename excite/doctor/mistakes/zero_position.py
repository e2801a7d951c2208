"""Zeros of joint positions that are far from the model's."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import product

import numpy as np
import scipy

from excite.arrays import Array
from excite.doctor.doubt import Doubt
from excite.doctor.mistakes.mistake import Correction, Mistake, Samples
from excite.doctor.reading import Reading

# An encoder that is off by less is an effect that a diagnosis measures; that much no calibration leaves [rad].
_LEAST = 0.15
_STEP = np.pi / 12
# Controllers and models place their zeros along different links: quarter turns apart. So near it is one [rad].
_QUARTER, _NEAR_QUARTER = 0.5 * np.pi, 0.12
# Two zeros can be off at once and one alone bring nothing: joints this far apart are tried together.
_TOGETHER = 2
# What a coarse step has to bring before it is refined, half the logarithm of the residual's power over all joints.
_PROMISES = 0.2
# Zeros whose quarter turns change it by less are in no torque at all, but for rounding.
_QUARTERS, _FELT = np.array([0.0, 1.0, 2.0, 3.0]) * _QUARTER, 1e-6


class ZeroPosition(Mistake[Samples]):
    """Gravity, and what joints do to each other, tell where a joint really is."""

    name = "zero_position"
    of_posture = True
    leaves = frozenset({Doubt.POSITION})

    def __init__(self, together: int = _TOGETHER) -> None:
        """Joints at most so far apart along the chain are tried in pairs, too."""
        self._together = together

    def corrections(self, samples: Samples, reading: Reading) -> Iterable[Correction]:
        start = float(samples.left(reading).sum())
        turning = [j for j in range(len(samples.joints)) if not samples.slides(j)]
        felt = []
        for j in turning:
            by_zero = samples.by_zero(reading, j)
            found = self._best(samples, reading, j, start, by_zero)
            if found is not None:
                yield found
            # What an upright first axis turns to from is in no torque: as one of two its zero would come for nothing.
            if np.ptp(by_zero(_QUARTERS).sum(axis=1)) > _FELT:
                felt.append(j)
        for j, k in ((j, k) for j in felt for k in felt if 0 < k - j <= self._together):
            for a, b in product((1, -1, 2), repeat=2):
                moved = reading.with_position(j, zero=a * _QUARTER).with_position(k, zero=b * _QUARTER)
                yield self._said(samples, moved, {j: a * _QUARTER, k: b * _QUARTER})

    def _best(
        self, samples: Samples, reading: Reading, joint: int, start: float, by_zero: Callable[[Array], Array]
    ) -> Correction | None:
        def left(angle: float) -> float:
            return float(by_zero(np.array([angle])).sum())

        angles = np.asarray(np.arange(-11, 13) * _STEP, dtype=float)
        scores = by_zero(angles).sum(axis=1)
        best = float(angles[int(np.argmin(scores))])
        if start - scores.min() < _PROMISES or abs(best) < 0.5 * _STEP:
            return None
        best = float(
            scipy.optimize.minimize_scalar(
                left, bounds=(best - _STEP, best + _STEP), method="bounded", options={"xatol": 0.01}
            ).x
        )
        quarter = _QUARTER * round(best / _QUARTER)
        if quarter and abs(best - quarter) < _NEAR_QUARTER:
            best = quarter
        if abs(best) < _LEAST:
            return None
        return self._said(samples, reading.with_position(joint, zero=best), {joint: best})

    def _said(self, samples: Samples, reading: Reading, added: dict[int, float]) -> Correction:
        places = tuple(samples.joints[j] for j in added)
        exact = all(abs(angle / _QUARTER - round(angle / _QUARTER)) < 1e-9 for angle in added.values())
        moved = ", ".join(f"{np.degrees(angle):+.0f}° to {samples.joints[j]}" for j, angle in added.items())
        off = "quarter turns off" if exact else "off"
        text = f"zeros of positions look {off} the model's: add {moved}"
        figures = {f"add_{samples.joints[j]}_rad": float(angle) for j, angle in added.items()}
        return Correction(self.name, reading, text, places, figures, changes=len(added), certain=exact)
