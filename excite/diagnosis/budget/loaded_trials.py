"""Whether some of a record's trials have a body that the others have not, and which trials these are."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Rows
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.bodies.part_time_payload import PartTimePayload
from excite.diagnosis.effects.bodies.payload import Payload
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.equations.baseline_fit import model_phi, prior_spread
from excite.finding import Finding, list_names

# Rounds in which the joints' weights follow what is left.
_ROUNDS = 3
# Share of a body by which a trial with all of it, or without it, may differ from that: 0.01 on a UR10e whose tool of
# 2.8 kg is there in one of five recordings, 0.01 on a simulated pick and place with 0.8 kg in half of the trials; on an
# AirBot, whose nine recordings have the same load, the trials that some body suits best have up to 0.29 more or less.
_ALIKE = 0.15


@dataclass(frozen=True, eq=False)
class _Link:
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
    def total(self) -> tuple[Array, ...]:
        """Of all trials."""
        return tuple(g.sum(axis=0) for g in self.grams)

    def fitted(self, trials: Collection[int], weight: Array) -> tuple[Array, Array]:
        """Parameters with the body in some trials, its ten last; and sums of squares left of each joint."""
        here = sorted(trials)
        n = self.size + 10
        normal, right = np.eye(n), np.zeros(n)
        normal[self.size :, self.size :] = np.diag(1.0 / Payload().widths ** 2)
        numbers, made = [], []
        for j, (g, whole) in enumerate(zip(self.grams, self.total, strict=True)):
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

    def more(self, trials: Collection[int], weight: Array) -> Array:
        """How much more of the body than all or nothing each trial asks for, beside that fit, ``(n_trials,)``."""
        x, _ = self.fitted(trials, weight)
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
        products = _products(context, payload, link, rows, weight)
        inverse = np.full(rows.n_joints, 1.0)
        for _ in range(_ROUNDS):
            _, none = products.fitted((), inverse)
            inverse = 1.0 / np.maximum(none / count, rows.floor**2)
        there, left = _trials(products, inverse, len(names), learnt)
        score = float(
            (0.5 * count * np.log(np.maximum(none, 1e-300) / np.maximum(left, count * rows.floor**2))).sum()
        )
        if there and (best is None or score > best[0]):
            more = products.more(there, inverse)
            # Beside bodies that are fitted, what some trials have less is what the others have more.
            x, _ = products.fitted(there, inverse)
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


def _trials(products: _Link, weight: Array, n: int, learnt: set[int]) -> tuple[frozenset[int], Array]:
    """Trials in which a body explains most, and sums of squares that are left of each joint."""
    there: frozenset[int] = frozenset()
    left = products.fitted(there, weight)[1]
    while True:
        tried = [there ^ {k} for k in range(n)]
        tried = [some for some in tried if some]
        found = [(products.fitted(some, weight)[1], some) for some in tried]
        less, some = min(found, key=lambda item: float(item[0] @ weight))
        if float(less @ weight) >= float(left @ weight):
            break
        there, left = some, less
    # Learnt from both with and without it.
    return (there, left) if there & learnt and learnt - there else (frozenset(), left)


def _products(context: Context, payload: Payload, link: str, rows: Rows, weight: Array) -> _Link:
    samples = context.baseline.samples
    felt = _body_rows(context, payload, link, rows, weight)
    numbers = range(len(samples.trials))
    grams, begin, at = [], [], rows.shared.shape[2]
    for j in range(rows.n_joints):
        matrix = np.column_stack([rows.shared[j], rows.own[j], felt[j], rows.y[j]])
        grams.append(np.array([matrix[rows.trial == k].T @ matrix[rows.trial == k] for k in numbers]))
        begin.append(at)
        at += rows.own[j].shape[1]
    return _Link(tuple(grams), rows.shared.shape[2], tuple(begin), at)


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
        base.samples.rows(columns[j], [j] * columns[j].shape[1]) * weight[j][:, None]
        if j in columns
        else nothing
        for j in range(rows.n_joints)
    ]
