"""The model of the gap of a record: columns made, searched, made again at what was found, and searched again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.blocks import blocks_of
from excite.diagnosis.budget.design import Design, Rows
from excite.diagnosis.budget.joint_fit import Model, fit
from excite.diagnosis.budget.library import Library, with_begun
from excite.diagnosis.budget.refine import Beside, Refiner
from excite.diagnosis.budget.search import Search
from excite.diagnosis.budget.terms import Term, TermMaker
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.own_columns import COULOMB, own_signals, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.regressor.kernels import inverse_dynamics

# The second search has predictions, and non-linear parameters, that the first one found.
_PASSES = 2
# Of what might stand in a term's place, how many have their non-linear parameters searched as well.
_INSTEAD = 2
# Joints at which resonances are searched, and how far above the noise they have to stand [power].
_RESONANT, _STANDS = 3, 1.5


@dataclass(frozen=True, eq=False)
class Found:
    """A model of the gap.

    Attributes:
        search: the last search, with its design and rivals.
        baseline: what every model begins with, fitted.
        context: predictions at which the last columns were made.
    """

    search: Search
    baseline: Baseline
    context: Context


def model_of_gap(
    samples: ArmSamples, modelled: tuple[str, ...], effects: tuple[Effect, ...], floor: Array
) -> Found:
    """Search for the model of a record's gap.

    Args:
        samples: the samples.
        modelled: words of ``modelled``.
        effects: that may be named.
        floor: ``(n_joints,)`` noise in the rows' band.
    """
    full = fit_baseline(samples, with_begun(modelled), floor)
    library = Library(modelled, effects)
    rows = rows_of(full, modelled, floor)
    context = Context(full)
    kept: list[Term] | None = None
    near: list[Term] = []
    for number in range(_PASSES):
        maker = TermMaker(context, full.strict)
        begun = library.begun(maker)
        terms = [*begun, *library.candidates(maker)]
        if kept is None:
            chosen = list(range(len(begun)))
        else:
            terms, chosen = _with_kept(terms, kept, maker)
            terms += near
        design = Design(rows, tuple(terms))
        search = Search(design, context, fit(design, chosen), COULOMB.asked(modelled))
        search.run()
        context = Context(predicting(full, search.model, context))
        if number < _PASSES - 1:
            kept, near = _refined(search, TermMaker(context, full.strict))
    return Found(search, full, context)


def _refined(search: Search, maker: TermMaker) -> tuple[list[Term], list[Term]]:
    """Accepted terms at better non-linear parameters, and what might stand in their places at its best."""
    refiner, kept, near = Refiner(maker), [], []
    model = search.model
    for k in model.chosen:
        term = model.design.terms[k]
        if term.started or not (term.theta or term.effect.richer):
            kept.append(term)
            continue
        beside = Beside.of(
            fit(model.design, [i for i in model.chosen if i != k], model.weight, left_out=False)
        )
        kept.append(refiner.refined(beside, term, term.effect.richer))
        for other in search.instead(k, beside.model)[:_INSTEAD]:
            near.append(
                refiner.refined(beside, model.design.terms[other], model.design.terms[other].effect.richer)
            )
    return kept, near + _resonances(search, refiner)


def _resonances(search: Search, refiner: Refiner) -> list[Term]:
    """Effects with several non-linear parameters at the joints that have most left: no grid finds a resonance."""
    model = search.model
    beside, floor = Beside.of(model), model.design.rows.floor
    use = model.design.rows.block >= 0
    left = (model.residual[:, use] ** 2).mean(axis=1) / floor**2
    worst = [j for j in np.argsort(-left)[:_RESONANT] if left[j] > _STANDS]
    best: dict[tuple[str, str], tuple[float, Term]] = {}
    keys = {term.key for term in model.terms}
    for term in model.design.terms:
        if term.own not in worst or len(term.theta) < 2 or term.key in keys:
            continue
        gain = beside.gain(term)[0]
        if term.key not in best or gain > best[term.key][0]:
            best[term.key] = (gain, term)
    return [refiner.refined(beside, term) for _, term in best.values()]


def _with_kept(terms: list[Term], kept: list[Term], maker: TermMaker) -> tuple[list[Term], list[int]]:
    """Terms of a search, made anew, beside those of a new library."""
    chosen, made = [], list(terms)
    begun = {t.key: k for k, t in enumerate(terms) if t.started}
    for term in kept:
        if term.started:
            chosen.append(begun[term.key])
            continue
        full = len(term.kept) == len(term.effect.linear)
        again = maker.make(term.effect, term.location, term.theta, None if full else term.kept)
        if again is not None:
            chosen.append(len(made))
            made.append(again)
    return made, chosen


def rows_of(full: Baseline, modelled: tuple[str, ...], floor: Array) -> Rows:
    """Weighted rows of what is modelled."""
    samples, weight = full.samples, full.strict
    e = full.solver.equations
    again = weight / full.root_weight
    terms = own_terms(modelled)
    own = []
    for j, sign in enumerate(full.signs):
        columns = own_signals(samples, terms, j, sign)
        own.append(
            samples.rows(columns) * weight[j][:, None] if columns.shape[1] else np.zeros((e.y.shape[1], 0))
        )
    outside = not samples.identification.all()
    block = blocks_of(samples, identification=True)
    judged = blocks_of(samples, identification=False) if outside else block
    return Rows(
        e.shared * again[:, :, None], tuple(own), e.y * again, block, judged, samples.trial_of_row, floor
    )


def predicting(full: Baseline, model: Model, context: Context) -> Baseline:
    """The baseline with a model's predictions: rigid bodies, friction and all its terms."""
    s, index = full.samples, list(full.samples.index)
    n = full.basis.shape[1]
    x = model.x[:n]
    phi, rigid = full.phi, full.rigid
    if full.free:
        phi = full.phi + full.basis @ (x - full.fit.shared)
        q, v, a = (s.stacked(name) for name in ("q", "v", "a"))
        rigid = inverse_dynamics(s.robot.model, q, v, a, phi)[:, index]
    moved, driven = np.zeros_like(rigid), np.zeros_like(rigid)
    y = full.solver.equations.y.copy()
    back = full.root_weight / full.strict
    for k in model.chosen:
        term = model.design.terms[k]
        if term.started:
            continue
        torque = torque_of(term, model.parameters(k), context)
        (moved if term.effect.moves else driven)[:] += torque
        for j, block in term.columns.items():
            y[j] -= (block @ model.parameters(k)) * back[j]
    equations = replace(full.solver.equations, y=y)
    now = replace(full.fit, equations=equations, shared=x)
    terms = own_terms(full.modelled)
    own = [
        own_signals(s, terms, j, sign) @ o
        for j, (sign, o) in enumerate(zip(full.signs, now.own, strict=True))
    ]
    rigid = rigid + moved
    total = rigid + np.column_stack(own) + driven
    return replace(full, fit=now, phi=phi, rigid=rigid, total=total, added=moved, added_drive=driven)


def torque_of(term: Term, x: Array, context: Context) -> Array:
    """What a fitted term adds to the torques at full rate, ``(n_samples, n_joints)``."""
    shape = term.effect.shape(context, term.location, term.theta)
    torque = np.zeros_like(context.baseline.rigid)
    beta = term.beta(x)
    for j, columns in shape.columns.items():
        torque[:, j] += columns @ beta
    for j, values in shape.offset.items():
        torque[:, j] += values
    return torque
