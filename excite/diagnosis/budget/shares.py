"""What each named effect takes of each channel's gap: the mean of taken out last and let in alone."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from excite.arrays import Array, jackknife_std
from excite.diagnosis.budget.fit.design import Design, Rows
from excite.diagnosis.budget.fit.joint_fit import Model, effective_share, fit_model
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.bodies import PartTimePayload, Payload
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline_fit import model_phi, prior_spread
from excite.finding import Finding, list_names

# Power above the floor, as a share of the floor, below which a channel has no gap to share out.
_NOTHING = 0.05
# Deviation of a share's square root beyond what fits without a block tell: which of several effects that overlap takes
# what is theirs together is a matter of convention. Set on 36 drawn arms with a little of everything: 90 % intervals
# hold 88 % of 270 shares.
_CONVENTION = 0.045


@dataclass(frozen=True, eq=False)
class Power:
    """Mean squares on the trials that judge.

    Attributes:
        mean: ``(n_joints,)``.
        blocks: ``(n_judged, n_joints)`` without a block each of those that judge.
        fits: ``(n_blocks, n_joints)`` of fits without a block each.
    """

    mean: Array
    blocks: Array
    fits: Array

    def add_multiple(self, other: Power, sign: float) -> Power:
        """Sum with a multiple of another."""
        return Power(
            self.mean + sign * other.mean, self.blocks + sign * other.blocks, self.fits + sign * other.fits
        )

    def average_with(self, other: Power) -> Power:
        """Halfway between two."""
        return Power(
            0.5 * (self.mean + other.mean), 0.5 * (self.blocks + other.blocks), 0.5 * (self.fits + other.fits)
        )


def power_of(model: Model) -> Power:
    """Mean squares that a fitted model leaves; of trials that judge themselves, of blocks that it was not fitted to."""
    grams = model.design.judging_grams
    own = grams is model.design.fitted and len(model.predicted) > 0
    left = model.predicted if own else model.residual_power(grams) * grams.count[:, None]
    total, count = left.sum(axis=0), float(grams.count.sum())
    without = (total - left) / np.maximum(count - grams.count, 1.0)[:, None]
    fits = np.empty((len(model.left_out), len(grams.total)))
    for j, (g, c, p) in enumerate(zip(grams.total, model.layout.columns, model.layout.numbers, strict=True)):
        z = model.left_out[:, p]
        inner = z @ g[np.ix_(c, c)] - 2.0 * g[c, -1]
        fits[:, j] = (g[-1, -1] + (inner * z).sum(axis=1)) / count
    return Power(total / count, without, fits)


def judged_power(
    design: Design,
    chosen: Sequence[int],
    weight: Array | None = None,
    sizes: Mapping[int, Array] | None = None,
) -> Power:
    """What the terms leave when they are fitted together, or have known sizes."""
    return power_of(fit_model(design, chosen, weight, sizes=sizes))


def linear_deviations(model: Model, k: int) -> Array:
    """Deviations between blocks left out of the linear parameters of the design's term ``k``, ``(n_linear,)``."""
    term, first = model.design.terms[k], model.layout.begin[model.chosen.index(k)]
    return np.abs(term.to_beta(jackknife_std(model.left_out[:, first : first + term.n_free])))


@dataclass(frozen=True, eq=False)
class Shares:
    """Shares of each channel's power above the floor.

    Attributes:
        level: ``(n_joints,)`` power of the noise.
        open: ``(n_joints,)`` power above the floor without effects; 0 where there is none.
        before: ``(n_joints,)`` power without effects.
        after: ``(n_joints,)`` power with all.
        value: ``(n_terms, n_joints)``.
        low: ``(n_terms, n_joints)`` lower ends of the 90 % intervals.
        high: ``(n_terms, n_joints)`` upper ends.
        lost: ``(n_terms, n_joints)`` by how much more is left without each alone, as a share of what is left with all.
        unsure: ``(n_terms, n_joints)`` half widths of the 90 % intervals of that.
    """

    level: Array
    open: Array
    before: Array
    after: Array
    value: Array
    low: Array
    high: Array
    lost: Array
    unsure: Array


