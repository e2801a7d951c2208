"""How the joints' dry friction changes sign: over which width or deflection, and how long before the velocity does."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.friction_sign import SIGNS, SignChange
from excite.diagnosis.equations.own_columns import (
    BREAKAWAY_BOUNDS,
    COULOMB,
    DAMPED_BOUNDS,
    WIDTH_BOUNDS,
    best_sign,
    own_terms,
    refined,
)

# A stop in passing is over after that, and what the filter makes of it [s].
_LONGEST = 0.02
# Lead that is not told from none, step of its derivative, and of the search's end [s].
_LEAST, _STEP, _NEAR = 1e-3, 1e-3, 3e-4
_ITERATIONS = 6
# A lead that joints have where they have one [s], and by how much it has to lower the loss where none was found.
_TYPICAL, _CLEARLY = 5e-3, 0.05


def first_signs(baseline: Baseline, *, leads: bool) -> Baseline:
    """The sign changes of a baseline that has been fitted with any: grids, then the lead, then between the grid's.

    Args:
        baseline: fitted.
        leads: whether there may be a lead.

    Returns:
        The baseline with its sign changes, fitted.
    """
    for _ in range(2):
        baseline = _chosen(baseline, keep=False)
    if not leads:
        return _refined(baseline)
    led = _with_lead(baseline)
    first = baseline if led is baseline else _chosen(led, keep=False)
    if _damped(first) != _damped(led):
        # A lead found beside damping is less than without.
        first = _with_lead(first)
    if led is not baseline and not any(_damped(first)):
        return _refined(first)
    # Signs that were chosen without a lead may hide one, as damping of bristles does.
    begun = _fitted(baseline.with_signs(baseline.signs, _TYPICAL))
    again = _with_lead(_chosen(begun, keep=False))
    for _ in range(2):
        before, again = again, _with_lead(_chosen(again, keep=False))
        if again is before:
            break
    return _refined(again if _loss(again) < _loss(first) - _CLEARLY else first)


def signs_again(baseline: Baseline) -> Baseline:
    """The sign changes searched anew: an effect that was missing may have bent them."""
    if not COULOMB.asked(baseline.modelled):
        return baseline
    return _refined(_chosen(_with_lead(baseline), keep=True))


def _chosen(baseline: Baseline, *, keep: bool) -> Baseline:
    """The best of the grid at every joint, fitted; those so far where nothing is clearly better and ``keep``."""
    terms, use = own_terms(baseline.modelled), baseline.samples.identification
    rest, signs = baseline.fit.before_own, []
    for j, now in enumerate(baseline.signs):
        tried = SIGNS if now in SIGNS else (*SIGNS, now)
        bank = [rows[use] for rows in baseline.rows_of_signs(terms, j, tried)]
        signs.append(tried[best_sign(rest[j][use], bank, tried, tried.index(now) if keep else None)])
    if tuple(signs) == baseline.signs:
        return baseline
    return _fitted(baseline.with_signs(signs, baseline.samples.lead))


def _refined(baseline: Baseline) -> Baseline:
    """Widths and breakaways between those of the grid, and speeds at which the damping of bristles dies out."""
    signs = [_finer(baseline, j, sign) for j, sign in enumerate(baseline.signs)]
    found = _fitted(baseline.with_signs(signs, baseline.samples.lead))
    # No bristle drives what bends it.
    passive = [
        sign._replace(damped_below=0.0) if sign.damped and own[-1] <= 0.0 else sign
        for sign, own in zip(found.signs, found.fit.own, strict=True)
    ]
    return found if tuple(passive) == found.signs else _fitted(found.with_signs(passive, found.samples.lead))


def _finer(baseline: Baseline, j: int, sign: SignChange) -> SignChange:
    """One joint's sign change, a number of it after the other."""
    terms, use = own_terms(baseline.modelled), baseline.samples.identification
    searched = {"breakaway": BREAKAWAY_BOUNDS} if sign.bent else {"width": WIDTH_BOUNDS}
    if sign.damped and np.isfinite(sign.damped_below):
        searched["damped_below"] = DAMPED_BOUNDS
    for name, bounds in searched.items():

        def at(value: float, name: str = name, sign: SignChange = sign) -> SignChange:
            return sign._replace(**{name: value})

        def rows_at(value: float, at: Callable[[float], SignChange] = at) -> Array:
            return baseline.own_rows(terms, j, at(value))

        value = float(getattr(sign, name))
        sign = at(refined(baseline.fit.before_own[j], rows_at, value, rows_at(value), use, bounds))
    return sign


def _damped(baseline: Baseline) -> tuple[bool, ...]:
    return tuple(sign.damped for sign in baseline.signs)


def _with_lead(baseline: Baseline) -> Baseline:
    """The lead by Gauss and Newton's steps, all joints together: what hides in one joint does not decide it."""
    start = baseline
    use = baseline.samples.identification
    for _ in range(_ITERATIONS):
        lead = baseline.samples.lead
        later = baseline.with_signs(baseline.signs, lead + _STEP)
        up = down = 0.0
        for j, own in enumerate(baseline.fit.own):
            old, new = (b.solver.equations.own[j][use] for b in (baseline, later))
            slope = (new - old) @ own / _STEP
            rest = baseline.fit.residual[j][use]
            weight = 1.0 / max(float((rest**2).mean()), 1e-300)
            up += weight * float(slope @ rest)
            down += weight * float(slope @ slope)
        best = float(np.clip(lead + up / max(down, 1e-300), 0.0, _LONGEST))
        best = best if best >= _LEAST else 0.0
        if abs(best - lead) < _NEAR:
            break
        moved = _fitted(baseline.with_signs(baseline.signs, best))
        if _loss(moved) >= _loss(baseline):
            break
        baseline = moved
    return baseline if baseline.samples.lead != start.samples.lead else start


def _fitted(baseline: Baseline) -> Baseline:
    return baseline.updated(baseline.solver.fit())


def _loss(baseline: Baseline) -> float:
    """Of what is left itself: noise above the band, which bounds the weights, may be the jumps of friction."""
    power = (baseline.fit.residual[:, baseline.samples.identification] ** 2).mean(axis=1)
    return float(np.log(np.maximum(power, 1e-300)).sum())
