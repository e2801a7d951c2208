"""Joints that are turned about altogether: position and torque count the other way."""

from __future__ import annotations

from collections.abc import Iterable

from excite.doctor.mistakes.mistake import Correction, Mistake
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples


class Direction(Mistake[TorqueSamples]):
    """The model's axis and the robot's point opposite ways."""

    name = "direction"

    def corrections(self, samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
        for j, joint in enumerate(samples.channels):
            turned = reading.with_position(int(samples.measured[j]), sign=-1.0).with_torque([j], -1.0)
            text = f"{joint} looks turned about: signs of its position and its torque"
            yield Correction(self.name, turned, text, (joint,), changes=2)
