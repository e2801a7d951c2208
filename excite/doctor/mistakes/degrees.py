"""Positions that were logged in degrees or revolutions instead of radians."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from excite.doctor.mistakes.mistake import Correction, Mistake, Samples
from excite.doctor.reading import Reading


class Degrees(Mistake[Samples]):
    """Joints turn 57 times further than they can."""

    name = "degrees"

    def corrections(self, samples: Samples, reading: Reading) -> Iterable[Correction]:
        if reading.unit == 1.0:
            text = "positions look like degrees; convert them to radians"
            yield Correction(self.name, replace(reading, unit=np.pi / 180.0), text, samples.joints)


class Revolutions(Mistake[Samples]):
    """Joints turn a sixth as far as their torques say: drives such as moteus and ODrive count turns."""

    name = "revolutions"

    def corrections(self, samples: Samples, reading: Reading) -> Iterable[Correction]:
        if reading.unit == 1.0:
            text = "positions look like revolutions; convert them to radians"
            yield Correction(self.name, replace(reading, unit=2.0 * np.pi), text, samples.joints)
