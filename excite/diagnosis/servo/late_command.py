"""How late a servo's commands, or its torques, are where a lag of its drives was found.

A lag is told by its first order, or by two, of the torque that acts, with all that the servo's gains add to friction
and rotors where something is late: commands that come 6 ms late, to a leg with kp of 150 N·m/rad, were a lag of 5.8 ms,
and to a finger one of 2.5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.attribution.attribution import Attribution
from excite.diagnosis.effects.readings.actuator_lag import ActuatorLag
from excite.diagnosis.effects.readings.time_delay import late
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.reversals import told_delay
from excite.diagnosis.servo.cycle import Cycle, later
from excite.diagnosis.servo.servo import Servo, Signals


def delay_for_lag(
    attribution: Attribution, servo: Servo, signals: Mapping[str, Signals], cycle: Cycle, order: Sequence[int]
) -> Estimate | None:
    """The delay that stands in the place of an accepted lag, the first effect; None without a lag, or such a delay.

    Of commands, or of positions in the log, which are the same; or of all of the torque. What leaves less is meant.

    Args:
        attribution: all its steps.
        servo: the servo.
        signals: by trial.
        cycle: when the servo's torques act.
        order: of the samples' joints in the log.
    """
    first = attribution.stages[0]
    if first.accepted is None or first.accepted.name != ActuatorLag.name:
        return None

    def commands(base: Baseline, delay: float) -> Array:
        parts = []
        for trial in base.samples.trials:
            s = signals[trial.name]
            now = servo.kp * s.commanded.value + servo.damping_share * servo.kd * s.commanded.first
            change = later(s.time, now - later(s.time, now, delay), cycle.lag)
            parts.append(change[: len(trial.time), list(order)])
        return np.concatenate(parts)

    def torques(base: Baseline, delay: float) -> Array:
        return late(base, -delay)

    base, begin = first.context.baseline, float(first.accepted.hypothesis.fit.extra[0])
    told = [told_delay(base, begin, change) for change in (commands, torques)]
    best = min((one for one in told if one is not None), key=lambda one: one.loss, default=None)
    return None if best is None else Estimate(best.size, best.std, "s")
