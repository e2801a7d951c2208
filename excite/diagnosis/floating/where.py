"""Where a gap lies: wrench component by component, and the link at which a free force would explain it."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.floating.band import in_band
from excite.diagnosis.floating.cross import cross
from excite.diagnosis.floating.effects.effect import links, segment_of
from excite.diagnosis.floating.noise_level import noise_floor
from excite.diagnosis.floating.problem import Problem
from excite.diagnosis.floating.ranking import DECISIVE
from excite.diagnosis.floating.refinement import Fitted, explained_state
from excite.diagnosis.floating.spectrum import BAND_HZ
from excite.diagnosis.floating.state import State
from excite.diagnosis.gap import Where
from excite.logs.columns import WRENCH_AXES
from excite.logs.signals.spectrum import welch
from excite.robot.robot import Array

_LEAST = 0.02
# How far from its joint a link is expected to be touched, where all moment about the joint were noise.
_REACH_M = 0.02
# Links that leave this share more than the best are told from it by nothing but the noise model's faults.
_LEAST_MARGIN = 0.02


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


def free_force_links(problem: Problem, fitted: Fitted) -> tuple[str, ...]:
    """Links on which one force, free at each instant, explains most of what a fit leaves, best first.

    Six numbers an instant against three: the moment must be that of the force about a point of the link, which
    is near its joint, or the joint itself: links are listed that either leaves untold from the best.
    """
    residual = in_band(problem.record, explained_state(problem, fitted).residual)
    near = _untold(problem, fitted, residual, levers=True)
    return tuple(dict.fromkeys(near + _untold(problem, fitted, residual, levers=False)))


def _untold(problem: Problem, fitted: Fitted, residual: Array, levers: bool) -> tuple[str, ...]:
    """Links whose best force leaves hardly more of ``residual (n, 6)`` than the best link's, best first."""
    record, state = problem.record, explained_state(problem, fitted)
    factor = np.linalg.inv(np.linalg.cholesky(record.sensor_noise))
    white, left, fourth = residual @ factor.T, {}, {}
    for link in links(state):
        lever = _lever(state, link, residual) if levers else np.zeros(3)
        point = state.poses.point(segment_of(state, link) + 1, lever)
        arms = state.at_base(np.tile(np.eye(3), (len(point), 1, 1)), point)
        q, _ = np.linalg.qr(factor @ arms)
        rest = white - np.einsum("nij,nj->ni", q, np.einsum("nji,nj->ni", q, white))
        left[link], fourth[link] = float((rest**2).sum()), float((rest**4).sum())
    best = min(left, key=lambda name: left[name])
    # As many numbers as make the kurtosis Gaussian, of those that fit in the band.
    effective = 3.0 * left[best] ** 2 / fourth[best] * min(1.0, 2.0 * BAND_HZ / record.rate_hz)
    limit = left[best] * (1.0 + max(_LEAST_MARGIN, 2.0 * DECISIVE / effective))
    return tuple(link for link in sorted(left, key=lambda name: left[name]) if left[link] <= limit)


def _lever(state: State, link: str, residual: Array) -> Array:
    """``(3,)`` point of a link, in its joint's frame, about which residual wrenches ``(n, 6)`` turn least [m].

    What is left beside a force r × f is taken for noise, and a point is looked for near the joint.
    """
    joint = segment_of(state, link) + 1
    base, own = state.poses.rotation[:, 1], state.poses.rotation[:, joint]
    to_link = np.einsum("nji,njk->nik", own, base)
    origin = np.einsum("nji,nj->ni", base, state.poses.translation[:, joint] - state.poses.translation[:, 1])
    moment = residual[:, 3:] - cross(origin, residual[:, :3])
    force, moment = (np.einsum("nij,nj->ni", to_link, x) for x in (residual[:, :3], moment))
    # Σ |m − r × f|² has the normal equations Σ (f·f − f fᵀ) r = Σ f × m.
    gram = (force**2).sum() * np.eye(3) - force.T @ force
    right = cross(force, moment).sum(axis=0)
    noise = float((moment**2).sum()) / (3.0 * len(moment))
    return np.linalg.solve(gram + noise / _REACH_M**2 * np.eye(3), right)


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
    f, p = welch(residual, rate_hz, min(256, len(residual)), centred=False)
    growth = np.cumsum(p) / max(float(p.sum()), 1e-300)
    low, high = (float(f[min(int(np.searchsorted(growth, x)), len(f) - 1)]) for x in (0.1, 0.9))
    return low, high