def shares_of(model: Model, floor: Array) -> Shares:
    """Share out the gap of every channel.

    Two effects that overlap share what they both take (Shapley's value is the mean over orders; of many effects the
    first and the last place stand for all), each of the size that it has beside all others: a small one that is let in
    alone is no larger for what it could take. What the means miss of all that is closed is made up in proportion.

    Args:
        model: the model of the gap.
        floor: ``(n_joints,)`` noise in the rows' band.
    """
    design = model.design
    nothing, everything = judged_power(design, ()), power_of(model)
    chosen = model.chosen
    taken, lost, sized = [], [], []
    sizes = {k: model.term_parameters(k) for k in chosen}
    for k in chosen:
        last = judged_power(design, [i for i in chosen if i != k], model.weight).add_multiple(
            everything, -1.0
        )
        alone = nothing.add_multiple(judged_power(design, (k,)), -1.0)
        lost.append(last)
        others = {i: x for i, x in sizes.items() if i != k}
        without = judged_power(design, tuple(others), model.weight, others)
        only = judged_power(design, (k,), model.weight, {k: sizes[k]})
        sized.append(0.5 * (without.mean - everything.mean + nothing.mean - only.mean))
        taken.append(last.average_with(alone))
    # What all effects leave is no less than the noise.
    level = np.minimum(floor**2, everything.mean)
    room = np.where(nothing.mean - level > _NOTHING * level, nothing.mean - level, 0.0)
    if not taken:
        empty = np.zeros((0, len(floor)))
        return Shares(
            level,
            room,
            nothing.mean,
            everything.mean,
            empty,
            empty,
            empty,
            empty,
            empty,
        )
    value = _normalise_shares(np.array(sized), nothing.mean, everything.mean, level)
    value = np.where(room > 0.0, value, 0.0)
    # Shares are those of these trials, whatever others would have: what is unsure is the fit.
    fits = _normalise_shares(np.array([item.fits for item in taken]), nothing.fits, everything.fits, level)
    spread = jackknife_std(np.moveaxis(fits, 1, 0))
    freedom = max(min(len(nothing.blocks), len(nothing.fits)) - 1, 1)
    wide = float(stdtrit(freedom, 0.95))
    low, high = (np.where(room > 0.0, end, 0.0) for end in _share_interval(value, spread, wide))
    left = np.maximum(everything.mean, 1e-300)
    more = np.array([item.mean for item in lost]) / left
    deviations = [np.hypot(jackknife_std(item.blocks), jackknife_std(item.fits)) for item in lost]
    unsure = wide * np.array(deviations) / left
    return Shares(level, room, nothing.mean, everything.mean, value, low, high, more, unsure)


def _share_interval(share: Array, spread: Array, wide: float) -> tuple[Array, Array]:
    """Ends of an interval of shares; the lower one is even in their roots, as a share is the square of a size.

    Args:
        share: shares.
        spread: deviations between fits without a block each.
        wide: deviate of the interval.
    """
    root = np.sqrt(np.maximum(share, 1e-12))
    half = wide * (spread + 2.0 * _CONVENTION * root)
    least = root - 0.5 * half / root
    return np.where(least > 0.0, least**2, share - half), share + half


def _normalise_shares(taken: Array, before: Array, after: Array, level: Array) -> Array:
    """Shares that add up to what all effects together close, ``taken``'s shape."""
    room = np.maximum(before - level, _NOTHING * level)
    positive = np.maximum(taken, 0.0)
    total, closed = positive.sum(axis=0), before - after
    scaled = positive * (np.maximum(closed, 0.0) / np.maximum(total, 1e-300))
    # Where nothing is closed in sum, each stands for itself.
    return np.where((closed > 0.0) & (total > 0.0), scaled, taken) / room


# Whether some of a record's trials have a body that the others have not, and which trials these are.

# Rounds in which the joints' weights follow what is left.
_ROUNDS = 3
# Share of a body by which a trial with all of it, or without it, may differ from that: 0.01 on a UR10e whose tool of
# 2.8 kg is there in one of five recordings, 0.01 on a simulated pick and place with 0.8 kg in half of the trials; on an
# AirBot, whose nine recordings have the same load, the trials that some body suits best have up to 0.29 more or less.
_ALIKE = 0.15


