"""What a joint's own drive adds to its torque: friction, rotor inertia, an offset, and how friction changes sign."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from excite.diagnosis.presliding import bend
from excite.diagnosis.samples import ArmSamples
from excite.robot.robot import Array

# Widths of the sign change of Coulomb friction that are tried [rad/s].
WIDTHS = (1.5e-3, 3e-3, 6e-3, 12e-3, 25e-3, 50e-3)
# Deflections over which dry friction builds up before it slips that are tried [rad]; 0: friction of the velocity.
BREAKAWAYS = (1.5e-4, 5e-4, 1.5e-3, 4e-3)
# Presliding is believed where it lowers the loss to this share.
_BETTER = 0.95
# How a joint's friction changes sign is only thought over for a loss below this share.
_CHANGED = 0.98
# Factors between neighbouring widths or breakaways of the search, first and last.
_FIRST_STEP, _LAST_STEP = 1.5, 1.06

# What the search may reach: no velocity of a log tells less apart, nor deflections.
WIDTH_BOUNDS, BREAKAWAY_BOUNDS = (1e-3, 0.06), (5e-5, 2e-2)
SIGNS = (*((w, 0.0) for w in WIDTHS), *((6e-3, b) for b in BREAKAWAYS))


def own_names(modelled: tuple[str, ...]) -> tuple[str, ...]:
    """Terms of each joint's own that ``modelled`` asks for, in order."""
    names: list[str] = [n for n in ("viscous_friction", "coulomb_friction", "armature") if n in modelled]
    if "torque_bias" in modelled or "coulomb_asymmetry" in modelled:
        names.append("torque_bias")
    return tuple(names)


def sign_of_motion(samples: ArmSamples, joint: int, width: float, breakaway: float = 0.0) -> Array:
    """What a motor's dry friction follows, ``(n_samples,)``: smoothed sign of its velocity, or with presliding."""
    v = samples.of_motor("v", joint)
    if breakaway <= 0.0:
        return samples.led(np.tanh(v / width))
    return samples.led(bend(np.ascontiguousarray(v), samples.starts, 1.0 / samples.rate_hz, breakaway))


def own_signals(
    samples: ArmSamples, names: tuple[str, ...], joint: int, width: float, breakaway: float = 0.0
) -> Array:
    """Full-rate columns of a joint's own terms, ``(n_samples, n_own)``.

    Of its motor first; then the friction and rotor inertia of other motors that turn with it.
    """
    columns = []
    for motor in samples.motors(joint):
        made = {
            "viscous_friction": lambda m=motor: samples.of_motor("v", m),
            "coulomb_friction": lambda m=motor: sign_of_motion(samples, m, width, breakaway),
            "armature": lambda m=motor: samples.of_motor("a", m),
            "torque_bias": lambda m=motor: np.ones(len(samples.of_motor("v", m))),
        }
        # Constants of two motors on one joint are one constant.
        columns += [made[n]() for n in names if motor == joint or n != "torque_bias"]
    return np.column_stack(columns) if columns else np.zeros((len(samples.stacked("v")), 0))


def best_sign(target: Array, columns: list[Array], kept: int | None = None) -> int:
    """Index of the best of the sign changes: presliding only where it is clearly better, no change without a gain.

    Args:
        target: ``(n_rows,)`` what a joint's own terms have to explain.
        columns: ``(n_rows, n_own)`` own terms, one for each of ``SIGNS`` in order, and others with presliding.
        kept: index of the sign change so far.
    """
    losses = [_loss(target, c) for c in columns]
    plain = int(np.argmin(losses[: len(WIDTHS)]))
    best = int(np.argmin(losses))
    found = best if losses[best] < _BETTER * losses[plain] else plain
    return found if kept is None or losses[found] < _CHANGED * losses[kept] else kept


def refined(
    target: Array,
    rows_at: Callable[[float], Array],
    value: float,
    columns: Array,
    use: NDArray[np.bool_],
    bounds: tuple[float, float],
) -> float:
    """A width or breakaway searched between those of the grid: bisection of steps on a logarithmic scale.

    Args:
        target: ``(n_rows,)`` what a joint's own terms have to explain.
        rows_at: own terms ``(n_rows, n_own)`` at a width [rad/s] or breakaway [rad].
        value: where to begin.
        columns: the own terms there.
        use: ``(n_rows,)`` rows that are fitted.
        bounds: of the width or breakaway.

    Returns:
        The width or breakaway.
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


def _loss(target: Array, columns: Array) -> float:
    x = np.linalg.lstsq(columns, target, rcond=None)[0]
    return float(((target - columns @ x) ** 2).sum())
