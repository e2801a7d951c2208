"""A base pose that is meant otherwise than the log's format says."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from excite.doctor.base_pose import BasePose
from excite.doctor.mistakes.mistake import Correction, Mistake
from excite.doctor.reading import Reading
from excite.doctor.wrench_samples import WrenchSamples


class BaseFrame(Mistake[WrenchSamples]):
    """Quaternions in another order or of the inverse, positions in millimetres: weights then stand askew."""

    name = "base_pose"
    of_posture = True

    def corrections(self, samples: WrenchSamples, reading: Reading) -> Iterable[Correction]:
        if reading.pose is not BasePose.STATED:
            return
        for pose in BasePose:
            if pose is not BasePose.STATED:
                text = f"the base pose looks otherwise than stated: {pose.value}"
                yield Correction(self.name, replace(reading, pose=pose), text, ("base",))
