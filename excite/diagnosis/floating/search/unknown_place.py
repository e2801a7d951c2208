"""Where a gap is that no effect explains: a link that a free force acts on, or a sensor's channel that reads wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.effects.effect import links, segment_of
from excite.diagnosis.floating.equations.band import in_band
from excite.diagnosis.floating.equations.cross import cross
from excite.diagnosis.floating.equations.noise_level import noise_floor
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.equations.spectrum import BAND_HZ
from excite.diagnosis.floating.equations.state import State
from excite.diagnosis.floating.search.ranking import DECISIVE
from excite.diagnosis.floating.search.refinement import Fitted, explained_state
from excite.diagnosis.floating.search.together import FORM_DOUBT
from excite.logs.columns import WRENCH_AXES

# How far from its joint a link is expected to be touched, where all moment about the joint were noise.
_REACH_M = 0.02
# Links that leave this share more than the best are told from it by nothing but the noise model's faults; at the
# joint itself, where the force hardly is, by its form's as well.
_LEAST_MARGIN = 0.02
# Power over the noise's up to which a channel's free reading leaves nothing.
_NOISE = 1.5
# Whitened size of what a unit of an inertial parameter makes, below which the record does not show it.
_SHOWN = 0.3


@dataclass(frozen=True, eq=False)
class _Open:
    """What a fit leaves, as many samples of it as the band has numbers.

    Attributes:
        state: the motion of these samples, and all readings.
        few: which of the record's samples they are.
        white: ``(k, 6)`` whitened residual in band.
        columns: ``(k, 6, r)`` what inertial parameters add to it, turned to those that the record shows, each with a
            unit prior; identified anew beside each hypothesis, since without it they have imitated it.
        colour: ``(6, 6)`` Cholesky factor of the noise.
    """

    state: State
    few: slice
    white: Array
    columns: Array
    colour: Array

    def beside(self, arms: Array) -> tuple[Array, Array]:
        """What wrenches of any size along ``arms (k, 6, m)`` leave, ``(k, 6 − m)``, and the parameters ``(r,)``."""
        # Directions that no such wrench has.
        others = np.linalg.qr(np.linalg.solve(self.colour, arms), mode="complete")[0][:, :, arms.shape[2] :]
        others = others.transpose(0, 2, 1)
        target = (others @ self.white[:, :, None])[:, :, 0]
        design = (others @ self.columns).reshape(target.size, -1)
        gram = design.T @ design + np.eye(design.shape[1])
        delta = np.asarray(np.linalg.solve(gram, design.T @ target.ravel()), dtype=float)
        return target - (design @ delta).reshape(target.shape), delta

    def beside_force(self, link: str, lever: Array) -> tuple[Array, Array]:
        """What a free force at a point of a link leaves, ``(k, 3)``, and the parameters beside it."""
        point = self.state.poses.point(segment_of(self.state, link) + 1, lever)
        return self.beside(self.state.at_base(np.tile(np.eye(3), (len(point), 1, 1)), point))


def unknown_places(problem: Problem, fitted: Fitted) -> tuple[str, ...]:
    """Places of what a fit leaves, best first: sensors' channels where one leaves no more than noise, links where not.

    A channel that reads wrong makes one number an instant, free at each, of the six of the wrench; a force on a link
    makes three. The moment must be that of the force about a point of the link, which is near its joint, or the
    joint itself: links are listed that either leaves untold from the best.
    """
    left = _open(problem, fitted)
    channels = _misread(problem, fitted, left)
    if channels:
        return channels
    at_joint, near = {}, {}
    for link in links(left.state):
        at_joint[link], delta = left.beside_force(link, np.zeros(3))
        lever = _lever(left.state, link, (left.white - left.columns @ delta) @ left.colour.T)
        near[link], _ = left.beside_force(link, lever)
    return tuple(dict.fromkeys(_untold(near, _LEAST_MARGIN) + _untold(at_joint, FORM_DOUBT)))


def misread_channels(problem: Problem, fitted: Fitted) -> tuple[str, ...]:
    """Channels of sensors one of which, were its reading free at each instant, would leave no more than noise.

    The likeliest first; none where each leaves more.
    """
    return _misread(problem, fitted, _open(problem, fitted))


def _misread(problem: Problem, fitted: Fitted, left: _Open) -> tuple[str, ...]:
    state = explained_state(problem, fitted)
    rest = {
        f"{name}.{axis}": left.beside(arms[left.few][:, :, [k]])[0]
        for name, arms in state.levers.items()
        for k, axis in enumerate(WRENCH_AXES)
    }
    found = _untold(rest, _LEAST_MARGIN)
    return found if _beside_reading(problem, fitted, found[0]) < _NOISE else ()


def _open(problem: Problem, fitted: Fitted) -> _Open:
    record, state = problem.record, explained_state(problem, fitted)
    few = slice(None, None, max(1, int(record.rate_hz / (2.0 * BAND_HZ))))
    colour = np.asarray(np.linalg.cholesky(record.sensor_noise), dtype=float)
    factor = np.linalg.inv(colour)
    white = in_band(record, state.residual)[few] @ factor.T
    thin = state.replace(q=state.q[few])
    if not record.inertials_free:
        return _Open(thin, few, white, np.zeros((*white.shape, 0)), colour)
    regressor = problem.nominal.regressor[:, :, problem.index] * problem.scales
    columns = in_band(record, regressor.reshape(len(regressor), -1)).reshape(regressor.shape)[few]
    columns = factor @ columns
    white = white + columns @ (fitted.delta[problem.index] / problem.scales)
    u, s, _ = np.linalg.svd(columns.reshape(-1, columns.shape[2]), full_matrices=False)
    shown = s > _SHOWN
    return _Open(thin, few, white, (u[:, shown] * s[shown]).reshape(*white.shape, -1), colour)


def _beside_reading(problem: Problem, fitted: Fitted, channel: str) -> float:
    """Power that a free reading of a channel leaves over the noise's, mean over the wrench's components.

    It is taken out before the band's filter: a reading that is cut off changes as fast as its lever arm.
    """
    record, state = problem.record, explained_state(problem, fitted)
    name, _, axis = channel.partition(".")
    scale = noise_floor(problem)
    arm = state.levers[name][:, :, WRENCH_AXES.index(axis)] / scale
    arm /= np.linalg.norm(arm, axis=1, keepdims=True)

    def across(values: Array) -> Array:
        white = values / scale[:, None]
        white = white - arm[:, :, None] * np.einsum("ni,nij->nj", arm, white)[:, None, :]
        return in_band(record, white.reshape(len(white), -1)).reshape(white.shape)

    left = across(state.residual[:, :, None])[:, :, 0].ravel()
    if record.inertials_free:
        design = across(problem.nominal.regressor[:, :, problem.index] * problem.scales)
        left = left + (design @ (fitted.delta[problem.index] / problem.scales)).ravel()
        rows = design.reshape(len(left), -1)
        gram = rows.T @ rows + np.eye(rows.shape[1])
        left = left - rows @ np.linalg.solve(gram, rows.T @ left)
    # Five numbers of six are left.
    return float((left**2).sum()) / (5.0 * record.n_samples)


def _untold(rest: dict[str, Array], margin: float) -> tuple[str, ...]:
    """Places that leave hardly more than the best place, by a share ``margin`` at least, best first."""
    left = {place: float((values**2).sum()) for place, values in rest.items()}
    order = sorted(left, key=lambda name: left[name])
    best = order[0]
    # As many numbers as make the kurtosis Gaussian.
    effective = 3.0 * left[best] ** 2 / float((rest[best] ** 4).sum())
    limit = left[best] * (1.0 + max(margin, 2.0 * DECISIVE / effective))
    return tuple(place for place in order if left[place] <= limit)


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
