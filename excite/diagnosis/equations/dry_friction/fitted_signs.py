"""How the joints' dry friction changes sign: over which width, or over which deflection of bristles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.friction_sign import (
    PLAIN,
    SIGNS,
    WIDTH_BOUNDS,
    SignChange,
    width_bounds,
)
from excite.diagnosis.equations.joint_torque import Solver
from excite.diagnosis.equations.own_columns import (
    BREAKAWAY_BOUNDS,
    COULOMB,
    DAMPED_BOUNDS,
    FIRST_STEP,
    best_sign,
    own_terms,
    refine_number,
)

# Delay that is not told from none, step of its derivative, and of the search's end [s].
_LEAST, _STEP, _NEAR = 1e-3, 1e-3, 3e-4
_ITERATIONS = 6
# Torques that are 30 ms late or more the doctor has moved by then [s].
_LATEST = 0.04
# By how much a delay has to lower the loss where bristles were found.
_CLEARLY = 0.05
# Width of a straight sign change over that of the smooth one, a hyperbolic tangent, that is most like it.
_STRAIGHTER = 1.3


def fit_first_signs(baseline: Baseline, *, late: bool) -> Baseline:
    """The sign changes of a baseline that has been fitted with any: grids first, then between the grid's.

    Args:
        baseline: fitted.
        late: whether torques may be late.

    Returns:
        The baseline with its sign changes, fitted.
    """
    plain = baseline
    for _ in range(2):
        baseline = _choose_signs(baseline, keep=False)
    found = _refine_signs(baseline)
    return _unless_late(found, plain) if late else found


def _unless_late(found: Baseline, plain: Baseline) -> Baseline:
    """Sign changes as torques that come late would show them, where these leave less than bristles do.

    Bristles bend after the velocity has changed sign, and take most of what shows of a torque that comes late where
    motion is slow. A delay is one number for all joints; it is told beside friction without memory, and its torques are
    then searched for sign changes as all are.

    Args:
        found: with the sign changes of torques that are in time.
        plain: fitted with any that have no memory.
    """
    if not any(sign.has_bristles for sign in found.signs):
        return found
    plain = _choose_signs(plain, keep=False, signs=PLAIN)
    late, delay = _fit_delay(plain, plain, 0.0, lambda b: _choose_signs(b, keep=False, signs=PLAIN))
    if delay < _LEAST:
        return found
    # A robot whose torques are late may have bristles too, which have made that delay longer.
    late, delay = _fit_delay(plain, _refine_signs(_choose_signs(late, keep=False)), delay, _refine_signs)
    if _residual_loss(late) >= _residual_loss(found) - _CLEARLY:
        return found
    moved = plain.with_signs(late.signs, late.rotorless)
    # Fitted to torques that are not in time, friction and bodies would be bent again, and what a delay makes of them.
    fit = replace(late.fit, equations=moved.solver.equations, held=late.fit.own_coefs)
    return replace(moved.with_fit(fit), late=delay)


def _fit_delay(
    plain: Baseline, late: Baseline, delay: float, turned: Callable[[Baseline], Baseline]
) -> tuple[Baseline, float]:
    """The equations at torques that are in time, and the delay [s], by Gauss and Newton's steps from one on."""
    for _ in range(2 * _ITERATIONS):
        later = _in_time(plain, delay + _STEP)
        step = _newton_step(late, [(later[j] - y) / _STEP for j, y in enumerate(late.solver.equations.y)])
        best = float(np.clip(delay + step, 0.0, _LATEST))
        if abs(best - delay) < _NEAR:
            break
        in_time = Solver(replace(late.solver.equations, y=_in_time(plain, best)))
        moved = turned(replace(late, solver=in_time).refit())
        if _residual_loss(moved) >= _residual_loss(late):
            break
        late, delay = moved, best
    return late, delay


def refit_signs(baseline: Baseline) -> Baseline:
    """The sign changes searched anew: an effect that was missing may have bent them."""
    if not COULOMB.is_modelled(baseline.modelled):
        return baseline
    return _refine_signs(_choose_signs(baseline, keep=True))


