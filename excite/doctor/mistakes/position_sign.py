"""Joints whose position counts the other way."""

from __future__ import annotations

from collections.abc import Iterable

from excite.doctor.mistakes.mistake import Correction, Mistake, Samples
from excite.doctor.reading import Reading


class PositionSign(Mistake[Samples]):
    """A joint's position has its sign turned, its torque has not."""

    name = "position_sign"
    of_posture = True

    def corrections(self, samples: Samples, reading: Reading) -> Iterable[Correction]:
        for j, joint in enumerate(samples.joints):
            text = f"the sign of the position of {joint} looks turned"
            yield Correction(self.name, reading.with_position(j, sign=-1.0), text, (joint,))
