"""How large effects are beside what torques rebuilt from a servo can tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.diagnosis.attribution.attribution import Attribution, Scored
from excite.diagnosis.attribution.judgement import withdrawn
from excite.diagnosis.equations.baseline import Baseline

# How exact torques are that are rebuilt from commands and positions: cycles, held commands, encoders' filters.
EXACT = 0.015


def effect_strength(item: Scored) -> float:
    """RMS of an effect's torque over a joint's whole torque's deviation, at most; infinite where it has no columns."""
    h, samples = item.hypothesis, item.hypothesis.baseline.samples
    if h.columns.extra is None:
        return float(np.inf)
    made = np.sqrt(((h.columns.extra @ h.fit.extra) ** 2).mean(axis=1))
    return float((made / samples.rows([t.measured for t in samples.trials]).std(axis=0)).max())


def without_faint(attribution: Attribution, baseline: Baseline) -> Attribution:
    """The attribution up to the first effect that rebuilt torques are not exact enough for.

    The noise floor stays, and the parameters of the effects before it that were searched beside it: what is so faint
    moves neither. Where it happens, the floor without it is within 0.3 % of the one with it, and roll-outs' errors with
    parameters searched again are within 0.3 % of those without.

    Args:
        attribution: all its steps.
        baseline: the baseline that they began with.
    """
    for k, item in enumerate(attribution.accepted):
        if effect_strength(item) < EXACT:
            if k == 0:
                return withdrawn(attribution, baseline)
            stages = (*attribution.stages[:k], replace(attribution.stages[k], accepted=None))
            final = attribution.stages[k].context.baseline
            return replace(attribution, stages=stages, after=final.fit, final=final)
    return attribution
