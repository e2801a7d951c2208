"""External forces on a floating base: pulls, unlogged and pressed contacts, and where such contacts may have been."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Any

import numpy as np
import scipy

from excite.arrays import Array
from excite.diagnosis.floating.effect import (
    POINT,
    FloatingEffect,
    Parameter,
    link_names,
    segment_of,
)
from excite.diagnosis.floating.hypotheses import (
    Fitted,
    Placed,
    apply_all,
    effect_columns,
    explained_state,
    refine_fit,
)
from excite.diagnosis.floating.problem import Problem
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.state import State
from excite.logs.columns import WRENCH_AXES


class PointForce(FloatingEffect):
    """A force in the world at a point of a link.

    Attributes:
        at: the three parameters that are the point's coordinates in the frame of the link's joint.
    """

    changes = "extra"
    places = staticmethod(link_names)
    at = slice(3, 6)

    @abstractmethod
    def force_at(self, state: State, point: Array, theta: Array) -> Array:
        """``(n, 3)`` world [N], where the point is at ``point (n, 3)``, world [m]."""

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Add it."""
        point = state.poses.point(segment_of(state, location) + 1, theta[self.at])
        return state.replace(extra=state.extra + state.at_base(self.force_at(state, point, theta), point))


# Something pulls at a link: a cable, a tether, a hand.

# A force of this size and less has no direction to speak of.
_NO_DIRECTION_N = 2.0
_AXES = WRENCH_AXES[:3]


class ExternalForce(PointForce):
    """A force at a point p of the link, constant in the world but for springs: F − k x − k' f (f · x), x = p − mean p.

    A cord of length L under tension T resists by T/L across its direction f = F/|F| and by its own stiffness
    along it; a spring that resists alike in all directions has k' = 0. Where on the link it is hooked is not
    known; the link's origin is but the likeliest place.
    """

    name = "external_force"
    reads_as = "sensor bias (the unloaded foot tells), base orientation (bend and turn)"
    in_torques = True
    # Mean force in the world, stiffness across it, the point in the link's frame, and what is added along it.
    own = (
        *Parameter.of_names(_AXES, "N", 15.0, 1e-2),
        Parameter("stiffness", "N/m", 30.0, 1.0),
        *POINT,
        Parameter("further_stiffness_along", "N/m", 30.0, 1.0),
    )
    at = slice(4, 7)

    def locations(self, state: State) -> tuple[str, ...]:
        """Links; the base alone, if its feet hold it, where joints' torques would carry it as well."""
        robot = state.record.robot
        return link_names(state) if robot.sensors else link_names(state)[: bool(robot.feet)]

    def force_at(self, state: State, point: Array, theta: Array) -> Array:
        """Less where the point is further along it."""
        away = point - point.mean(axis=0)
        # Shorter than one where there is hardly any force.
        direction = theta[:3] / np.hypot(np.linalg.norm(theta[:3]), _NO_DIRECTION_N)
        return np.asarray(theta[:3] - theta[3] * away - theta[7] * (away @ direction)[:, None] * direction)


# A hand or a knee is pressed on something soft that nobody logged.

# Below this speed friction is in proportion to it.
_STANDSTILL_M_S = 0.05


@dataclass(frozen=True)
class Surface:
    """Something that pushes back along ``normal`` what comes nearer than ``height``.

    Attributes:
        normal: world unit vector, out of it.
        height: along the normal, at which it is first touched [m].
        depth: over which its force rises [m].
        rounded: whether the force rises smoothly and not in proportion.
    """

    normal: tuple[float, float, float]
    height: float
    depth: float
    rounded: bool

    def force_share(self, along: Array, raised: float = 0.0, deeper: float = 0.0) -> Array:
        """Share of its largest force at positions ``along`` the normal.

        Args:
            along: ``(…)`` [m].
            raised: added to the height [m].
            deeper: logarithm of a factor on the depth.
        """
        s = np.asarray(np.clip((self.height + raised - along) / (self.depth * np.exp(deeper)), 0.0, 1.0))
        return np.asarray(s**2 * (3.0 - 2.0 * s) if self.rounded else s)


