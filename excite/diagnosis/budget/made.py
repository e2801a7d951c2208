"""The budget of a record from its model of the gap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, jackknife_std
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.answer.gap import (
    NOT_REPEATED,
    Budget,
    ChannelBudget,
    Detectable,
    EffectShare,
    Named,
    UnnamedShare,
)
from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import Model, fit_model
from excite.diagnosis.budget.fit.terms import ShapeStep, TermMaker
from excite.diagnosis.budget.library import has_rigid_load
from excite.diagnosis.budget.record import GapModel
from excite.diagnosis.budget.shares import Shares, linear_deviations, shares_of, unnamed_of
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.noise_floor import repeat_floor
from excite.diagnosis.equations.own_columns import CONSTANT, COULOMB, VISCOUS, own_rows
from excite.diagnosis.equations.units import at_joint, force_unit
from excite.diagnosis.selection.settling import predictive_nats
from excite.diagnosis.selection.shapes import shape_changes
from excite.finding import Finding
from excite.progress import step
from excite.robot.robot import Robot

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
    def has_different_trials(self) -> bool:
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
        found = [_fit_size_by_trial(*item, rest, trial) for item in _varying_columns(context, weight, j)]
        differing = [item for item in found if item.has_different_trials and item.share >= THRESHOLDS.trifle]
        best = max(differing, key=lambda item: item.share, default=None)
        if best is not None:
            made.append(_differing_trials(best, joint, [t.name for t in context.baseline.samples.trials]))
    return tuple(made)


def _varying_columns(context: Context, weight: Array, j: int) -> list[tuple[str, str, Array]]:
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
    if has_rigid_load(context, name):
        columns.append(("torque scale", "1", samples.to_rows(base.rigid[:, [j]], [j])[:, 0] * weight[j]))
    return columns


def _fit_size_by_trial(what: str, unit: str, column: Array, rest: Array, trial: NDArray[np.int64]) -> _Sizes:
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
        spread[k] = float(jackknife_std(without))
    share = float((size**2 * power).sum() / max(float((rest**2).sum()), 1e-300))
    # Four parts tell little: no trial is surer than all of them together.
    pooled = np.sqrt((spread**2 * power).mean() / power)
    return _Sizes(what, unit, size, np.maximum(spread, pooled), share)


def _differing_trials(item: _Sizes, joint: str, trials: list[str]) -> Finding:
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


# Share of a channel from which an effect of another place is listed there.
_LISTED = 0.01


@step("share out the gap")
def budget_of(found: GapModel, floor: Array, scale: Array) -> Budget:
    """Share out the gap.

    Args:
        found: the model of the gap.
        floor: ``(n_joints,)`` noise in the rows' band.
        scale: ``(n_joints,)`` standard deviation of each torque in the trials that are fitted.
    """
    model, joints = found.model, found.prediction.context.joints
    shares = shares_of(model, floor)
    relative = shares.open / scale**2
    weight = relative / max(float(relative.sum()), 1e-300)
    context = found.prediction.context
    again = repeat_floor(found.baseline.samples, model.residual)
    channels = {
        name: _channel_budget(found, context, shares, floor, j, float(weight[j]), again)
        for j, name in enumerate(joints)
    }
    named = [
        _named_effect(
            found,
            i,
            float(shares.value[i] @ weight),
            float(np.maximum(shares.low[i], 0.0) @ weight),
            is_significant(shares, i) and _predicts_blocks(found, i),
        )
        for i, term in enumerate(model.terms)
        if not term.effect.nameless
    ]
    sizes = detectable_sizes(model, found.baseline.samples.robot, found.tried)
    return Budget(channels, tuple(sorted(named, key=lambda item: -item.share)), sizes)


def _channel_budget(
    found: GapModel,
    context: Context,
    shares: Shares,
    floor: Array,
    j: int,
    weight: float,
    again: Array | None,
) -> ChannelBudget:
    model, room = found.model, float(shares.open[j])
    level, gap = float(np.sqrt(shares.level[j])), float(np.sqrt(shares.before[j]))
    unit = force_unit(found.baseline.samples.robot, context.joints[j])
    if room <= 0.0:
        return ChannelBudget(min(level, gap), gap, (), (), 1.0, 0.0, unit)
    effects, strange = [], []
    for i, term in enumerate(model.terms):
        share = float(shares.value[i, j])
        if term.effect.nameless:
            strange += [UnnamedShare(term.effect.nameless, share)] if term.own == j else []
        elif term.own == j or abs(share) >= _LISTED:
            between = (float(shares.low[i, j]), float(shares.high[i, j]))
            effects.append(EffectShare(term.name, term.location, share, between))
    effects.sort(key=lambda item: -item.share)
    generic = [
        UnnamedShare(left.follows, left.power / room, tuple(left.knots.tolist()), tuple(left.torque.tolist()))
        for left in unnamed_of(model, context, found.baseline.strict, floor, j)
    ]
    unnamed = strange + generic
    if again is not None:
        left = max(float(shares.after[j]) - level**2, 0.0) / room - sum(item.share for item in generic)
        differs = max(float(again[j]) ** 2 - level**2, 0.0) / room
        share = min(differs, max(left, 0.0))
        unnamed += [UnnamedShare(NOT_REPEATED, share)] if share > 0.0 else []
    rest = 1.0 - sum(item.share for item in effects) - sum(item.share for item in unnamed)
    return ChannelBudget(level, gap, tuple(effects), tuple(unnamed), rest, weight, unit)


def is_significant(shares: Shares, i: int) -> bool:
    """Whether an effect surely takes something of a joint's gap, and what is left there is clearly more without it.

    At any joint: without the gain of a finger's last joint the last link is fitted lighter, and that leaves too much at
    the joints before it, which had no gap.

    Args:
        shares: of all effects.
        i: which effect.
    """
    sure = (shares.low[i] > 0.0) | (shares.lost[i] > shares.unsure[i])
    return bool((sure & (shares.lost[i] >= THRESHOLDS.trifle)).any())


def _predicts_blocks(found: GapModel, i: int) -> bool:
    """Whether blocks left out of the fit are predicted better by an effect, surely so of as many as were tried."""
    model = found.model
    without = fit_model(model.design, [k for k in model.chosen if k != model.chosen[i]], model.weight)
    return predictive_nats(model, without) > np.log(THRESHOLDS.odds * found.tried)


def _named_effect(found: GapModel, i: int, share: float, surely: float, clear: bool) -> Named:
    model, k = found.model, found.model.chosen[i]
    term, nats = model.design.terms[k], found.nats[k]
    beta, spread = term.to_beta(model.term_parameters(k)), linear_deviations(model, k)
    values: dict[str, tuple[float, float | None]] = {
        p.name: (float(b), float(s)) for p, b, s in zip(term.effect.linear, beta, spread, strict=False)
    }
    shaped = shape_deviations(model, k)
    values |= {
        p.name: (t, None if n not in shaped else abs(t) * shaped[n])
        for n, (p, t) in enumerate(zip(term.effect.searched, term.theta, strict=True))
    }
    rivals = found.rivals.get(k, ())
    whole = 1.0 + sum(rival.odds for rival in rivals) + float(np.exp(-max(nats, 0.0)))
    return Named(
        effect=term.name,
        location=term.location,
        share=share,
        probability=1.0 / whole,
        values=values,
        nats=nats,
        rivals=tuple(model.design.terms[r.index].key for r in rivals),
        chances=tuple(rival.odds / whole for rival in rivals),
        surely=surely,
        clear=clear,
    )


def shape_deviations(model: Model, k: int) -> dict[int, float]:
    """Deviation between blocks left out of the logarithm of each shape parameter of the design's term ``k``.

    By its linear change beside all that the model has.
    """
    term = model.design.terms[k]
    maker = TermMaker(term.context, term.context.baseline.strict)
    changes = list(shape_changes(maker, term, model.term_parameters(k))) if term.theta else []
    if not changes:
        return {}
    steps = [ShapeStep.from_change(term, change) for _, change in changes]
    terms = (*model.terms, *steps)
    free = fit_model(Design(model.design.rows, terms), range(len(terms)), model.weight)
    left_out = free.left_out[:, free.layout.begin[len(model.terms) :]]
    return {i: float(d) for (i, _), d in zip(changes, jackknife_std(left_out), strict=True)}


# How large an effect would have to be for a record to show it beside everything that its model has.


def detectable_sizes(model: Model, robot: Robot, candidates: int) -> tuple[Detectable, ...]:
    """Sizes at which effects of one parameter at one joint would be worth their price, by effect and place.

    A column c of what is left beside all others gains ``½ share·|c|² β²/σ²`` nats; that has to be the price.

    Args:
        model: the model of the gap.
        robot: the robot, for units.
        candidates: number of effects and places that were tried.
    """
    inverse = np.linalg.inv(model.normal)
    price = THRESHOLDS.price + 0.5 * np.log(max(candidates, 1))
    smallest: dict[tuple[str, str], Detectable] = {}
    for k, term in enumerate(model.design.terms):
        j = term.own
        if term.known or term.n_free != 1 or j is None or set(term.columns) != {j} or k in model.chosen:
            continue
        g, where = model.design.fitted.total[j], model.design.place[k][j]
        columns, numbers = model.layout.columns[j], model.layout.numbers[j]
        cross = model.weight[j] * g[columns, where[0]]
        left = model.weight[j] * g[where[0], where[0]] - cross @ inverse[np.ix_(numbers, numbers)] @ cross
        if left <= 0.0:
            continue
        size = float(np.sqrt(2.0 * price / (model.effective_share[j] * left))) * float(term.scale[0])
        unit = term.effect.linear[term.kept[0]].unit
        unit = at_joint(robot, term.location, {"size": Estimate(size, None, unit)})["size"].unit
        if term.key not in smallest or size < smallest[term.key].size:
            smallest[term.key] = Detectable(term.name, term.location, size, unit)
    return tuple(smallest.values())
