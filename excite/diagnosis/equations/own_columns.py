"""What a joint's own drive adds to its torque: friction, rotor inertia, an offset, and how friction changes sign."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.dry_friction.friction_sign import (
    SIGNS,
    SignChange,
    damping_of_bristles,
    sign_of_motion,
)
from excite.diagnosis.equations.samples import ArmSamples
from excite.rows.drive_terms import DRIVE_TERMS

# Bristles are believed where they lower the loss to this share, and so is their damping.
_BETTER = 0.95
# How a joint's friction changes sign is only thought over for a loss below this share.
_CHANGED = 0.98
# Rows of sign changes that are kept: searches come back to where they were.
_RECENT = 10_000_000
# Factors between neighbouring values of the search, first and last.
FIRST_STEP, _LAST_STEP = 1.5, 1.06

# What the search may reach: no velocity of a log tells less apart, nor deflections.
BREAKAWAY_BOUNDS, DAMPED_BOUNDS = (5e-5, 2e-2), (0.01, 0.3)


@dataclass(frozen=True, eq=False)
class OwnTerm:
    """A term of a joint's own drive, linear in its coefficient.

    Attributes:
        words: of ``modelled`` that ask for it.
        column: torque of a motor per unit of the coefficient ``(n_samples,)``, from the samples, the motor's row and
            how its dry friction changes sign.
        by_sign: whether it follows how dry friction changes sign.
    """

    words: tuple[str, ...]
    column: Callable[[ArmSamples, int, SignChange], Array]
    by_sign: bool = False

    def is_modelled(self, modelled: Sequence[str]) -> bool:
        """Whether ``modelled`` asks for it."""
        return any(word in modelled for word in self.words)


VISCOUS = OwnTerm(
    DRIVE_TERMS["viscous"].effects, lambda samples, motor, sign: samples.motor_signal("v")[:, motor]
)
COULOMB = OwnTerm(DRIVE_TERMS["coulomb"].effects, sign_of_motion, by_sign=True)
ARMATURE = OwnTerm(
    DRIVE_TERMS["armature"].effects, lambda samples, motor, sign: samples.motor_signal("a")[:, motor]
)
CONSTANT = OwnTerm(DRIVE_TERMS["offset"].effects, lambda samples, motor, sign: np.ones(len(samples.is_start)))
# A word that no log says: what its currents are in torques was estimated from the bodies, roughly.
SCALED = "torque_scale"
SCALE = OwnTerm((SCALED,), lambda samples, motor, sign: samples.nominal_torques[:, motor])


def own_terms(modelled: Sequence[str]) -> tuple[OwnTerm, ...]:
    """Terms of each joint's own that ``modelled`` asks for, in order."""
    return tuple(term for term in (VISCOUS, COULOMB, ARMATURE, CONSTANT, SCALE) if term.is_modelled(modelled))


def coulomb_level(modelled: Sequence[str], own: Array) -> float:
    """Coulomb friction among a joint's own coefficients ``own (n_own,)`` [N·m]; 0 where it is not modelled."""
    terms = own_terms(modelled)
    return float(own[terms.index(COULOMB)]) if COULOMB in terms else 0.0


def own_signals(samples: ArmSamples, terms: Sequence[OwnTerm], joint: int, sign: SignChange) -> Array:
    """Full-rate columns of a joint's own terms, ``(n_samples, n_own)``.

    Last the damping of its bristles, where dry friction has some.
    """
    columns = [make() for make in _column_makers(samples, terms, joint, sign).values()]
    return np.column_stack(columns) if columns else np.zeros((len(samples.stack_trials("v")), 0))


def own_rows(
    samples: ArmSamples, terms: Sequence[OwnTerm], joint: int, signs: Sequence[SignChange]
) -> list[Array]:
    """Columns of a joint's own terms through the filter, ``(n_rows, n_own)`` at each of several sign changes.

    All go through it side by side, and what was asked for before does not go again: what does not follow the sign is
    kept with the motion, and so are the sign changes of the search's grid, and of others those asked for last.
    """
    asked = [_column_makers(samples, terms, joint, sign) for sign in signs]
    kept = samples.motion_cache
    recent: dict[_Key, Array] = kept.setdefault("recent sign changes", {})
    known: dict[_Key, Array] = {}
    missing: dict[_Key, Callable[[], Array]] = {}
    for key, make in (item for columns in asked for item in columns.items()):
        rows = kept.get(key, recent.get(key))
        if rows is None:
            missing[key] = make
        else:
            known[key] = rows
    if missing:
        filtered = samples.to_rows(np.stack([make() for make in missing.values()]).T, [joint] * len(missing))
        for key, rows in zip(missing, np.ascontiguousarray(filtered.T), strict=True):
            known[key] = rows
            (kept if key.sign is None or key.sign in SIGNS else recent)[key] = rows
        while len(recent) > max(_RECENT // filtered.shape[0], 1):
            del recent[next(iter(recent))]
    count = sum(len(trial.rows) for trial in samples.trials)
    return [
        np.stack([known[key] for key in columns]).T if columns else np.zeros((count, 0)) for columns in asked
    ]


class _Key(NamedTuple):
    """What tells a column of a joint's own.

    Attributes:
        term: words of its term; none for the damping of bristles.
        joint: in whose equation it stands.
        sign: how dry friction changes sign, where the column follows that.
    """

    term: tuple[str, ...]
    joint: int
    sign: SignChange | None


def _column_makers(
    samples: ArmSamples, terms: Sequence[OwnTerm], joint: int, sign: SignChange
) -> dict[_Key, Callable[[], Array]]:
    """What makes the columns of :func:`own_signals`, in their order."""
    bend = sign._replace(damped_below=0.0)
    made: dict[_Key, Callable[[], Array]] = {
        _Key(term.words, joint, bend if term.by_sign else None): partial(term.column, samples, joint, bend)
        for term in terms
    }
    if sign.has_damping and COULOMB in terms:
        made[_Key((), joint, sign)] = partial(damping_of_bristles, samples, joint, sign)
    return made


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
        [_squares_left(target, c, positive=sign.has_damping) for c, sign in zip(columns, tried, strict=True)]
    )
    kinds = np.array([int(sign.has_bristles) + int(sign.has_damping) for sign in tried])
    found = int(np.argmin(np.where(kinds == 0, losses, np.inf)))
    # The plainer one unless what it lacks is seen.
    for kind in (1, 2):
        best = int(np.argmin(np.where(kinds == kind, losses, np.inf)))
        found = best if losses[best] < _BETTER * losses[found] else found
    return found if kept is None or losses[found] < _CHANGED * losses[kept] else kept


def refine_number(
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
    best, step = _squares_left(target[use], columns[use]), FIRST_STEP
    while step > _LAST_STEP:
        moved = False
        for way in (step, 1.0 / step):
            if not low <= value * way <= high:
                continue
            new = rows_at(value * way)
            loss = _squares_left(target[use], new[use])
            if loss < best:
                value, best, moved = value * way, loss, True
                break
        step = step if moved else step**0.5
    return value


def _squares_left(target: Array, columns: Array, *, positive: bool = False) -> float:
    """Sum of squares that is left; infinite where the last coefficient has to be positive and is not."""
    # A handful of columns over thousands of rows: their products take a tenth of what the rows themselves do.
    normal, right = columns.T @ columns, columns.T @ target
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    x = np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=1e-12)[0] / scale
    return np.inf if positive and x[-1] <= 0.0 else float(((target - columns @ x) ** 2).sum())
