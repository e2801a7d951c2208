"""Where a gap lies: wrench component by component."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.gap import Where
from excite.diagnosis.floating.equations.band import in_band
from excite.diagnosis.floating.equations.noise_level import noise_floor
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.equations.state import State
from excite.diagnosis.floating.search.refinement import Fitted, explained_state
from excite.logs.columns import WRENCH_AXES
from excite.logs.signals.spectrum import welch_spectrum

_LEAST = 0.02


def locate(problem: Problem, fitted: Fitted) -> tuple[Where, ...]:
    """Map of what a fit leaves, largest share first; ``depends_on`` names what explains most of a component."""
    record = problem.record
    state = explained_state(problem, fitted)
    residual, floor = in_band(record, state.residual), noise_floor(problem)
    scale = np.maximum(in_band(record, problem.nominal.measured).std(axis=0), 1e-9)
    power = np.maximum((residual**2).mean(axis=0) - floor**2, 0.0) / scale**2
    total = max(float(power.sum()), 1e-300)
    features = _features(problem, state)
    lines = []
    for i, axis in enumerate(WRENCH_AXES):
        dependence = {what: _explained(columns, residual[:, i]) for what, columns in features.items()}
        best = max(dependence, key=lambda what: dependence[what])
        lines.append(
            Where(
                channel=axis,
                share=float(power[i] / total),
                depends_on=best if dependence[best] > _LEAST else "nothing known",
                band_hz=_band(residual[:, i], record.rate_hz),
                dependence=dependence,
            )
        )
    return tuple(sorted(lines, key=lambda line: -line.share))


def _features(problem: Problem, state: State) -> dict[str, Array]:
    record = problem.record
    base_a, base_v = state.a[:, :6], state.v[:, :6]
    start = np.concatenate([np.full(s.stop - s.start, i) for i, s in enumerate(record.spans)])
    load = np.hstack([in_band(record, values) for values in record.readings.values()])
    return {
        "constant": np.ones((record.n_samples, 1)),
        "time": np.column_stack([record.time, record.time**2]) * 1.0,
        "trial": (start[:, None] == np.arange(len(record.spans))).astype(float),
        "load": load,
        "velocity": base_v,
        "acceleration": in_band(record, base_a),
        "position": np.hstack([state.q[:, :3], state.q[:, 3:6]]),
    }


def _explained(columns: Array, residual: Array) -> float:
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9] / size[size > 1e-9]
    rest = residual - columns @ np.linalg.lstsq(columns, residual, rcond=1e-8)[0]
    return max(0.0, 1.0 - float(rest @ rest) / max(float(residual @ residual), 1e-300) - 0.005)


def _band(residual: Array, rate_hz: float) -> tuple[float, float]:
    f, p = welch_spectrum(residual, rate_hz, min(256, len(residual)), centred=False)
    growth = np.cumsum(p) / max(float(p.sum()), 1e-300)
    low, high = (float(f[min(int(np.searchsorted(growth, x)), len(f) - 1)]) for x in (0.1, 0.9))
    return low, high
