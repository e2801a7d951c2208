"""What a joint's own drive adds to its torque: friction, rotor inertia, an offset, and how friction changes sign."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.friction_sign import SignChange, damping_of_bristles, sign_of_motion
from excite.diagnosis.equations.samples import ArmSamples

# Bristles are believed where they lower the loss to this share, and so is their damping.
_BETTER = 0.95
# How a joint's friction changes sign is only thought over for a loss below this share.
_CHANGED = 0.98
# Factors between neighbouring values of the search, first and last.
_FIRST_STEP, _LAST_STEP = 1.5, 1.06

# What the search may reach: no velocity of a log tells less apart, nor deflections.
WIDTH_BOUNDS, BREAKAWAY_BOUNDS, DAMPED_BOUNDS = (1e-3, 0.06), (5e-5, 2e-2), (0.01, 0.3)


def own_names(modelled: tuple[str, ...]) -> tuple[str, ...]:
    """Terms of each joint's own that ``modelled`` asks for, in order."""
    names: list[str] = [n for n in ("viscous_friction", "coulomb_friction", "armature") if n in modelled]
    if "torque_bias" in modelled or "coulomb_asymmetry" in modelled:
        names.append("torque_bias")
    return tuple(names)


def coulomb_level(modelled: tuple[str, ...], own: Array) -> float:
    """Coulomb friction among a joint's own coefficients ``own (n_own,)`` [N·m]; 0 where it is not modelled."""
    names = own_names(modelled)
    return float(own[names.index("coulomb_friction")]) if "coulomb_friction" in names else 0.0


def own_signals(samples: ArmSamples, names: tuple[str, ...], joint: int, sign: SignChange) -> Array:
    """Full-rate columns of a joint's own terms, ``(n_samples, n_own)``.

    Of its motor first; then the friction and rotor inertia of other motors that turn with it; last the damping of
    its bristles, where dry friction has some.
    """
    columns = []
    for motor in samples.motors(joint):
        made = {
            "viscous_friction": lambda m=motor: samples.of_motor("v", m),
            "coulomb_friction": lambda m=motor: sign_of_motion(samples, m, sign),
            "armature": lambda m=motor: samples.of_motor("a", m),
            "torque_bias": lambda m=motor: np.ones(len(samples.of_motor("v", m))),
        }
        # Constants of two motors on one joint are one constant.
        columns += [made[n]() for n in names if motor == joint or n != "torque_bias"]
    if sign.damped and "coulomb_friction" in names:
        columns.append(damping_of_bristles(samples, joint, sign))
    return np.column_stack(columns) if columns else np.zeros((len(samples.stacked("v")), 0))


def best_sign(
    target: Array, columns: list[Array], tried: Sequence[SignChange], kept: int | None = None
) -> int:
    """Index of the best of the sign changes: bristles only where they are clearly better, no change without a gain.

    Args:
        target: ``(n_rows,)`` what a joint's own terms have to explain.
        columns: ``(n_rows, n_own)`` own terms, one for each of ``tried``.
        tried: the sign changes, those without bristles among them.
        kept: index of the sign change so far.
    """
    losses = np.array(
        [_loss(target, c, positive=sign.damped) for c, sign in zip(columns, tried, strict=True)]
    )
    kinds = np.array([int(sign.bent) + int(sign.damped) for sign in tried])
    found = int(np.argmin(np.where(kinds == 0, losses, np.inf)))
    # The plainer one unless what it lacks is seen.
    for kind in (1, 2):
        best = int(np.argmin(np.where(kinds == kind, losses, np.inf)))
        found = best if losses[best] < _BETTER * losses[found] else found
    return found if kept is None or losses[found] < _CHANGED * losses[kept] else kept


def refined(
    target: Array,
    rows_at: Callable[[float], Array],
    value: float,
    columns: Array,
    use: NDArray[np.bool_],
    bounds: tuple[float, float],
) -> float:
    """A number of a sign change searched between those of the grid: bisection of steps on a logarithmic scale.

    Args:
        target: ``(n_rows,)`` what a joint's own terms have to explain.
        rows_at: own terms ``(n_rows, n_own)`` at a value of it.
        value: where to begin.
        columns: the own terms there.
        use: ``(n_rows,)`` rows that are fitted.
        bounds: of it.

    Returns:
        The value.
    """
    low, high = bounds
    best, step = _loss(target[use], columns[use]), _FIRST_STEP
    while step > _LAST_STEP:
        moved = False
        for way in (step, 1.0 / step):
            if not low <= value * way <= high:
                continue
            new = rows_at(value * way)
            loss = _loss(target[use], new[use])
            if loss < best:
                value, best, moved = value * way, loss, True
                break
        step = step if moved else step**0.5
    return value


def _loss(target: Array, columns: Array, *, positive: bool = False) -> float:
    """Sum of squares that is left; infinite where the last coefficient has to be positive and is not."""
    x = np.linalg.lstsq(columns, target, rcond=None)[0]
    return np.inf if positive and x[-1] <= 0.0 else float(((target - columns @ x) ** 2).sum())