class PressedContact(PointForce):
    """A world force at a point of the link that rises as the point sinks into a surface.

    What :class:`UnloggedContact` learns instant by instant is here a function of where the point is, so that
    soft things, which never are fully on or off, have their form too. The force is larger while the point
    sinks than while it rises (Hunt and Crossley 1975, eq. 10), and the surface rubs against the point's motion
    along it (Coulomb, smoothed about standstill).
    """

    name = "unlogged_contact"
    form = "pressed_contact"
    reads_as = "a spring, where the link never leaves it"
    # The largest force, world frame; the point in the link's frame; what the first guess is off by.
    own = (
        *Parameter.of_names(_AXES, "N", 25.0, 1e-2),
        *POINT,
        Parameter("raised", "m", 0.05, 1e-5),
        Parameter("deeper", "1", 0.7, 1e-4),
        Parameter("friction", "1", 0.3, 1e-4),
        Parameter("damping", "s/m", 0.5, 1e-4),
    )

    def __init__(self, surface: Surface):
        self.surface = surface

    def stored_data(self, record: FloatingRecord) -> dict[str, Any]:
        """The surface."""
        return {"surface": asdict(self.surface)}

    def with_stored_data(self, said: Mapping[str, Any], record: FloatingRecord) -> PressedContact:
        """That is pressed on the surface which is said."""
        surface = said["surface"]
        return PressedContact(Surface(**{**surface, "normal": tuple(surface["normal"])}))

    def force_at(self, state: State, point: Array, theta: Array) -> Array:
        """As deep as the point has sunk."""
        normal = np.array(self.surface.normal)
        share = self.surface.force_share(point @ normal, theta[6], theta[7])
        force = share[:, None] * theta[:3]
        if theta[8:].any():
            speed = state.record.differentiate_signal(point)
            sinking = -(speed @ normal)
            sliding = speed + sinking[:, None] * normal
            smooth = np.sqrt((sliding**2).sum(axis=1) + _STANDSTILL_M_S**2)
            rubs = theta[8] * share * float(theta[:3] @ normal) / smooth
            force = (force - rubs[:, None] * sliding) * np.maximum(0.0, 1.0 + theta[9] * sinking)[:, None]
        return force


# A hand or a knee rests on something that nobody logged.


class UnloggedContact(PointForce):
    """A world force at a point of the link while the contact lasts; when it lasts is learnt from the record.

    ``share (n,)``, between 0 and 1, says when in the trials of ``record``: a member made without it has no places. In
    trials that it was not learnt from nothing is known of it, and it lasts in none. ``price`` is that of the moments at
    which it comes and goes.
    """

    name = "unlogged_contact"
    reads_as = "any force that comes and goes; two levels, and the same link each time"
    # The force while in contact, world frame, and the point in the link's frame.
    own = (*Parameter.of_names(_AXES, "N", 25.0, 1e-2), *POINT)

    def __init__(self, share: Array | None = None, record: FloatingRecord | None = None, price: float = 0.0):
        self.share, self.record, self.price = share, record, price

    def stored_data(self, record: FloatingRecord) -> dict[str, Any]:
        """When it lasts: by trial, how many samples in a row have which share."""
        spells = {}
        for trial, span in zip(record.trials, record.spans, strict=True):
            values = [round(float(x), 4) for x in self._share_in(record)[span]]
            spells[trial] = [[len(list(run)), share] for share, run in groupby(values)]
        return {"spells": spells}

    def with_stored_data(self, said: Mapping[str, Any], record: FloatingRecord) -> UnloggedContact:
        """The contact that lasts as is said."""
        share = np.zeros(record.n_samples)
        for trial, span in zip(record.trials, record.spans, strict=True):
            runs = said["spells"].get(trial, [])
            values = np.repeat([run[1] for run in runs], [int(run[0]) for run in runs])
            share[span][: len(values)] = values[: span.stop - span.start]
        return UnloggedContact(share, record)

    def locations(self, state: State) -> tuple[str, ...]:
        """Links, once it is known when there was a contact."""
        return () if self.share is None else link_names(state)

    def force_at(self, state: State, point: Array, theta: Array) -> Array:
        """While it lasts."""
        return self._share_in(state.record)[:, None] * theta[:3]

    def _share_in(self, record: FloatingRecord) -> Array:
        """``(n,)`` share of a record's samples, by its trials' names where it was learnt from another."""
        own = self.record or record
        if self.share is None or len(self.share) != own.n_samples:
            return np.zeros(record.n_samples)
        known = {name: self.share[span] for name, span in zip(own.trials, own.spans, strict=True)}
        parts = []
        for name, span in zip(record.trials, record.spans, strict=True):
            place = np.arange(span.stop - span.start) * own.rate_hz / record.rate_hz
            share = known.get(name, np.zeros(1))
            parts.append(np.interp(place, np.arange(len(share)), share))
        return np.concatenate(parts)


