"""Positions that were logged in degrees instead of radians."""

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
