"""Whether the trials to learn from and those to judge by are of one machine: sizes refitted on the latter."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.joint_fit import Model
from excite.diagnosis.budget.shares import deviation
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.finding import Finding

# Blocks of the trials that judge by which they tell how sure they are.
_BLOCKS = 3
# Share of a size from which a difference is another machine, not what a model leaves: a load turned by half a turn
# and a band tightened by half lie above it.
_LARGE = 0.3


def other_machine(model: Model) -> tuple[Finding, ...]:
    """Terms whose sizes in the trials that judge are others than in those that were learnt from.

    All else in the model is kept as it was learnt. A difference counts where blocks on both sides agree that it is
    there, it is a good part of the size itself, and without it as much more is left of the joints that feel the term as
    an effect has to be missed by: a friction of next to nothing may differ by all of itself.

    Args:
        model: the model of the gap.
    """
    design = model.design
    if design.judged is design.fitted or len(design.judged.count) < _BLOCKS or not model.chosen:
        return ()
    refits = _refits(model)
    if refits is None:
        return ()
    there, spread = refits
    first = model.layout.begin[0]
    here = model.x[first:]
    both = np.hypot(deviation(model.left_out[:, first:]), spread)
    made = []
    for k, begin in zip(model.chosen, model.layout.begin, strict=True):
        term = design.terms[k]
        if term.known:
            continue
        where = slice(begin - first, begin - first + term.size)
        change = there[where] - here[where]
        clear = np.abs(change) > THRESHOLDS.differs * both[where]
        large = np.linalg.norm(change) > _LARGE * np.linalg.norm(here[where])
        if not (clear.any() and large) or _missed(model, k, change) < THRESHOLDS.trifle:
            continue
        old, new = term.beta(here[where]), term.beta(there[where])
        names = [p.name for p in term.effect.linear]
        shown = [i for i in term.kept if abs(float(new[i] - old[i])) > 0.0][:4]
        said = ", ".join(f"{names[i]} {old[i]:.3g} against {new[i]:.3g}" for i in shown)
        made.append(
            Finding(
                kind="other_machine",
                text=(
                    "the trials to learn from and those to judge by are not of one machine: "
                    f"{term.name.replace('_', ' ')} at {term.location} has {said}"
                ),
                figures={
                    f"{names[i]}.{side}": float(v[i])
                    for i in shown
                    for side, v in (("learnt", old), ("judged", new))
                },
                places=(term.location,),
                severity="limits",
                remedy="judge each set of trials by its own identification, or give them sessions of their own",
            )
        )
    return tuple(made)


def _missed(model: Model, k: int, change: Array) -> float:
    """Power that a change of a term's size makes in the trials that judge, as a share of what is left there."""
    grams, at = model.design.judged, model.design.place[k]
    left = (model.power(grams) * grams.count[:, None]).sum(axis=0)
    made = sum(
        float(model.weight[j] * (change @ grams.total[j][np.ix_(c, c)] @ change)) for j, c in at.items()
    )
    return made / max(sum(float(model.weight[j] * left[j]) for j in at), 1e-300)


def _refits(model: Model) -> tuple[Array, Array] | None:
    """Sizes of all terms on the trials that judge, and their deviations by blocks; None where these tell too little."""
    first, grams = model.layout.begin[0], model.design.judged
    size = model.layout.size - first
    n = len(grams.count)
    normal, right = np.zeros((n, size, size)), np.zeros((n, size))
    for g, c, p, w in zip(grams.of, model.layout.columns, model.layout.numbers, model.weight, strict=True):
        ours = p >= first
        numbers = p[ours] - first
        columns, rest = c[ours], c[~ours]
        normal[:, numbers[:, None], numbers] += w * g[:, columns[:, None], columns]
        right[:, numbers] += w * (g[:, columns, -1] - g[:, columns[:, None], rest] @ model.x[p[~ours]])
    total, sums = normal.sum(axis=0), right.sum(axis=0)
    # What these trials hardly show stays as it was learnt.
    keep = 1e-3 * model.normal[first:, first:].diagonal()
    prior = np.diag(keep)
    learnt = keep * model.x[first:]
    there = np.linalg.solve(total + prior, sums + learnt)
    without = np.linalg.solve(total - normal + prior, (sums - right + learnt)[..., None])[..., 0]
    return there, deviation(without)