# Contacts that nobody logged: when and where a link is pressed on something, from what a fit leaves.


def find_contacts(problem: Problem, others: Fitted) -> list[tuple[FloatingEffect, str]]:
    """Contacts of links that may explain what a fit leaves: by their times, and by surfaces that links passed."""
    if not UnloggedContact().is_seen(problem.record):
        return []
    timed = find_contact(problem, others)
    links = link_names(problem.nominal)
    by_times = [(timed.placed[-1].effect, link) for link in links] if timed is not None else []
    return by_times + find_surfaces(problem, others)


# When was there a contact: two levels in what the baseline leaves.

_SMOOTH_HZ = 3.0
_SHORTEST_S = 0.25
_ROUNDS = 4
# Share of the variance that two levels must explain: 0.64 for Gaussian noise, 0.75 for an even spread.
_TWO_LEVELS = 0.8
# Each change between contact and none is a free moment in time.
_PRICE_OF_A_SWITCH = 6.0


def find_contact(problem: Problem, before: Fitted) -> Fitted | None:
    """Alternate between when and where, from two clusters of the smoothed residual; None if there are not two.

    Args:
        before: what is explained already.
    """
    residual = problem.record.smooth_signal(explained_state(problem, before).residual, _SMOOTH_HZ)
    noise = np.sqrt(np.diag(problem.record.sensor_noise))
    centred = (residual - residual.mean(axis=0)) / noise
    direction = np.linalg.svd(centred, full_matrices=False)[2][0]
    score = centred @ direction
    low, high = _two_means(score)
    upper = score > 0.5 * (low + high)
    between = upper.mean() * (1.0 - upper.mean()) * (high - low) ** 2
    if between < _TWO_LEVELS * score.var():
        return None
    best: Fitted | None = None
    for raw in ((score - low) / (high - low), (high - score) / (high - low)):
        found = _alternate_contact_fits(problem, before, _remove_short_spells(problem, raw))
        if found is not None and (best is None or found.evidence > best.evidence):
            best = found
        if best is not None and best.power < 2.0 * len(problem.nominal_rows):
            break
    return best


def _alternate_contact_fits(problem: Problem, before: Fitted, share: Array) -> Fitted | None:
    best: Fitted | None = None
    state = explained_state(problem, before)
    rows = problem.residual_rows(state) + problem.baseline_rows(before.delta)
    for _ in range(_ROUNDS):
        price = _PRICE_OF_A_SWITCH * float((np.abs(np.diff(share > 0.5))).sum())
        effect = UnloggedContact(share, problem.record, price)
        linear = {
            link: problem.fit_columns(
                rows, effect_columns(problem, state, effect, link, np.zeros(len(effect.own)))
            )
            for link in effect.locations(state)
        }
        fits = [
            refine_fit(
                problem,
                (*before.placed, Placed(effect, link)),
                (*before.theta, linear[link].theta * effect.parameter_scales(state, link)),
                before,
            )
            for link in sorted(linear, key=lambda link: -linear[link].evidence)[:2]
        ]
        found = max(fits, key=lambda item: item.evidence)
        if best is not None and found.evidence <= best.evidence + 1.0:
            return best
        best = found
        share = _remove_short_spells(problem, estimate_contact_share(problem, found))
        if not 0.01 < share.mean() < 0.99:
            return best
    return best


