"""Physics that no name of a diagnosis stands for, in words: what an unknown gap is like all the same."""

from __future__ import annotations

from excite.diagnosis.answer.candidate import measured
from excite.diagnosis.answer.tables import NO_NAME
from excite.diagnosis.attribution.attribution import Scored
from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.units import at_joint


def in_words(item: Scored) -> str:
    """What it says of the robot, for people."""
    h = item.hypothesis
    context = Context(h.baseline)
    values = h.effect.estimates(context, item.location, h.theta, h.told)
    values = at_joint(h.baseline.samples.robot, item.location, values)
    told = ", ".join(f"{name} {measured(value)}" for name, value in values.items())
    return f"the gap at {item.location} is that of a stop, or of a body that the joint runs into ({told}); {NO_NAME}"
