"""Physics without a name in a diagnosis, tried beside effects that have one: where it says more, the gap is unknown.

A contact of a joint's own is the least that nobody planned; a spring, a slow ripple and a bias together can take
its form, and would be named one after the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from excite.diagnosis.answer.candidate import measured
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.forces.end_stop import EndStop
from excite.diagnosis.effects.forces.joint_spring import JointSpring
from excite.diagnosis.equations.units import at_joint
from excite.diagnosis.search.attribution import Scored
from excite.diagnosis.search.gates import Gates
from excite.diagnosis.search.hypotheses import Hypothesis, Search
from excite.diagnosis.search.refinement import in_richer_forms, polished
from excite.diagnosis.search.verdict import nats_behind, tie

_UNNAMED: tuple[Effect, ...] = (EndStop(),)
# Effects whose richer forms come near to them at the same place.
_NEAR: tuple[Effect, ...] = (JointSpring(),)

Score = Callable[[Sequence[Hypothesis]], Sequence[Scored]]


def unnamed(
    search: Search, best: Scored | None, joints: Iterable[str], gates: Gates, score: Score
) -> Scored | None:
    """What explains a clear gap at a joint, has no name, and says more than all that have one.

    Args:
        search: fits against the baseline so far.
        best: the effect that would be accepted, None where none passes.
        joints: that have a gap, most first.
        gates: what an effect must reach; here it has to leave no gap at a place that stands clear.
        score: merits of hypotheses, as of the effects'.

    Returns:
        It, None where there is none.
    """
    begun = [search.coarse(effect, joint) for joint in joints for effect in _UNNAMED]
    found = score([search.refine(item) for item in begun if item is not None])
    likely = [s for s in found if s.stands >= gates.clear and float(s.closed[s.place]) >= gates.whole]
    if not likely:
        return None
    item = max(likely, key=lambda s: s.evidence)
    if best is not None and best.location != item.location and best.strength > item.strength:
        return None
    near = [h for effect in _NEAR for h in in_richer_forms(search, effect, item.location)]
    near += [polished(h) for h in near]
    rivals = [*score(near), *([best] if best is not None else [])]
    ahead = min((nats_behind(item, rival) for rival in rivals), default=tie(item.evidence))
    return item if ahead >= tie(item.evidence) else None


def in_words(item: Scored) -> str:
    """What it says of the robot, for people."""
    h = item.hypothesis
    context = Context(h.baseline)
    values = h.effect.estimates(context, item.location, h.theta, h.told)
    values = at_joint(h.baseline.samples.robot, item.location, values)
    told = ", ".join(f"{name} {measured(value)}" for name, value in values.items())
    return (
        f"the gap at {item.location} is that of a stop, or of a body that the joint runs into ({told}); "
        "no effect in the library stands for that"
    )
