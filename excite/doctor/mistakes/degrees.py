"""Positions that were logged in degrees or revolutions instead of radians."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from excite.doctor.mistakes.mistake import Correction, Mistake, Samples
from excite.doctor.reading import Reading


class Degrees(Mistake[Samples]):
    """Joints turn 57 times further than they can."""

    name = "degrees"
    of_posture = True

    def corrections(self, samples: Samples, reading: Reading) -> Iterable[Correction]:
        text = "positions look like degrees; convert them to radians"
        yield from _in_unit(self.name, samples, reading, np.pi / 180.0, text)


class Revolutions(Mistake[Samples]):
    """Joints turn a sixth as far as their torques say: drives such as moteus and ODrive count turns."""

    name = "revolutions"
    of_posture = True

    def corrections(self, samples: Samples, reading: Reading) -> Iterable[Correction]:
        text = "positions look like revolutions; convert them to radians"
        yield from _in_unit(self.name, samples, reading, 2.0 * np.pi, text)


def _in_unit(kind: str, samples: Samples, reading: Reading, unit: float, text: str) -> Iterable[Correction]:
    """All joints that turn in another unit, where none of them is yet."""
    slides = [samples.slides(joint) for joint in range(len(samples.joints))]
    turning = tuple(name for name, slide in zip(samples.joints, slides, strict=True) if not slide)
    if turning and (reading.unit == 1.0).all():
        yield Correction(kind, reading.in_units(unit, slides), text, turning)
