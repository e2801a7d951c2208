"""Gravity that points elsewhere than the log says: a robot on a wall, under a ceiling, or a sign."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.doctor.doubt import Doubt
from excite.doctor.mistakes.mistake import Correction, Mistake, Samples
from excite.doctor.reading import Reading

_G = 9.81
# A base that is tilted by less is an effect that a diagnosis measures; a table is not that crooked [rad].
_LEAST = 0.15
# So near an axis it is along it [rad].
_ALONG = 0.1
_STEPS = (0.4, 0.2, 0.1, 0.05, 0.025)


class Gravity(Mistake[Samples]):
    """The direction in which gravity explains the torques best."""

    name = "gravity"
    leaves = frozenset({Doubt.GRAVITY})

    def corrections(self, samples: Samples, reading: Reading) -> Iterable[Correction]:
        axes = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]

        by_gravity = samples.by_gravity(reading)

        def best_of(directions: list[Array]) -> tuple[float, Array]:
            scores = by_gravity(_G * np.array(directions)).sum(axis=1)
            best = int(np.argmin(scores))
            return float(scores[best]), directions[best]

        stated = reading.gravity / max(float(np.linalg.norm(reading.gravity)), 1e-12)
        score, best = best_of([stated, *axes])
        for step in _STEPS if best.any() else ():
            found = best_of(_around(best, step))
            if found[0] < score:
                score, best = found
        angle = float(np.arccos(np.clip(best @ stated, -1.0, 1.0)))
        if angle < _LEAST or not best.any():
            return
        nearest = max(axes, key=lambda axis: float(axis @ best))
        along = float(np.arccos(np.clip(nearest @ best, -1.0, 1.0))) < _ALONG
        if along:
            best = nearest
        x, y, z = (float(value) + 0.0 for value in np.round(_G * best, 12))
        off = f"looks {np.degrees(angle):.0f}° off what" if stated.any() else "is not nought as"
        text = f"gravity {off} the log says: write [{x:.2f}, {y:.2f}, {z:.2f}]"
        figures = {"angle_rad": angle, "x": x, "y": y, "z": z}
        yield Correction(
            self.name, replace(reading, gravity=_G * best), text, ("gravity",), figures, certain=along
        )


def _around(direction: Array, step: float) -> list[Array]:
    """Directions about one, at an angle [rad]."""
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first = first / np.linalg.norm(first)
    second = np.cross(direction, first)
    turned = [
        np.cos(step) * direction + np.sin(step) * (np.cos(t) * first + np.sin(t) * second)
        for t in np.arange(8) * np.pi / 4
    ]
    return [value / np.linalg.norm(value) for value in turned]
