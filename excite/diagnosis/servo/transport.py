"""A drive that follows with a lag against torques that act as they are, but late."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.attribution.attribution import Attribution
from excite.diagnosis.attribution.evidence import effective_counts
from excite.diagnosis.attribution.hypotheses import Hypothesis, Search
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Shape, Theta
from excite.diagnosis.effects.readings.actuator_lag import ActuatorLag
from excite.diagnosis.effects.readings.time_delay import TimeDelay, late

# Nats by which a lag has to lead a delay.
_CLEAR = 30.0


class Transport(TimeDelay):
    """Torques act a time d after they are asked for: ``u(t) = τ(t + d)``, as the secant of the predicted torque."""

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        column = late(context.baseline, -theta[0]) / theta[0]
        return Shape({j: column[:, [j]] for j in range(column.shape[1])})


def clearly_lags(attribution: Attribution) -> bool:
    """Whether an accepted lag of the drives, the first effect, explains clearly more than a transport delay.

    The two turn the phase alike; a lag also lowers the amplitude, with the square of the frequency.
    """
    first = attribution.stages[0]
    if first.accepted is None or first.accepted.name != ActuatorLag.name:
        return False
    search = Search(first.context, first.context.baseline.solver)
    lag, late = _best(search, ActuatorLag()), _best(search, Transport())
    if lag is None or late is None:
        return False
    base = first.context.baseline
    residuals = [base.judged(item.fit.residual) for item in (lag, late)]
    counts = effective_counts(residuals[0], base.samples.identification, base.samples.trial_of_row).sum(
        axis=1
    )
    powers = [(r**2).mean(axis=1) for r in residuals]
    nats = 0.5 * float((counts * np.log(powers[1] / powers[0])).sum())
    return nats > _CLEAR


def _best(search: Search, effect: Effect) -> Hypothesis | None:
    coarse = search.coarse(effect, "torque")
    return None if coarse is None else search.refine(coarse)
