"""Surfaces that a link may have been pressed on."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.effects.effect import links, segment_of
from excite.diagnosis.floating.effects.pressed_contact import PressedContact, Surface
from excite.diagnosis.floating.equations.contact_times import pulled
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.equations.state import State
from excite.diagnosis.floating.search.refinement import Fitted, Placed, explained_state, linearised, refine

# Less of the share's variance than this is explained by nothing that stands still.
_LEAST_EXPLAINED = 0.5
_HEIGHTS, _DEPTHS_M = 25, (0.005, 0.01, 0.02, 0.035, 0.06, 0.1, 0.17, 0.3)
# Links that are fitted in full.
_LINKS = 6


def pressed(problem: Problem, contact: Fitted) -> Fitted | None:
    """A contact that was found in time, as one with a surface; None where no surface explains the times.

    Args:
        problem: the problem.
        contact: a fit whose last effect is an unlogged contact.
    """
    place, theta = contact.placed[-1], contact.theta[-1]
    force = theta[:3]
    if not np.linalg.norm(force) > 0.0:
        return None
    state = explained_state(problem, contact)
    point = state.poses.point(segment_of(state, place.location) + 1, theta[3:6])
    normal = _normal(force, -state.record.tree.gravity)
    found = _surface(point @ normal, pulled(problem, contact), normal)
    if found is None:
        return None
    surface, scale = found
    start = np.concatenate([scale * force, theta[3:6], np.zeros(4)])
    placed = (*contact.placed[:-1], Placed(PressedContact(surface), place.location))
    return refine(problem, placed, (*contact.theta[:-1], start), contact)


def _normal(force: Array, up: Array) -> Array:
    """Of a floor, a table or a ceiling where the force is mostly vertical, of a wall otherwise."""
    up = up / np.linalg.norm(up)
    lift = float(force @ up)
    level = force - lift * up
    return np.sign(lift) * up if abs(lift) > np.linalg.norm(level) else level / np.linalg.norm(level)


def _surface(along: Array, share: Array, normal: Array) -> tuple[Surface, float] | None:
    """The surface that explains a measured share best by least squares, and its largest force over the fitted."""
    best, least = None, (1.0 - _LEAST_EXPLAINED) * float(((share - share.mean()) ** 2).sum())
    x, y, z = (float(part) for part in normal)
    for height in np.quantile(along, np.linspace(0.02, 1.0, _HEIGHTS)):
        for depth in _DEPTHS_M:
            for rounded in (False, True):
                surface = Surface((x, y, z), float(height), depth, rounded)
                model = surface.share(along)
                power = float(model @ model)
                if power < 1e-9:
                    continue
                scale = float(model @ share) / power
                left = float(((share - scale * model) ** 2).sum())
                if scale > 0.0 and left < least:
                    best, least = (surface, scale), left
    return best


def find_surfaces(problem: Problem, before: Fitted, least: float, steps: int) -> list[Fitted]:
    """Contacts with something that gives way, sought by where each link was and not by when: the likeliest links.

    For each link and each surface that it passed, the force that explains most of what is left, instant by
    instant; then the links' best in the likelihood, and the best of those refined.

    Args:
        problem: the problem.
        before: what is explained already.
        least: what a link's best must gain in the likelihood [nats] to be refined.
        steps: of the refinement.
    """
    beside, state, rows = linearised(problem, before)
    factor = np.linalg.inv(np.linalg.cholesky(problem.record.sensor_noise))
    white = state.residual @ factor.T
    guesses, columns = [], []
    for link in links(state):
        point = state.poses.translation[:, segment_of(state, link) + 1]
        arms = state.at_base(np.tile(np.eye(3), (len(point), 1, 1)), point)
        best = _best_surface(state, point, factor @ arms, white)
        if best is None:
            continue
        effect = PressedContact(best)
        scales = effect.scales(state, link)
        guesses.append((link, effect, scales))
        # Linear in the force; where the point is and how the surface gives way come with the refinement.
        share = best.share(point @ np.array(best.normal))
        pushed = problem.whitening(-share[:, None, None] * arms) * scales[:3]
        columns.append(np.vstack([pushed, np.zeros((len(rows) - len(pushed), 3))]))
    fits = beside.fit_each(rows, columns) if columns else []
    likely = sorted(
        ((fit, guess) for fit, guess in zip(fits, guesses, strict=True) if fit.gain > least),
        key=lambda item: -item[0].evidence,
    )
    return [
        refine(
            problem,
            (*before.placed, Placed(effect, link)),
            (*before.theta, np.concatenate([fit.theta * scales[:3], np.zeros(7)])),
            before,
            steps,
        )
        for fit, (link, effect, scales) in likely[:_LINKS]
    ]


def _best_surface(state: State, point: Array, arms: Array, white: Array) -> Surface | None:
    """The surface that explains most of whitened residuals by one force whose share it is.

    Args:
        state: the state.
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
            for part in np.meshgrid(np.quantile(along, np.linspace(0.1, 1.0, _HEIGHTS // 2)), _DEPTHS_M[1::2])
        )
        shares = np.clip((heights[:, None] - along) / depths[:, None], 0.0, 1.0)
        grams, rights = (shares**2 @ own).reshape(-1, 3, 3), shares @ shared
        forces = np.linalg.solve(grams + 1e-9 * np.eye(3), rights[:, :, None])[:, :, 0]
        gains = np.where(forces @ normal > 0.0, (forces * rights).sum(axis=1), 0.0)
        k = int(gains.argmax())
        if gains[k] > most:
            best, most = Surface((x, y, z), float(heights[k]), float(depths[k]), False), float(gains[k])
    return best
