"""Where the gap lies: joint by joint, and what each joint's residual follows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.gap import Where
from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.joint_torque import Fit
from excite.logs.signals.spectrum import welch_spectrum

_LEAST = 0.02


def locate(context: Context, fit: Fit, shares: Mapping[str, float]) -> tuple[Where, ...]:
    """Map of the baseline's residual, largest share first.

    The dependence is the share of a joint's residual power on the identification trials that functions of
    one thing alone explain, less what as many arbitrary columns would.

    Args:
        context: the baseline.
        fit: its fit.
        shares: by joint, its share of the gap, as the budget has it: one joint has but one.

    Returns:
        One line a joint.
    """
    samples = context.baseline.samples
    use, rest = samples.identification, context.baseline.plain(fit.residual)
    lines = []
    for j, name in enumerate(context.joints):
        dependence = {
            what: _explained(samples.rows(columns)[use], rest[j][use])
            for what, columns in _features(context, j).items()
        }
        best = max(dependence, key=lambda what: dependence[what])
        lines.append(
            Where(
                channel=name,
                share=shares[name],
                depends_on=best if dependence[best] > _LEAST else "nothing known",
                band_hz=_band(context, rest[j]),
                dependence=dependence,
            )
        )
    return tuple(sorted(lines, key=lambda line: -line.share))


def _features(context: Context, j: int) -> dict[str, Array]:
    """Functions of one thing each, ``(n_samples, k)``."""
    q, v, a = context.q[:, j], context.v[:, j], context.a[:, j]
    sign, load = context.sign(j), context.baseline.rigid[:, j]
    clock = context.session / max(float(context.session.max()), 1e-9)
    return {
        "velocity": np.column_stack(
            [sign, v, sign * v**2, *(sign * np.exp(-((v / w) ** 2)) for w in (0.03, 0.1))]
        ),
        "position": np.column_stack(
            [np.ones_like(q), q, *(f(k * q) for k in (1, 2) for f in (np.cos, np.sin))]
        ),
        "load": np.column_stack([load, np.abs(load) * sign, np.abs(load), load**2 * sign]),
        "acceleration": np.column_stack([a, np.abs(a) * sign]),
        "time": np.column_stack([clock, clock**2, clock * sign, clock**2 * sign, clock * v]),
    }


def _explained(columns: Array, residual: Array) -> float:
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * max(float(size.max()), 1e-300)]
    rest = residual - columns @ np.linalg.lstsq(columns, residual, rcond=1e-8)[0]
    return max(0.0, 1.0 - float(rest @ rest) / max(float(residual @ residual), 1e-300) - 0.005)


def _band(context: Context, residual: Array) -> tuple[float, float]:
    """Frequencies between a tenth and nine tenths of the residual's power [Hz]."""
    samples = context.baseline.samples
    parts = [residual[samples.trial_of_row == k] for k in range(len(samples.trials))]
    # One grid of frequencies for all trials, which the shortest can fill.
    length = min(256, *(len(part) for part in parts))
    spectra = []
    for part in parts:
        f, p = welch_spectrum(part, samples.bands.rate_hz, length, centred=False)
        spectra.append(p)
    growth = np.cumsum(np.mean(spectra, axis=0))
    growth /= max(float(growth[-1]), 1e-300)
    low, high = (float(f[min(int(np.searchsorted(growth, x)), len(f) - 1)]) for x in (0.1, 0.9))
    return low, high
