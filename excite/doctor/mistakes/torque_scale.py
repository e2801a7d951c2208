"""Torques in another unit, or on the other side of the gear."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.doctor.doubt import Doubt
from excite.doctor.limit_shares import share_of_limits
from excite.doctor.mistakes.mistake import THE_UNIT, Correction, Mistake
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples
from excite.shown import span

_SCALE_OFF = 1.6
# A joint alone is told from the others where its factor is beyond what any gain of a sensor is.
_ONE_OFF = 2.5
# Joints whose model makes so large a share of the torque tell the factor.
_TELLS = 0.05
# Factors of the joints that tell lie so near to their median, as logarithm. Wrong masses and loads give every joint a
# factor of its own, so what they differ by is also at most this share of what they have in common: the load that a
# real arm carried made factors of 1.1 to 2.2, whose median is no unit.
_AGREES, _STANDS_OUT = 0.35, 0.5
# Squared correlation with the nominal torque beside friction, and how far beyond one all factors have to be, as
# logarithm: of ten real robots whose torques are N·m those that agree so closely have factors of 0.57 to 1.9, one
# servo arm's to 3.5.
_CLOSELY, _FAR = 0.9, float(np.log(3.0))


class TorqueScale(Mistake[TorqueSamples]):
    """All torques, or one joint's, larger or smaller than the nominal masses need."""

    name = "torque_scale"
    may_surprise = True
    leaves = frozenset({Doubt.SIZE})

    def corrections(self, samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
        gains, shares = samples.gains(reading)
        joints = samples.channels
        told = (shares > _TELLS) & (gains > 0.0)
        own = _of_their_own(samples, reading, gains, told)
        if own is not None:
            yield own
            return
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
            # What an end of the range cuts off makes a torque smaller, by the share of rows in which it does where
            # values are spread as in a bell (Bussgang 1952). That is no unit.
            uncut = gains[j] / samples.within[j]
            if 1.0 / _ONE_OFF < uncut and gains[j] < _ONE_OFF:
                continue
            text = f"the torque of {joints[j]} is {gains[j]:.3g} times what the nominal masses need, unlike the others'"
            scaled = reading.with_torque([int(j)], 1.0 / float(gains[j]))
            yield Correction(
                self.name, scaled, text, (joints[j],), {"factor": float(gains[j])}, certain=False
            )


def _of_their_own(
    samples: TorqueSamples, reading: Reading, gains: Array, told: NDArray[np.bool_]
) -> Correction | None:
    """All torques in a unit that differs from joint to joint; None where they are in none such.

    To repair one of them would leave the others, and to repair all would take the nominal masses for the truth.
    """
    close = told & (samples.agreement(reading) > _CLOSELY)
    joints = samples.channels
    if close.sum() < 2 or 2 * close.sum() < len(joints):
        return None
    limits = np.array([samples.robot.limits.torque[samples.robot.joint_index(joint)] for joint in joints])
    size = np.log(gains[close])
    if share := share_of_limits(gains[close], limits[close]):
        factors, cause = limits / share.whole, f"they look like {share.name} of the joints' limits"
    elif np.ptp(size) > _AGREES and ((size < -_FAR).all() or (size > _FAR).all()):
        factors = 1.0 / np.where(told, gains, np.exp(np.median(size)))
        cause = "currents, whose torque constants are not known, or another unit"
    else:
        return None
    scaled = reading
    for j, factor in enumerate(factors):
        scaled = scaled.with_torque([j], float(factor))
    least, most = float(np.exp(size.min())), float(np.exp(size.max()))
    times = span(f"{least:.3g}", f"{most:.3g}", " to ")
    text = f"torques are {times} times what the nominal masses need, by joint: {cause}"

    def as_logged(read: Reading) -> Reading:
        for j, factor in enumerate(factors):
            read = read.with_torque([j], 1.0 / float(factor))
        return read

    return Correction(
        TorqueScale.name,
        scaled,
        text,
        joints,
        {f"factor.{joint}": float(1.0 / factor) for joint, factor in zip(joints, factors, strict=True)},
        surprise=float(np.abs(size).max()),
        ask=THE_UNIT,
        as_logged=as_logged,
        certain=False,
    )
