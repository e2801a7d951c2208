"""What an effect explains beyond constants, of which every joint of a robot may have one of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.joint_torque import Solver
from excite.diagnosis.equations.own_columns import CONSTANT
from excite.diagnosis.search.attribution import Scored
from excite.diagnosis.search.hypotheses import Hypothesis
from excite.diagnosis.search.refinement import effective_samples, price
from excite.diagnosis.search.verdict import tie


def beyond_constants(baseline: Baseline, passing: Sequence[Scored]) -> Scored:
    """The first of the effects that pass, unless it owes its place to constants.

    A body has more parameters than a robot has joints, and its weight takes up some of what drives have of their
    own: a little at every joint counts for more than the effect that is there. With a constant at every joint, it is
    no longer so. What has fewer parameters, a tilt, cannot make up a constant of each joint.

    Args:
        baseline: that they were fitted on.
        passing: effects that pass the gates, the likeliest first.

    Returns:
        The first; of a body or what has as many parameters, the one that leads it once constants are explained.
    """
    first = passing[0]
    solver = baseline.solver
    effect = first.hypothesis.effect
    body = effect.moves and len(effect.linear) >= solver.equations.n_joints
    if not body or len(passing) == 1 or CONSTANT.asked(baseline.modelled):
        return first
    for j, own in enumerate(solver.equations.own):
        solver = solver.with_own(j, np.column_stack([own, baseline.root_weight[j]]))
    prices = np.array([price(_again(solver, s.hypothesis)) for s in passing])
    best = passing[int(prices.argmin())]
    nats = float(prices[0] - prices.min()) * effective_samples(baseline)
    return best if nats > tie(best.evidence) else first


def _again(solver: Solver, item: Hypothesis) -> Hypothesis:
    """The same columns, fitted to other equations."""
    fit = solver.fit(item.columns.extra, item.columns.offset, widths=item.effect.widths)
    return replace(item, fit=fit)