@dataclass(frozen=True, eq=False)
class _Grams:
    """Products of columns by trial: of what every model has, a body's ten, and the measurement, in this order.

    Attributes:
        grams: one ``(n_trials, k_j, k_j)`` a joint.
        shared: number of columns that all joints share, the first ones.
        begin: where each joint's own parameters begin among all, after the shared ones.
        size: number of parameters without the body's.
    """

    grams: tuple[Array, ...]
    shared: int
    begin: tuple[int, ...]
    size: int

    @cached_property
    def total_grams(self) -> tuple[Array, ...]:
        """Of all trials."""
        return tuple(g.sum(axis=0) for g in self.grams)

    def fit_body(self, trials: Collection[int], weight: Array) -> tuple[Array, Array]:
        """Parameters with the body in some trials, its ten last; and sums of squares left of each joint."""
        here = sorted(trials)
        n = self.size + 10
        normal, right = np.eye(n), np.zeros(n)
        normal[self.size :, self.size :] = np.diag(1.0 / Payload().prior_widths ** 2)
        numbers, made = [], []
        for j, (g, whole) in enumerate(zip(self.grams, self.total_grams, strict=True)):
            own = g.shape[1] - self.shared - 11
            p = np.r_[0 : self.shared, self.begin[j] : self.begin[j] + own, self.size : n]
            some = g[here].sum(axis=0) if here else np.zeros_like(whole)
            gram = whole.copy()
            body = slice(self.shared + own, self.shared + own + 10)
            gram[body], gram[:, body] = some[body], some[:, body]
            numbers.append(p)
            made.append(gram)
            normal[np.ix_(p, p)] += weight[j] * gram[:-1, :-1]
            right[p] += weight[j] * gram[:-1, -1]
        x = np.asarray(np.linalg.solve(normal, right), dtype=np.float64)
        left: Array = np.array(
            [
                g[-1, -1] + x[p] @ (g[:-1, :-1] @ x[p] - 2.0 * g[:-1, -1])
                for g, p in zip(made, numbers, strict=True)
            ]
        )
        return x, np.maximum(left, 0.0, dtype=np.float64)

    def excess_by_trial(self, trials: Collection[int], weight: Array) -> Array:
        """How much more of the body than all or nothing each trial asks for, beside that fit, ``(n_trials,)``."""
        x, _ = self.fit_body(trials, weight)
        body = x[self.size :]
        asked, power = np.zeros((2, len(self.grams[0])))
        for j, g in enumerate(self.grams):
            own = g.shape[1] - self.shared - 11
            others = x[np.r_[0 : self.shared, self.begin[j] : self.begin[j] + own]]
            ten = slice(self.shared + own, self.shared + own + 10)
            for k, gram in enumerate(g):
                rest = gram[ten, -1] - gram[ten, : self.shared + own] @ others
                inner = gram[ten, ten] @ body
                asked[k] += weight[j] * float(body @ (rest - inner if k in trials else rest))
                power[k] += weight[j] * float(body @ inner)
        return asked / np.maximum(power, 1e-300)


def part_time_payload(context: Context, rows: Rows, weight: Array) -> PartTimePayload | None:
    """The body that some trials have and others do not, to be tried as an effect; None where no trials ask for one.

    Of every link's body it is asked in which trials it explains most, beside all that the model begins with: the best
    trial, and each further one that leaves less with it. What it takes of a joint is to be as much as an effect has to
    be missed by, with one trial or more of those that are learnt from on either side; and trials have all of it or
    nothing: what differs a little from each to the next is no body.

    Args:
        context: the baseline, fitted.
        rows: weighted rows of what is modelled.
        weight: ``(n_joints, n_rows)`` square roots of the rows' weights.
    """
    samples = context.baseline.samples
    names = [trial.name for trial in samples.trials]
    learnt = {k for k, trial in enumerate(samples.trials) if trial.identification}
    if len(learnt) < 2:
        return None
    count = rows.y.shape[1]
    best: tuple[float, frozenset[int], Array, Array] | None = None
    payload = Payload()
    for link in payload.locations(context):
        products = _trial_products(context, payload, link, rows, weight)
        inverse = np.full(rows.n_joints, 1.0)
        for _ in range(_ROUNDS):
            _, none = products.fit_body((), inverse)
            inverse = 1.0 / np.maximum(none / count, rows.floor**2)
        there, left = _loaded_trials(products, inverse, len(names), learnt)
        score = float(
            (0.5 * count * np.log(np.maximum(none, 1e-300) / np.maximum(left, count * rows.floor**2))).sum()
        )
        if there and (best is None or score > best[0]):
            more = products.excess_by_trial(there, inverse)
            # Beside bodies that are fitted, what some trials have less is what the others have more.
            x, _ = products.fit_body(there, inverse)
            if products.shared and x[products.size] < 0.0:
                there = frozenset(range(len(names))) - there
            best = score, there, 1.0 - left / np.maximum(none, 1e-300), more
    if best is None or best[2].max() < THRESHOLDS.trifle or np.abs(best[3]).max() > _ALIKE:
        return None
    return PartTimePayload([names[k] for k in best[1]])


