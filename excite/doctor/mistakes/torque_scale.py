"""Torques in another unit, or on the other side of the gear."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from excite.doctor.doubt import Doubt
from excite.doctor.mistakes.mistake import THE_UNIT, Correction, Mistake
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples

_SCALE_OFF = 1.6
# A joint alone is told from the others where its factor is beyond what any gain of a sensor is.
_ONE_OFF = 2.5
# Joints whose model makes so large a share of the torque tell the factor.
_TELLS = 0.05
# Factors of the joints that tell lie so near to their median, as logarithm. Wrong masses and loads give every joint a
# factor of its own, so what they differ by is also at most this share of what they have in common: the load that a
# real arm carried made factors of 1.1 to 2.2, whose median is no unit.
_AGREES, _STANDS_OUT = 0.35, 0.5


class TorqueScale(Mistake[TorqueSamples]):
    """All torques, or one joint's, larger or smaller than the nominal masses need."""

    name = "torque_scale"
    may_surprise = True
    leaves = frozenset({Doubt.SIZE})

    def corrections(self, samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
        gains, shares = samples.gains(reading)
        joints = samples.channels
        told = (shares > _TELLS) & (gains > 0.0)
        # A few joints that are off carry something that the model does not have.
        if 2 * told.sum() >= len(joints) and (told.sum() > 1 or len(joints) == 1):
            factor = float(np.median(gains[told]))
            spread = float(np.abs(np.log(gains[told] / factor)).max()) if factor > 0.0 else np.inf
            alike = spread < min(_AGREES, _STANDS_OUT * abs(np.log(factor)))
            if alike and not 1.0 / _SCALE_OFF < factor < _SCALE_OFF:
                cause = (
                    "currents, another unit, or torques before the gear"
                    if factor < 1.0
                    else "another unit, or a load that the model does not have"
                )
                text = (
                    f"torques are {factor:.3g} times what the nominal masses need, and so will be every identified "
                    f"parameter: {cause}"
                )
                scaled = reading.with_torque(range(len(joints)), 1.0 / factor)
                yield Correction(
                    self.name,
                    scaled,
                    text,
                    joints,
                    {"factor": factor},
                    surprise=abs(float(np.log(factor))),
                    ask=THE_UNIT,
                    as_logged=lambda read: read.with_torque(range(len(joints)), factor),
                    certain=False,
                )
        if len(joints) == 1:
            return
        for j in np.flatnonzero(told):
            if 1.0 / _ONE_OFF < gains[j] < _ONE_OFF:
                continue
            text = f"the torque of {joints[j]} is {gains[j]:.3g} times what the nominal masses need, unlike the others'"
            scaled = reading.with_torque([int(j)], 1.0 / float(gains[j]))
            yield Correction(
                self.name, scaled, text, (joints[j],), {"factor": float(gains[j])}, certain=False
            )
