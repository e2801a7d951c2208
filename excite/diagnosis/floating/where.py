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
from excite.diagnosis.floating.search import FORM_DOUBT
from excite.diagnosis.floating.spectrum import BAND_HZ
from excite.diagnosis.floating.state import State
from excite.diagnosis.gap import Where
from excite.logs.columns import WRENCH_AXES
from excite.logs.signals.spectrum import welch
from excite.robot.robot import Array

_LEAST = 0.02
# How far from its joint a link is expected to be touched, where all moment about the joint were noise.
_REACH_M = 0.02
# Links that leave this share more than the best are told from it by nothing but the noise model's faults; at the
# joint itself, where the force hardly is, by its form's as well.
_LEAST_MARGIN = 0.02
# Whitened size of what a unit of an inertial parameter makes, below which the record does not show it.
_SHOWN = 0.3


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
    is near its joint, or the joint itself: links are listed that either leaves untold from the best. Inertial
    parameters that are identified are so anew beside each force, since without it they have imitated it.
    """
    record, state = problem.record, explained_state(problem, fitted)
    # As many samples as the band has numbers.
    few = slice(None, None, max(1, int(record.rate_hz / (2.0 * BAND_HZ))))
    white, columns = _opened(problem, fitted, few)
    thin = state.but(q=state.q[few])
    colour = np.asarray(np.linalg.cholesky(record.sensor_noise), dtype=float)
    at_joint, near = {}, {}
    for link in links(state):
        at_joint[link], delta = _beside_force(thin, link, np.zeros(3), colour, white, columns)
        lever = _lever(thin, link, (white - columns @ delta) @ colour.T)
        near[link], _ = _beside_force(thin, link, lever, colour, white, columns)
    return tuple(dict.fromkeys(_untold(near, _LEAST_MARGIN) + _untold(at_joint, FORM_DOUBT)))


def _opened(problem: Problem, fitted: Fitted, few: slice) -> tuple[Array, Array]:
    """Whitened residual ``(k, 6)`` of some samples in band, and ``(k, 6, r)`` what inertial parameters add to it.

    The parameters are turned to those that the record shows, each with a unit prior.
    """
    record = problem.record
    factor = np.linalg.inv(np.linalg.cholesky(record.sensor_noise))
    white = in_band(record, explained_state(problem, fitted).residual)[few] @ factor.T
    if not record.inertials_free:
        return white, np.zeros((*white.shape, 0))
    regressor = problem.nominal.regressor[:, :, problem.index] * problem.scales
    columns = in_band(record, regressor.reshape(len(regressor), -1)).reshape(regressor.shape)[few]
    columns = factor @ columns
    white = white + columns @ (fitted.delta[problem.index] / problem.scales)
    u, s, _ = np.linalg.svd(columns.reshape(-1, columns.shape[2]), full_matrices=False)
    shown = s > _SHOWN
    return white, (u[:, shown] * s[shown]).reshape(*white.shape, -1)


def _beside_force(
    state: State, link: str, lever: Array, colour: Array, white: Array, columns: Array
) -> tuple[Array, Array]:
    """What a free force at a point of a link leaves, ``(k, 3)``, and the parameters beside it, ``(r,)``."""
    point = state.poses.point(segment_of(state, link) + 1, lever)
    arms = np.linalg.solve(colour, state.at_base(np.tile(np.eye(3), (len(point), 1, 1)), point))
    # Directions that no force at the point has.
    others = np.linalg.qr(arms, mode="complete")[0][:, :, 3:].transpose(0, 2, 1)
    target = (others @ white[:, :, None])[:, :, 0]
    design = (others @ columns).reshape(target.size, -1)
    gram = design.T @ design + np.eye(design.shape[1])
    delta = np.asarray(np.linalg.solve(gram, design.T @ target.ravel()), dtype=float)
    return target - (design @ delta).reshape(target.shape), delta


def _untold(rest: dict[str, Array], margin: float) -> tuple[str, ...]:
    """Links whose force leaves hardly more than the best link's, by a share ``margin`` at least, best first."""
    left = {link: float((values**2).sum()) for link, values in rest.items()}
    order = sorted(left, key=lambda name: left[name])
    best = order[0]
    # As many numbers as make the kurtosis Gaussian.
    effective = 3.0 * left[best] ** 2 / float((rest[best] ** 4).sum())
    limit = left[best] * (1.0 + max(margin, 2.0 * DECISIVE / effective))
    return tuple(link for link in order if left[link] <= limit)


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
