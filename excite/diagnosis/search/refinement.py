"""A hypothesis made finer: its sign change, its non-linear parameters, its richer forms, and the baseline with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.friction_sign import WIDTHS, SignChange
from excite.diagnosis.equations.joint_torque import Solver
from excite.diagnosis.equations.own_columns import COULOMB, WIDTH_BOUNDS
from excite.diagnosis.search.hypotheses import Hypothesis, Search

# A richer form of an effect has to lower the loss by so much.
_RICHER = 0.01
# Loss by which a search on a baseline that has moved has gone wrong.
_WORSE = 0.1
# A richer form that begins so much worse does not come near.
_FAR = 1.0
# Sizes of the simplex, relative, of one search after the other.
_STEPS = (0.15, 0.1, 0.05, 0.05)
# Share of the noise that what a first order leaves out has to reach somewhere.
_HIDDEN = 0.3
# Widths or breakaways that are tried with friction, in multiples of the baseline's.
_FACTORS = (0.25, 0.4, 0.6, 0.8, 1.0, 1.25, 1.6, 2.5, 4.0)


def price(item: Hypothesis) -> float:
    """Loss with the price of parameters, per effective sample (Schwarz 1978), samples white in the band."""
    count = effective_samples(item.baseline)
    return item.loss + 0.5 * item.n_parameters * float(np.log(count)) / count


def effective_samples(baseline: Baseline) -> float:
    """Independent samples of the identification rows, were what is left white in their band."""
    samples = baseline.samples
    return float(2.0 * samples.bands.rows_hz / samples.bands.rate_hz * samples.identification.sum())


def refine_with_width(search: Search, start: Hypothesis) -> Hypothesis:
    """Local search; for friction what the joint's sign change follows is searched along with it."""
    best = search.refine(start)
    base = search.context.baseline
    if not best.effect.friction or not COULOMB.asked(base.modelled):
        return best
    j = search.context.row(best.location)
    sign = base.signs[j]
    if not sign.bent:
        widths = (float(np.clip(f * sign.width, *WIDTH_BOUNDS)) for f in _FACTORS)
        return _along(search, best, j, tuple(SignChange(width) for width in widths), len(_FACTORS) // 2)
    further = tuple(sign._replace(breakaway=f * sign.breakaway) for f in _FACTORS)
    best = _along(search, best, j, further, len(_FACTORS) // 2)
    # Bristles that the baseline believed in may have stood in for what it lacked.
    middle = len(WIDTHS) // 2
    plain = tuple(SignChange(width) for width in WIDTHS)
    other = _along(search, _with_sign(search, best, j, plain[middle]), j, plain, middle)
    return other if other.loss < best.loss - 1e-3 else best


def _along(search: Search, best: Hypothesis, j: int, signs: tuple[SignChange, ...], place: int) -> Hypothesis:
    """The best of neighbouring sign changes, from the one at ``place`` as far as it gets better."""
    for step in (1, -1):
        k = place + step
        while 0 <= k < len(signs):
            item = _with_sign(search, best, j, signs[k])
            if item.loss >= best.loss - 1e-3:
                break
            best, k = item, k + step
    return best


def _with_sign(search: Search, item: Hypothesis, j: int, sign: SignChange) -> Hypothesis:
    """A hypothesis on a baseline in which a joint's friction changes sign otherwise."""
    base = search.context.baseline
    signs = (*base.signs[:j], sign, *base.signs[j + 1 :])
    moved = replace(base, solver=search.solver).with_signs(signs, base.samples.lead)
    return Search(Context(moved), moved.solver).refine(item, evaluations=6, step=0.15)


def polished(item: Hypothesis) -> Hypothesis:
    """The same effect with finer non-linear parameters, richer forms, and predictions at its own fit."""
    item = _finer(item)
    for form in item.effect.richer:
        search = Search(Context(item.baseline), item.baseline.solver)
        begun = [search.try_at(form, item.location, theta) for theta in form.starts(item.theta)]
        found = [start for start in begun if start is not None and start.loss < item.loss + _FAR]
        if not found:
            continue
        new = search.refine(min(found, key=lambda start: start.loss), evaluations=14)
        if price(new) < price(item) - _RICHER and (new.settled or not item.settled):
            item = _finer(new)
    return _closer(item)


def _closer(item: Hypothesis) -> Hypothesis:
    """The same with what its first order leaves out, where the noise does not hide that."""
    form = item.effect.closer
    if form is None or item.columns.offset is None:
        return item
    near = Search(Context(item.baseline), item.baseline.solver).try_at(form, item.location, item.theta)
    if near is None or near.columns.offset is None:
        return item
    change = np.sqrt(((near.columns.offset - item.columns.offset) ** 2).mean(axis=1))
    if (change < _HIDDEN * item.baseline.solver.equations.floor).all():
        return item
    best = _finer(near)
    return best if best.loss < item.loss and (best.settled or not item.settled) else item


def in_richer_forms(search: Search, effect: Effect, location: str) -> list[Hypothesis]:
    """The richer forms of an effect at a place, each refined; where the textbook's form does not fit, it may."""
    plain = search.coarse(effect, location)
    theta = plain.theta if plain is not None else next(iter(effect.grid(search.context, location)), None)
    made: list[Hypothesis] = []
    if theta is None:
        return made
    for form in effect.richer:
        found = []
        for starts in (form.starts(theta), form.own_starts(search.context, location)):
            begun = [search.try_at(form, location, start) for start in starts]
            likely = [start for start in begun if start is not None]
            if likely:
                found.append(search.refine(min(likely, key=lambda start: start.loss)))
        if found:
            made.append(min(found, key=lambda item: item.loss))
    return made


def _finer(item: Hypothesis) -> Hypothesis:
    """Searched again and again with what has been found in the baseline, as long as that gains something."""
    original = item.baseline
    for step in _STEPS:
        new = _again(original, item, step)
        if new.loss > item.loss + _WORSE:
            # What a soft gear turns depends on what it is itself: the fit has overshot.
            new = _again(original, item, step, share=0.5)
        if item.settled and not new.settled:
            return item
        if new.loss > item.loss - 1e-3:
            return item if new.loss > item.loss else new
        item = new
    return item


def _again(original: Baseline, item: Hypothesis, step: float, share: float = 1.0) -> Hypothesis:
    """The search repeated on a baseline that has gone a share of the way to what its fit with the effect says."""
    here, fit = item.baseline.fit, item.fit
    there = replace(fit, shared=here.shared + share * (fit.shared - here.shared))
    moved = replace(original.updated(there), solver=original.solver)
    search = Search(Context(moved), original.solver)
    return search.refine(_carried_over(search, item), evaluations=12, step=step)


def _carried_over(search: Search, item: Hypothesis) -> Hypothesis:
    """Where to begin on a baseline that has moved: at the same parameters, or at those that now say the same."""
    old, now = Context(item.baseline), search.context
    theta = item.effect.carried_over(old, now, item.location, item.theta)
    if theta == item.theta:
        return item
    begun = (search.try_at(item.effect, item.location, start) for start in (item.theta, theta))
    return min((start for start in begun if start is not None), key=lambda start: start.loss, default=item)


def extended(item: Hypothesis) -> Baseline:
    """The baseline with an effect in it: its columns shared ones with hardly any prior, its offset taken off."""
    baseline, fit = item.baseline, item.fit
    e = baseline.solver.equations
    y, shared, basis = e.y, e.shared, baseline.basis
    if item.columns.offset is not None:
        y = y - item.columns.offset
    if item.columns.extra is not None:
        scale = 10.0 * np.maximum(np.abs(fit.extra), 10.0 * np.maximum(fit.extra_std, 1e-12))
        shared = np.concatenate([shared, item.columns.extra * scale], axis=2)
        basis = np.hstack([basis, np.zeros((len(basis), len(scale)))])
    solver = Solver(replace(e, y=y, shared=shared))
    torque = torque_of(item)
    added, drive = baseline.added, baseline.added_drive
    added, drive = (added + torque, drive) if item.effect.moves else (added, drive + torque)
    old = np.concatenate([baseline.fit.shared, np.zeros(basis.shape[1] - len(baseline.fit.shared))])
    fixed = replace(
        baseline,
        solver=solver,
        basis=basis,
        fit=replace(baseline.fit, shared=old),
        rigid=baseline.rigid + added - baseline.added,
        added=added,
        added_drive=drive,
    )
    return fixed.updated(solver.fit())


def torque_of(item: Hypothesis) -> Array:
    """What a fitted effect adds to the torques at full rate, ``(n_samples, n_joints)`` [N·m]."""
    shape = item.effect.shape(Context(item.baseline), item.location, item.theta)
    torque = np.zeros_like(item.baseline.rigid)
    for j, columns in shape.columns.items():
        torque[:, j] += columns @ item.fit.extra
    for j, values in shape.offset.items():
        torque[:, j] += values
    return torque
