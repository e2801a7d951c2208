"""How a soft or loose gear swings already where a trial begins."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.gears.deflection import deflect
from excite.diagnosis.effects.gears.gear import Behind, Gear
from excite.diagnosis.equations.samples import ArmSamples
from excite.logs.signals.butterworth import settling_samples

# So few samples, or such a share of those before the rows, do not tell how a gear swings.
_LEAST, _LEAST_SHARE = 20, 0.4
# A gear that has swung off to exp(−5) before the first row may have begun anyhow.
_FORGOTTEN = 5.0
# Steps of Gauss and Newton, where the gear is not linear.
_STEPS = 4


def first_states(context: Context, j: int, behind: Behind, gear: Gear) -> Array:
    """Deflection and its speed at each trial's first sample, beyond rest under the load, ``(n_trials, 2)``.

    Where a trial begins in motion the gear already swings, and a soft one goes on for longer than the rows wait. The
    measured torque less the motor's own part is what the gear carries: least squares over the samples before the
    first row tells its state. Rows, and so whatever is judged, have no part in it. A trial that begins at rest, or
    before which nothing was measured, begins at rest under its load.
    """
    samples, base = context.baseline.samples, context.baseline
    begin = np.zeros((len(samples.trials), 2))
    moving = np.abs(context.v[:, j]) > samples.standstill[j]
    kept = base.derived.values
    if (j, "before rows") not in kept:
        kept[j, "before rows"] = _before_rows(samples, j, moving)
    counts = kept[j, "before rows"]
    told = np.flatnonzero(counts)
    inertia = float(behind.inertia.mean())
    length = float(counts.max()) / samples.rate_hz
    if not len(told) or 0.5 * gear.damping / inertia * length > _FORGOTTEN:
        return begin
    firsts = np.flatnonzero(samples.starts)
    rows = np.concatenate([firsts[k] + np.arange(counts[k]) for k in told])
    measured = np.concatenate([samples.trials[k].measured[: counts[k], j] for k in told])
    own = base.total[rows, j] - base.rigid[rows, j]
    early = _Early(
        behind.at(rows),
        samples.starts[rows],
        measured - own,
        moving[rows],
        np.cumsum(counts[told])[:-1],
        1.0 / samples.rate_hz,
        gear,
    )
    load = float(np.sqrt(np.mean(behind.load**2)))
    reach = gear.gap + load / gear.stiffness
    begin[told] = early.fitted(reach, reach * math.sqrt(gear.stiffness / inertia))
    return begin


@dataclass(frozen=True, eq=False)
class _Early:
    """The samples before the rows, of the trials in which they tell something.

    Attributes:
        behind: what the gear has behind it at these samples.
        starts: which are the first of a trial.
        carried: torque that the gear carries there, as measured [N·m].
        moving: whether the motor moves: where it stands, static friction has any part of the torque.
        ends: where trials end, the last one's left out.
        dt: [s].
        gear: the gear.
    """

    behind: Behind
    starts: NDArray[np.bool_]
    carried: Array
    moving: NDArray[np.bool_]
    ends: NDArray[np.int64]
    dt: float
    gear: Gear

    def left(self, begin: Array) -> Array:
        """Torque that a gear does not carry which begins so, ``(n_samples,)``; none where the motor stands."""
        swung = deflect(self.behind, self.gear, self.starts, begin, self.dt)
        return (self.carried - self.behind.needed(*swung)) * self.moving

    def fitted(self, reach: float, speed: float) -> Array:
        """First states ``(n_trials, 2)``, as large as ``reach`` and ``speed`` before anything is measured."""
        count = len(self.ends) + 1
        size = np.array([reach, speed])
        states, linear = np.zeros((count, 2)), self.gear.gap == 0.0 and self.gear.cubic == 0.0
        left = np.split(self.left(states), self.ends)
        # Noise as between neighbours.
        moves = np.split(self.moving, self.ends)
        noise = (float(np.std(np.diff(y[m]))) for y, m in zip(left, moves, strict=True))
        weights = [1.0 / max(level, 1e-12) ** 2 for level in noise]
        for _ in range(1 if linear else _STEPS):
            wanted = self._newton(states, left, weights, size, 1.0 if linear else 0.05)
            # A step that makes a trial worse is taken by a third, or not at all.
            for share in (1.0, 0.3):
                if np.array_equal(wanted, states):
                    break
                tried = states + share * (wanted - states)
                after = np.split(self.left(tried), self.ends)
                for k, w in enumerate(weights):
                    closer = w * float(left[k] @ left[k] - after[k] @ after[k])
                    if closer > float(((tried[k] ** 2 - states[k] ** 2) / size**2).sum()):
                        states[k], left[k], wanted[k] = tried[k], after[k], tried[k]
        return states

    def _newton(
        self, states: Array, left: list[Array], weights: list[float], size: Array, step: float
    ) -> Array:
        """States at which what is left would be least, were the gear linear about these, ``(n_trials, 2)``."""
        moved = [np.split(self.left(states + step * size * unit), self.ends) for unit in np.eye(2)]
        wanted = states.copy()
        for k, w in enumerate(weights):
            slope = np.column_stack([left[k] - m[k] for m in moved]) / step
            normal = w * slope.T @ slope + np.eye(2)
            wanted[k] += np.linalg.solve(normal, w * slope.T @ left[k] - states[k] / size) * size
        return wanted


def _before_rows(samples: ArmSamples, j: int, moving: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number of a trial's samples that are out of its rows' reach, ``(n_trials,)``; 0 where the joint stands."""
    edge = settling_samples(samples.rate_hz, samples.bands.rows_hz)
    counts = np.zeros(len(samples.trials), np.int64)
    by_trial = np.split(moving, np.flatnonzero(samples.starts)[1:])
    for k, (trial, moves) in enumerate(zip(samples.trials, by_trial, strict=True)):
        count = max(int(trial.rows[0]) - edge, 0)
        if moves[:count].sum() >= max(_LEAST, _LEAST_SHARE * count) and np.isfinite(trial.tau[0, j]):
            counts[k] = count
    return counts
