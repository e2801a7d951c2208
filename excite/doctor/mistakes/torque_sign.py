"""Torques with their sign turned: reaction instead of action, or a drive that counts the other way."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from excite.doctor.mistakes.mistake import Correction, Mistake
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples
from excite.finding import list_names

# Half the residual's logarithm by which a single turned torque has to fit better to go with the others.
_TELLS = 0.3


class TorqueSign(Mistake[TorqueSamples]):
    """Friction takes power out and weights pull down: a turned torque can be neither."""

    name = "torque_sign"

    def corrections(self, samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
        joints = samples.channels
        straight = samples.left(reading)
        turned = samples.left(reading.with_torque(range(len(joints)), -1.0))
        gains = straight - turned
        telling = np.flatnonzero(gains > _TELLS)
        chosen = {(int(j),) for j in telling} | ({tuple(telling.tolist())} if len(telling) else set())
        # Joints that do not tell go with the others where all that tell agree.
        if len(telling) > 1 and (gains > -_TELLS).all():
            chosen.add(tuple(range(len(joints))))
        for places in sorted(chosen):
            names = tuple(joints[j] for j in places)
            text = (
                "the sign of all torques looks turned: reaction instead of action"
                if len(names) == len(joints) > 1
                else f"the sign of the torque of {list_names(names)} looks turned"
            )
            yield Correction(
                self.name,
                reading.with_torque(list(places), -1.0),
                text,
                names,
                {"joints": float(len(names))},
                along=tuple(joints[j] for j in places if j not in telling),
            )
