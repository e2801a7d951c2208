"""What is left and follows something: generic functions of one thing, chosen by blocks left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.budget.fit.joint_fit import Model, effective_share
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.context import Context

# Knots of a piecewise linear function, and how many functions one channel may have.
_KNOTS, _MOST = 9, 3
_RIDGE = 1e-4


@dataclass(frozen=True, eq=False)
class Generic:
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
class Left:
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


def unnamed_of(model: Model, context: Context, weight: Array, floor: Array, joint: int) -> list[Left]:
    """Generic functions of what a model leaves of a joint, the best first.

    Args:
        model: the model of the gap.
        context: its predictions.
        weight: ``(n_joints, n_rows)`` square roots of the rows' weights.
        floor: ``(n_joints,)`` noise in the rows' band.
        joint: the joint.
    """
    rows = model.design.rows
    rest = model.residual[joint].copy()
    inside, judged = rows.block >= 0, rows.judged >= 0
    if float((rest[judged] ** 2).mean()) <= float(floor[joint]) ** 2:
        return []
    library, found = _library(context, weight, joint), []
    for _ in range(_MOST):
        best = _best(library, rest, rows.block, inside, rows.trial)
        if best is None:
            break
        x = _solved(best.rows[inside], rest[inside])
        after = rest - best.rows @ x
        power = float((rest[judged] ** 2).mean() - (after[judged] ** 2).mean())
        if power <= 0.0:
            break
        # Hats, not what was filtered: the function itself.
        found.append(Left(best.follows, power, best.knots, x if len(best.knots) == len(x) else np.zeros(0)))
        rest, library = after, [item for item in library if item.follows != best.follows]
    return found


def _best(
    library: list[Generic],
    rest: Array,
    block: NDArray[np.int64],
    inside: NDArray[np.bool_],
    trial: NDArray[np.int64],
) -> Generic | None:
    """The function by which blocks left out are predicted best; None where none is worth it."""
    total = float((rest[inside] ** 2).sum())
    best, most = None, THRESHOLDS.unnamed
    for item in library:
        gain = 1.0 - _left_out(item.rows, rest, block) / total
        if gain <= most:
            continue
        x = _solved(item.rows[inside], rest[inside])
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


def _solved(columns: Array, rest: Array) -> Array:
    gram = columns.T @ columns
    ridge = _RIDGE * np.diag(np.diag(gram)) + 1e-12 * np.eye(len(gram))
    return np.asarray(np.linalg.solve(gram + ridge, columns.T @ rest))


def _library(context: Context, weight: Array, joint: int) -> list[Generic]:
    """Functions of everything that a channel's residual may follow."""
    base, samples = context.baseline, context.baseline.samples
    sign, load = context.sign(joint), base.rigid[:, joint]
    signals = {
        "position": [context.q[:, joint]],
        "velocity": [context.v[:, joint]],
        "acceleration": [context.a[:, joint]],
        "load": [load],
        "time": [context.session],
    }
    factors = {"load": [np.ones_like(sign), sign], "time": [np.ones_like(sign), sign]}
    for other, name in enumerate(context.joints):
        if other != joint:
            signals[name] = [context.q[:, other]]
    made = []
    for follows, (signal,) in signals.items():
        knots = _knots(signal)
        if len(knots) < 3:
            continue
        hats = _hats(signal, knots)
        columns = np.column_stack([hats * f[:, None] for f in factors.get(follows, [np.ones_like(sign)])])
        rows = samples.rows(columns, [joint] * columns.shape[1]) * weight[joint][:, None]
        made.append(Generic(follows, knots, rows))
    return made


def _knots(signal: Array) -> Array:
    """Where a function of a signal has its knots: as many values between each two."""
    return np.unique(np.round(np.quantile(signal, np.linspace(0.0, 1.0, _KNOTS)), 9))


def _hats(signal: Array, knots: Array) -> Array:
    """Piecewise linear functions that are one at a knot and zero at its neighbours, ``(n, n_knots)``."""
    return np.column_stack([np.interp(signal, knots, unit) for unit in np.eye(len(knots))])
