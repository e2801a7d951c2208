"""How late torques are, told where no joint's velocity has just changed its sign or is about to.

Where a joint turns round its friction jumps, and its velocity, which stops, sticks and leaps, is seen through a filter
that moves its change of sign: of a stiff, fast finger's torques, 6 ms late, all rows show 4.8, and those between its
reversals 5.8 to 6.0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, widen_flags
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.joint_torque import Solver
from excite.diagnosis.equations.samples import ArmSamples

# How far the rows' filter carries a reversal, in periods of its cut-off: with 0.3 the finger's delay is 5.5 ms, with
# 0.5 and 0.8 it is 5.8 to 5.9, and a fifth of the rows are left with 0.8. The two differ by what is still carried.
_CARRIED, _FARTHER = 0.5, 0.8
# Newton's steps, the share of the delay over which a slope is taken, and that which a last step may have.
_STEPS, _PART, _NEAR = 12, 0.1, 1e-3
_LONGEST_S = 0.2

Change = Callable[[Baseline, float], Array]


class Delay(NamedTuple):
    """A delay.

    Attributes:
        size: its length [s].
        std: its standard deviation by which trials disagree, and by what rows farther from reversals tell [s].
        loss: sum of the logarithms of what it leaves of each joint.
    """

    size: float
    std: float
    loss: float


def between_reversals(samples: ArmSamples, carried: float = _CARRIED) -> NDArray[np.bool_]:
    """Rows of each joint that no reversal of it has got into, ``(n_joints, n_rows)``.

    Args:
        carried: how far the rows' filter carries a reversal, in periods of its cut-off.
    """
    reach = round(carried * samples.rate_hz / samples.bands.rows_hz)
    parts = []
    for trial in samples.trials:
        v = samples.motor_values(trial.v)
        turns = np.diff(np.sign(v), axis=0, prepend=np.sign(v[:1])) != 0.0
        parts.append(~widen_flags(turns, reach)[trial.rows])
    return np.concatenate(parts).T


def estimate_delay(base: Baseline, delay: float, change: Change) -> Delay | None:
    """A delay by Newton's steps, predictions following, between reversals; None where they lead nowhere.

    Args:
        base: the equations without it.
        delay: where to begin [s].
        change: what a delay adds to the torques that ``base`` predicts, ``(n_samples, n_joints)`` [N·m].
    """
    found = _refine_delay(base, delay, change, between_reversals(base.samples))
    if found is None:
        return None
    other = _refine_delay(base, found.size, change, between_reversals(base.samples, _FARTHER))
    return found if other is None else found._replace(std=float(np.hypot(found.std, other.size - found.size)))


def _refine_delay(base: Baseline, delay: float, change: Change, there: NDArray[np.bool_]) -> Delay | None:
    """The same in some of the rows, ``there (n_joints, n_rows)``."""
    for _ in range(_STEPS):
        step = _PART * delay
        slope = (change(base, delay + step) - change(base, delay - step)) / (2.0 * step)
        moved, column = (_weighted_rows(base, x) for x in (change(base, delay), slope))
        e = base.solver.equations
        own = tuple(o * f[:, None] for o, f in zip(e.own, there, strict=True))
        solver = Solver(replace(e, shared=e.shared * there[:, :, None], own=own, y=e.y * there))
        fit = solver.fit_columns((column * there)[:, :, None], moved * there)
        more, std = float(fit.extra[0]), float(solver.std_between_trials(fit)[0])
        if not (np.isfinite(more) and 0.0 < delay + more < _LONGEST_S):
            return None
        whole = replace(fit, equations=e, columns=column[:, :, None], offset=moved, held=fit.own_coefs)
        delay, base = delay + more, base.with_fit(whole)
        if abs(more) < _NEAR * delay:
            left = (fit.residual[:, e.use] ** 2).mean(axis=1)
            return Delay(delay, std, float(np.log(np.maximum(left, 1e-300)).sum()))
    return None


def _weighted_rows(base: Baseline, torque: Array) -> Array:
    return base.samples.to_rows(torque, range(torque.shape[1])).T * base.root_weight
