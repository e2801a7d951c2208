"""The plainest entry: fit each effect alone beside the modelled terms, and name the one with the lowest BIC."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.blind.entry.candidates import Samples, modelled_columns, single_effects
from excite.blind.entry.log import ArmLog, arm_log
from excite.logs.log import Trial
from excite.rows.filtered_rows import TrialRows, filtered_rows
from excite.rows.kinematics import forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings

# The band in which true shares are computed.
_CUTOFF_HZ = 10.0
# A joint that is slower than this [rad/s] stands: its friction may be anything.
_STILL = 0.02


@dataclass(frozen=True, eq=False)
class _Named:
    """Columns of one candidate among all of the rows."""

    effect: str
    location: str
    columns: slice
    more: int


@dataclass(frozen=True, eq=False)
class _Rows:
    """Equations of some trials: modelled terms, candidates, then the torque that the given bodies leave."""

    values: Array
    use: NDArray[np.bool_]


def fitted_alone(folder: Path) -> dict[str, Any]:
    """Answer (``excite.blind_answer/1``) to one case.

    The terms that the log calls modelled are fitted to the identification trials with each effect in turn, each joint
    weighted by what the modelled terms leave of it; BIC is ``Σ n_j log(rss_j/n_j) + k log n`` over the joints
    (Schwarz 1978). The share of an effect is what it takes off the mean square of the validation trials.

    Args:
        folder: of the log.

    Returns:
        The answer; nothing is named where no effect has a lower BIC than none.

    Raises:
        LogError: no log of an arm with torques.
    """
    log = arm_log(folder)
    settings = ProblemSettings(cutoff_hz=_CUTOFF_HZ, drive_terms=())
    parts = [(trial, _trial_equations(log, trial, settings)) for trial in log.log.trials]
    named, n_modelled = parts[0][1].named, parts[0][1].n_modelled
    learn, judge = (
        _join_rows(
            [equations.rows for trial, equations in parts if (trial.role == "validation") is validation]
        )
        for validation in (False, True)
    )
    weight = np.ones(learn.values.shape[1])
    for _ in range(2):
        bare = _fit_columns(learn, n_modelled, slice(0, 0), weight)
        weight = 1.0 / np.maximum(np.sqrt(_mean_square(learn, n_modelled, slice(0, 0), bare)), 1e-9)
    count = learn.use.sum(axis=0)

    def bic(columns: slice, fit: Array, more: int) -> float:
        left = np.maximum(_mean_square(learn, n_modelled, columns, fit), 1e-18)
        price = (columns.stop - columns.start + more) * np.log(count.sum())
        return float((count * np.log(left)).sum() + price)

    least, best = bic(slice(0, 0), bare, 0), None
    for item in named:
        fit = _fit_columns(learn, n_modelled, item.columns, weight)
        score = bic(item.columns, fit, item.more)
        if score < least:
            least, best = score, (item, fit)
    effects = []
    if best is not None:
        item, fit = best
        before = _mean_square(judge, n_modelled, slice(0, 0), bare)
        after = _mean_square(judge, n_modelled, item.columns, fit)
        for joint, b, a in zip(log.robot.joint_names, before, after, strict=True):
            share = float(1.0 - a / b) if b > 0.0 else 0.0
            effects.append(
                {"effect": item.effect, "location": item.location, "channel": joint, "share": share}
            )
    program = "each effect alone, lowest BIC"
    return {"schema": "excite.blind_answer/1", "program": program, "effects": effects}


class _Equations(NamedTuple):
    """A trial's rows, columns of effects that may be named, and how many of what is modelled stand before them."""

    rows: TrialRows
    named: list[_Named]
    n_modelled: int


def _trial_equations(log: ArmLog, trial: Trial, settings: ProblemSettings) -> _Equations:
    filters = settings.filters(floating=False)
    k = trial_kinematics(log.robot, log.log.header, trial, settings, filters)
    session = k.time - k.time[0] + (trial.start_s or 0.0)
    s = Samples(log.robot, log.fixed, session, k.rate_hz, k.q, k.v, k.a)
    known = modelled_columns(s, log.modelled)
    parts, named, at = [known], [], known.shape[2]
    for item in single_effects(s, log.modelled):
        width = item.columns.shape[2]
        named.append(_Named(item.effect, item.location, slice(at, at + width), item.more))
        parts.append(item.columns)
        at += width
    torque = forces_on_grid(trial.time, log.torque(trial), k.time) - log.given(k.q, k.v, k.a)
    values = np.concatenate([*parts, torque[:, :, None]], axis=2)
    moving = np.abs(k.v) > _STILL
    rows = filtered_rows(lambda part: values[part], k, filters, k.valid[:, None] & moving)
    return _Equations(rows, named, known.shape[2])


def _join_rows(rows: list[TrialRows]) -> _Rows:
    return _Rows(np.concatenate([r.values for r in rows]), np.concatenate([r.use for r in rows]))


def _modelled_columns(rows: _Rows, n_modelled: int, columns: slice) -> Array:
    return np.concatenate([rows.values[:, :, :n_modelled], rows.values[:, :, columns]], axis=2)


def _fit_columns(rows: _Rows, n_modelled: int, columns: slice, weight: Array) -> Array:
    """Least squares of the modelled terms and one candidate, ``(n_modelled + k,)``."""
    a = _modelled_columns(rows, n_modelled, columns) * (weight * rows.use)[:, :, None]
    b = rows.values[:, :, -1] * weight * rows.use
    a, b = a.reshape(-1, a.shape[2]), b.ravel()
    scale = np.maximum(np.linalg.norm(a, axis=0), 1e-12)
    a = a / scale
    # Normal equations: a sum of squares to one part in 1e8 is enough to compare, and there are hundreds of fits.
    gram = a.T @ a
    values, vectors = np.linalg.eigh(gram)
    keep = values > 1e-9 * max(float(values[-1]), 1e-12)
    solved = vectors[:, keep] @ ((vectors[:, keep].T @ (a.T @ b)) / values[keep])
    return np.asarray(solved / scale)


def _mean_square(rows: _Rows, n_modelled: int, columns: slice, fit: Array) -> Array:
    """Mean square of what a fit leaves of each joint, ``(n_joints,)`` [N²·m²]."""
    rest = (rows.values[:, :, -1] - _modelled_columns(rows, n_modelled, columns) @ fit) * rows.use
    return np.asarray((rest**2).sum(axis=0) / np.maximum(rows.use.sum(axis=0), 1))