def trials_that_carry(effects: Iterable[tuple[Effect, str]]) -> tuple[Finding, ...]:
    """Which trials have a body that was found in some of them alone, one finding a body.

    Args:
        effects: those that are named, with their places.
    """
    return tuple(
        Finding(
            kind="some_trials",
            text=f"the body at {link} is there in {list_names(tuple(sorted(effect.trials)), most=8)} alone",
            places=(link,),
            trials=tuple(sorted(effect.trials)),
            remedy="diagnose the trials with it and those without it by themselves, if it should not differ",
        )
        for effect, link in effects
        if isinstance(effect, PartTimePayload)
    )


def _loaded_trials(products: _Grams, weight: Array, n: int, learnt: set[int]) -> tuple[frozenset[int], Array]:
    """Trials in which a body explains most, and sums of squares that are left of each joint."""
    there: frozenset[int] = frozenset()
    left = products.fit_body(there, weight)[1]
    while True:
        tried = [there ^ {k} for k in range(n)]
        tried = [some for some in tried if some]
        found = [(products.fit_body(some, weight)[1], some) for some in tried]
        less, some = min(found, key=lambda item: float(item[0] @ weight))
        if float(less @ weight) >= float(left @ weight):
            break
        there, left = some, less
    # Learnt from both with and without it.
    return (there, left) if there & learnt and learnt - there else (frozenset(), left)


def _trial_products(context: Context, payload: Payload, link: str, rows: Rows, weight: Array) -> _Grams:
    samples = context.baseline.samples
    felt = _body_rows(context, payload, link, rows, weight)
    numbers = range(len(samples.trials))
    grams, begin, at = [], [], rows.shared.shape[2]
    for j in range(rows.n_joints):
        matrix = np.column_stack([rows.shared[j], rows.own[j], felt[j], rows.y[j]])
        grams.append(np.array([matrix[rows.trial == k].T @ matrix[rows.trial == k] for k in numbers]))
        begin.append(at)
        at += rows.own[j].shape[1]
    return _Grams(tuple(grams), rows.shared.shape[2], tuple(begin), at)


def _body_rows(context: Context, payload: Payload, link: str, rows: Rows, weight: Array) -> list[Array]:
    """Weighted rows of a body's ten columns, one ``(n_rows, 10)`` a joint."""
    base = context.baseline
    if base.free:
        # Of bodies that are fitted the columns are there, in a basis without blind directions.
        first = 10 * payload.locations(context).index(link)
        here = slice(first, first + 10)
        back = base.basis[here] / prior_spread(model_phi(base.samples))[here, None] ** 2
        return [shared @ back.T for shared in rows.shared]
    columns = payload.shape(context, link, ()).columns
    nothing = np.zeros((rows.y.shape[1], 10))
    return [
        base.samples.to_rows(columns[j], [j] * columns[j].shape[1]) * weight[j][:, None]
        if j in columns
        else nothing
        for j in range(rows.n_joints)
    ]


# What is left and follows something: generic functions of one thing, chosen by blocks left out.

# Knots of a piecewise linear function, and how many functions one channel may have.
_KNOTS, _MOST = 9, 3
_RIDGE = 1e-4


@dataclass(frozen=True, eq=False)
class GenericFunction:
    """A function of one thing.

    Attributes:
        follows: what it follows.
        knots: where; empty where it is of more than one thing.
        rows: ``(n_rows, n_hats)`` weighted.
    """

    follows: str
    knots: Array
    rows: Array


@dataclass(frozen=True, eq=False)
class Unnamed:
    """What a generic function takes of what is left of a channel.

    Attributes:
        follows: what it follows.
        power: mean square that it takes on the trials that judge.
        knots: of the function.
        torque: its values there.
    """

    follows: str
    power: float
    knots: Array
    torque: Array


