"""Whether a size is another in every trial: a constant, friction or a scale of the torque that does not last."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.budget.fit.joint_fit import Model
from excite.diagnosis.budget.library import loaded
from excite.diagnosis.budget.shares import deviation
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.own_columns import CONSTANT, COULOMB, VISCOUS, own_rows
from excite.diagnosis.equations.units import force_unit
from excite.finding import Finding

# Parts of a trial by which it tells how sure it is of a size.
_PARTS = 4
# What is left of a joint has to stand so far above the noise before anything is looked for in it [power].
_STANDS = 2.0


@dataclass(frozen=True, eq=False)
class _Sizes:
    """A size that each trial asks for beside what the model has.

    Attributes:
        what: of what.
        unit: of it.
        size: ``(n_trials,)``.
        spread: ``(n_trials,)`` deviations.
        share: of what is left of the joint, what they take together.
    """

    what: str
    unit: str
    size: Array
    spread: Array
    share: float

    @property
    def differ(self) -> bool:
        """Whether two trials surely ask for other sizes."""
        apart = np.abs(self.size[:, None] - self.size)
        return bool((apart > THRESHOLDS.differs * np.hypot(self.spread[:, None], self.spread)).any())


def sizes_by_trial(model: Model, context: Context, weight: Array, floor: Array) -> tuple[Finding, ...]:
    """Joints at which a constant, friction or the scale of the torque differs from trial to trial, one finding each.

    What the model of all trials leaves is asked for one size in each of them; parts of a trial tell how sure it is of
    that, all trials together how sure parts are. A finding has to take as much of what is left as an effect has to be
    missed by.

    Args:
        model: the model of the gap.
        context: its predictions.
        weight: ``(n_joints, n_rows)`` square roots of the rows' weights.
        floor: ``(n_joints,)`` noise in the rows' band.
    """
    trial = model.design.rows.trial
    if len(np.unique(trial)) < 2:
        return ()
    made = []
    for j, joint in enumerate(context.joints):
        rest = model.residual[j]
        if float((rest**2).mean()) < _STANDS * float(floor[j]) ** 2:
            continue
        found = [_asked(*item, rest, trial) for item in _columns(context, weight, j)]
        differing = [item for item in found if item.differ and item.share >= THRESHOLDS.trifle]
        best = max(differing, key=lambda item: item.share, default=None)
        if best is not None:
            made.append(_said(best, joint, [t.name for t in context.baseline.samples.trials]))
    return tuple(made)


def _columns(context: Context, weight: Array, j: int) -> list[tuple[str, str, Array]]:
    """What may differ, its unit, and its rows per unit of it."""
    base, samples = context.baseline, context.baseline.samples
    unit, name = force_unit(samples.robot, context.joints[j]), context.joints[j]
    speed = "m/s" if unit == "N" else "rad/s"
    columns = [
        (what, per, own_rows(samples, (term,), j, [base.signs[j]])[0][:, 0] * weight[j])
        for what, per, term in (
            ("constant torque", unit, CONSTANT),
            ("dry friction", unit, COULOMB),
            ("viscous friction", f"{unit}/({speed})", VISCOUS),
        )
    ]
    if loaded(context, name):
        columns.append(("torque scale", "1", samples.rows(base.rigid[:, [j]], [j])[:, 0] * weight[j]))
    return columns


def _asked(what: str, unit: str, column: Array, rest: Array, trial: NDArray[np.int64]) -> _Sizes:
    """Sizes that trials ask for of a column of what is left."""
    numbers = np.unique(trial)
    size, spread, power = np.zeros(len(numbers)), np.zeros(len(numbers)), np.zeros(len(numbers))
    for k, number in enumerate(numbers):
        rows = np.flatnonzero(trial == number)
        c, r = column[rows], rest[rows]
        parts = np.array_split(np.arange(len(rows)), _PARTS)
        inner = np.array([c[p] @ c[p] for p in parts])
        cross = np.array([c[p] @ r[p] for p in parts])
        power[k] = max(float(inner.sum()), 1e-300)
        size[k] = cross.sum() / power[k]
        without = (cross.sum() - cross) / np.maximum(power[k] - inner, 1e-300)
        spread[k] = float(deviation(without))
    share = float((size**2 * power).sum() / max(float((rest**2).sum()), 1e-300))
    # Four parts tell little: no trial is surer than all of them together.
    pooled = np.sqrt((spread**2 * power).mean() / power)
    return _Sizes(what, unit, size, np.maximum(spread, pooled), share)


def _said(item: _Sizes, joint: str, trials: list[str]) -> Finding:
    low, high = int(np.argmin(item.size)), int(np.argmax(item.size))
    apart = float(item.size[high] - item.size[low])
    return Finding(
        kind="other_trials",
        text=(
            f"{item.what} at {joint} differs between trials: from {trials[low]} to {trials[high]} by {apart:.3g}"
            f"{'' if item.unit == '1' else ' ' + item.unit}, which is {100.0 * item.share:.0f} % of what is left there"
        ),
        figures={
            f"{name}.{side}": float(v)
            for name, *pair in zip(trials, item.size, item.spread, strict=True)
            for side, v in zip(("more", "deviation"), pair, strict=True)
        },
        places=(joint,),
        severity="limits",
        remedy="record the trials in one go, after the same warm-up, or diagnose each by itself",
    )