def estimate_contact_share(problem: Problem, fitted: Fitted) -> Array:
    """Share of the fitted force that acts at each instant, ``(n,)``, by weighted projection."""
    *_, place = fitted.placed
    *_, force = fitted.theta
    state = problem.state_with_errors(fitted.delta)
    state = apply_all(state, fitted.placed[:-1], fitted.theta[:-1])
    always = UnloggedContact(np.ones(problem.record.n_samples)).apply_to(state, place.location, force)
    pull = state.residual - always.residual
    weight = np.linalg.inv(problem.record.sensor_noise)
    residual = problem.record.smooth_signal(state.residual, 5.0)
    return np.einsum("ni,ij,nj->n", residual, weight, pull) / np.einsum("ni,ij,nj->n", pull, weight, pull)


def _remove_short_spells(problem: Problem, raw: Array) -> Array:
    """On and off with the shortest spells removed; near a change, the measured share itself."""
    width = 2 * max(1, round(0.5 * _SHORTEST_S * problem.record.rate_hz)) + 1
    share = np.empty_like(raw)
    for span in problem.record.spans:
        on = scipy.ndimage.median_filter((raw[span] > 0.5).astype(float), width, mode="nearest")
        change = np.flatnonzero(np.diff(on))
        share[span] = on
        for index in change:
            near = slice(max(0, index - 2), min(len(on), index + 4))
            share[span][near] = np.clip(raw[span][near], 0.0, 1.0)
    return share


def _two_means(score: Array) -> tuple[float, float]:
    low, high = (float(x) for x in np.quantile(score, [0.1, 0.9]))
    for _ in range(20):
        upper = score > 0.5 * (low + high)
        if upper.all() or not upper.any():
            break
        low, high = float(score[~upper].mean()), float(score[upper].mean())
    return low, high


# Surfaces that a link may have been pressed on.

_HEIGHTS, _DEPTHS_M = 12, (0.01, 0.035, 0.1, 0.3)


def find_surfaces(problem: Problem, before: Fitted) -> list[tuple[FloatingEffect, str]]:
    """Contacts with something that gives way, sought by where each link was and not by when: each link's best.

    Of each surface that a link passed, the force that explains most of what is left, instant by instant.

    Args:
        before: what is explained already.
    """
    state = explained_state(problem, before)
    factor = np.linalg.inv(np.linalg.cholesky(problem.record.sensor_noise))
    white = state.residual @ factor.T
    found: list[tuple[FloatingEffect, str]] = []
    for link in link_names(state):
        point = state.poses.translation[:, segment_of(state, link) + 1]
        arms = state.at_base(np.tile(np.eye(3), (len(point), 1, 1)), point)
        best = _best_surface(state, point, factor @ arms, white)
        if best is not None:
            found.append((PressedContact(best), link))
    return found


def _best_surface(state: State, point: Array, arms: Array, white: Array) -> Surface | None:
    """The surface that explains most of whitened residuals by one force whose share it is.

    Args:
        point: ``(n, 3)`` that it meets, world [m].
        arms: ``(n, 6, 3)`` whitened wrench of a unit force there along each axis.
        white: ``(n, 6)`` whitened residual.
    """
    turned = arms.transpose(0, 2, 1)
    own, shared = (turned @ arms).reshape(-1, 9), -(turned @ white[:, :, None])[:, :, 0]
    best, most = None, 0.0
    up = -state.record.tree.gravity / np.linalg.norm(state.record.tree.gravity)
    for normal in (up, *np.eye(3)[:2], *-np.eye(3)[:2]):
        along = point @ normal
        x, y, z = (float(part) for part in normal)
        heights, depths = (
            part.ravel()
            for part in np.meshgrid(np.quantile(along, np.linspace(0.1, 1.0, _HEIGHTS)), _DEPTHS_M)
        )
        shares = np.clip((heights[:, None] - along) / depths[:, None], 0.0, 1.0)
        grams, rights = (shares**2 @ own).reshape(-1, 3, 3), shares @ shared
        forces = np.linalg.solve(grams + 1e-9 * np.eye(3), rights[:, :, None])[:, :, 0]
        gains = np.where(forces @ normal > 0.0, (forces * rights).sum(axis=1), 0.0)
        k = int(gains.argmax())
        if gains[k] > most:
            best, most = Surface((x, y, z), float(heights[k]), float(depths[k]), False), float(gains[k])
    return best