def unnamed_of(model: Model, context: Context, weight: Array, floor: Array, joint: int) -> list[Unnamed]:
    """Generic functions of what a model leaves of a joint, the best first.

    Args:
        model: the model of the gap.
        weight: ``(n_joints, n_rows)`` square roots of the rows' weights.
        floor: ``(n_joints,)`` noise in the rows' band.
    """
    rows = model.design.rows
    rest = model.residual[joint].copy()
    inside, judged = rows.block >= 0, rows.judged >= 0
    if float((rest[judged] ** 2).mean()) <= float(floor[joint]) ** 2:
        return []
    library, found = _generic_functions(context, weight, joint), []
    for _ in range(_MOST):
        best = _best_function(library, rest, rows.block, inside, rows.trial)
        if best is None:
            break
        x = _solve_ridge(best.rows[inside], rest[inside])
        after = rest - best.rows @ x
        power = float((rest[judged] ** 2).mean() - (after[judged] ** 2).mean())
        if power <= 0.0:
            break
        # Hats, not what was filtered: the function itself.
        found.append(
            Unnamed(best.follows, power, best.knots, x if len(best.knots) == len(x) else np.zeros(0))
        )
        rest, library = after, [item for item in library if item.follows != best.follows]
    return found


def _best_function(
    library: list[GenericFunction],
    rest: Array,
    block: NDArray[np.int64],
    inside: NDArray[np.bool_],
    trial: NDArray[np.int64],
) -> GenericFunction | None:
    """The function by which blocks left out are predicted best; None where none is worth it."""
    total = float((rest[inside] ** 2).sum())
    best, most = None, THRESHOLDS.unnamed
    for item in library:
        gain = 1.0 - _left_out(item.rows, rest, block) / total
        if gain <= most:
            continue
        x = _solve_ridge(item.rows[inside], rest[inside])
        share = float(effective_share((rest - item.rows @ x)[None], inside, trial)[0])
        nats = -0.5 * share * inside.sum() * np.log(1.0 - gain)
        if nats > THRESHOLDS.price + 0.5 * item.rows.shape[1]:
            best, most = item, gain
    return best


def _left_out(columns: Array, rest: Array, block: NDArray[np.int64]) -> float:
    """Sum of squares of blocks that were left out of the fit."""
    n = int(block.max()) + 1
    members = [np.flatnonzero(block == b) for b in range(n)]
    grams = np.array([columns[m].T @ columns[m] for m in members])
    right = np.array([columns[m].T @ rest[m] for m in members])
    total, sums = grams.sum(axis=0), right.sum(axis=0)
    ridge = _RIDGE * np.diag(np.diag(total)) + 1e-12 * np.eye(len(total))
    x = np.linalg.solve(total - grams + ridge, (sums - right)[..., None])[..., 0]
    inner = (grams @ x[..., None])[..., 0] - 2.0 * right
    return float((rest[block >= 0] ** 2).sum() + (inner * x).sum())


def _solve_ridge(columns: Array, rest: Array) -> Array:
    gram = columns.T @ columns
    ridge = _RIDGE * np.diag(np.diag(gram)) + 1e-12 * np.eye(len(gram))
    return np.asarray(np.linalg.solve(gram + ridge, columns.T @ rest))


def _generic_functions(context: Context, weight: Array, joint: int) -> list[GenericFunction]:
    """Functions of everything that a channel's residual may follow."""
    base, samples = context.baseline, context.baseline.samples
    sign, load = context.friction_sign(joint), base.rigid[:, joint]
    signals = {
        "position": [context.q[:, joint]],
        "velocity": [context.v[:, joint]],
        "acceleration": [context.a[:, joint]],
        "load": [load],
        "time": [context.session_time],
    }
    factors = {"load": [np.ones_like(sign), sign], "time": [np.ones_like(sign), sign]}
    for other, name in enumerate(context.joints):
        if other != joint:
            signals[name] = [context.q[:, other]]
    made = []
    for follows, (signal,) in signals.items():
        knots = _spline_knots(signal)
        if len(knots) < 3:
            continue
        hats = _hat_functions(signal, knots)
        columns = np.column_stack([hats * f[:, None] for f in factors.get(follows, [np.ones_like(sign)])])
        rows = samples.to_rows(columns, [joint] * columns.shape[1]) * weight[joint][:, None]
        made.append(GenericFunction(follows, knots, rows))
    return made


def _spline_knots(signal: Array) -> Array:
    """Where a function of a signal has its knots: as many values between each two."""
    return np.unique(np.round(np.quantile(signal, np.linspace(0.0, 1.0, _KNOTS)), 9))


def _hat_functions(signal: Array, knots: Array) -> Array:
    """Piecewise linear functions that are one at a knot and zero at its neighbours, ``(n, n_knots)``."""
    return np.column_stack([np.interp(signal, knots, unit) for unit in np.eye(len(knots))])