def _choose_signs(baseline: Baseline, *, keep: bool, signs: Sequence[SignChange] = SIGNS) -> Baseline:
    """The best of the grid at every joint, fitted; those so far where nothing is clearly better and ``keep``."""
    terms, use = own_terms(baseline.modelled), baseline.samples.identification_rows
    rest, chosen = baseline.fit.before_own, []
    for j, now in enumerate(baseline.signs):
        # Damping of bristles acts where they bend, which is left out of a joint that sticks: any size of it would do.
        told = [s for s in signs if not (s.has_damping and j in baseline.samples.sticking)]
        tried = told if now in told else [*told, now]
        bank = [rows[use] for rows in baseline.rows_of_signs(terms, j, tried)]
        chosen.append(tried[best_sign(rest[j][use], bank, tried, tried.index(now) if keep else None)])
    if tuple(chosen) == baseline.signs:
        return baseline
    return baseline.with_signs(chosen).refit()


def _refine_signs(baseline: Baseline) -> Baseline:
    """Widths and breakaways between those of the grid, and speeds at which the damping of bristles dies out."""
    signs = [_refine_sign(baseline, j, sign) for j, sign in enumerate(baseline.signs)]
    found = baseline.with_signs(signs).refit()
    # No bristle drives what bends it.
    passive = [
        sign._replace(damped_below=0.0) if sign.has_damping and own[-1] <= 0.0 else sign
        for sign, own in zip(found.signs, found.fit.own_coefs, strict=True)
    ]
    return found if tuple(passive) == found.signs else found.with_signs(passive).refit()


def _refine_sign(baseline: Baseline, j: int, sign: SignChange) -> SignChange:
    """One joint's sign change, a number of it after the other; without memory in either of two shapes."""
    terms, use = own_terms(baseline.modelled), baseline.samples.identification_rows
    target = baseline.fit.before_own[j]

    def search_number(name: str, bounds: tuple[float, float], begun: SignChange) -> SignChange:
        def rows_at(value: float) -> Array:
            return baseline.own_rows(terms, j, begun.with_number(name, value))

        value = float(getattr(begun, name))
        return begun.with_number(name, refine_number(target, rows_at, value, rows_at(value), use, bounds))

    if sign.has_bristles:
        sign = search_number("breakaway", BREAKAWAY_BOUNDS, sign)
        damped = sign.has_damping and np.isfinite(sign.damped_below)
        return search_number("damped_below", DAMPED_BOUNDS, sign) if damped else sign
    sign = search_number("width", width_bounds(baseline.samples, j, straight=sign.straight), sign)
    if sign.straight:
        return sign
    low, high = width_bounds(baseline.samples, j, straight=True)
    # A search that ended at its bound says nothing of how far beyond it the width is.
    wide = [high, 0.5 * high] if sign.width * FIRST_STEP > WIDTH_BOUNDS[1] else []
    tried = [
        sign,
        *(sign._replace(width=w, straight=True) for w in (min(sign.width * _STRAIGHTER, high), *wide)),
    ]
    best = tried[best_sign(target[use], [baseline.own_rows(terms, j, s)[use] for s in tried], tried)]
    return search_number("width", (low, high), best) if best.straight else sign


def _newton_step(baseline: Baseline, slopes: Sequence[Array]) -> float:
    """Gauss and Newton's step of a number from what its growth by one adds to each joint's residual, ``(n_rows,)``."""
    use, up, down = baseline.samples.identification_rows, 0.0, 0.0
    for slope, left in zip(slopes, baseline.fit.residual, strict=True):
        weight = 1.0 / max(float((left[use] ** 2).mean()), 1e-300)
        up -= weight * float(slope[use] @ left[use])
        down += weight * float(slope[use] @ slope[use])
    return up / max(down, 1e-300)


def _in_time(baseline: Baseline, delay: float) -> Array:
    """What the equations would have to explain if torques came late by a delay [s], ``(n_joints, n_rows)`` weighted."""
    samples, e = baseline.samples, baseline.solver.equations
    moved = [
        np.column_stack([np.interp(t.time + delay, t.time, tau) - tau for tau in t.tau.T])
        for t in samples.trials
    ]
    return np.asarray(e.y + samples.to_rows(moved, range(len(samples.joints))).T * baseline.root_weight)


def _residual_loss(baseline: Baseline) -> float:
    """Of what is left itself: noise above the band, which bounds the weights, may be the jumps of friction."""
    power = (baseline.fit.residual[:, baseline.samples.identification_rows] ** 2).mean(axis=1)
    return float(np.log(np.maximum(power, 1e-300)).sum())
