"""Friction, rotor inertia and constants that the baseline took from the record, with their intervals."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import ndtri, stdtrit

from excite.diagnosis.answer.absorbed import Absorbed
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.joint_torque import TRIALS
from excite.diagnosis.equations.own_columns import COULOMB, SCALED, own_terms
from excite.diagnosis.equations.units import at_joint
from excite.rows.drive_terms import DRIVE_TERMS

_UNITS = {word: term.unit for term in DRIVE_TERMS.values() for word in term.effects}


def absorbed(baseline: Baseline) -> tuple[Absorbed, ...]:
    """Coefficients of the joints' own columns, as many a joint as ``modelled`` asks for.

    Deviations are those by which the fitted trials disagree, and Student's intervals of so few of them; of one or two
    trials those of white residuals.

    Args:
        baseline: before the first effect.
    """
    equations, joints = baseline.solver.equations, baseline.samples.joints
    trials = len(np.unique(equations.trial[equations.use]))
    within = float(stdtrit(trials - 1, 0.95) if trials >= TRIALS else ndtri(0.95))
    found = []
    for j, joint in enumerate(joints):
        names = list(_names(baseline, j))
        if not names:
            continue
        # As columns of a hypothesis, whose deviations are known, and not as the joint's own.
        columns = np.zeros((len(joints), *equations.own[j].shape))
        columns[j] = equations.own[j]
        solver = baseline.solver.with_own(j, equations.own[j][:, :0])
        fit = solver.fit(columns)
        spread = solver.std_between_trials(fit)
        for name, value, std in zip(names, fit.extra, spread, strict=True):
            word = name.partition(" ")[0]
            # Of a scale this is what it would be without the first effect: the constant itself is what is told.
            if word == SCALED:
                continue
            size = Estimate(float(value), float(std), _UNITS[word])
            there = (float(value - within * std), float(value + within * std))
            found.append(
                Absorbed(joint, name, at_joint(baseline.samples.robot, joint, {name: size})[name], there)
            )
    return tuple(found)


def _names(baseline: Baseline, joint: int) -> Iterator[str]:
    """Of a joint's own columns, in their order: of its motor, of other motors that turn with it, of its bristles."""
    samples, terms = baseline.samples, own_terms(baseline.modelled)
    for motor in samples.motors(joint):
        for term in terms:
            if motor == joint:
                yield term.words[0]
            elif not term.once:
                yield f"{term.words[0]} of the motor of {samples.joints[motor]}"
    if baseline.signs[joint].damped and COULOMB in terms:
        yield "viscous_friction of the bristles at standstill"
