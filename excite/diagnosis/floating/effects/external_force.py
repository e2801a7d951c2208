"""Something pulls at a link: a cable, a tether, a hand."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, links, points, segment_of
from excite.diagnosis.floating.effects.form import Beyond
from excite.diagnosis.floating.effects.point_force import columns_of_force
from excite.diagnosis.floating.equations.state import State

# A force of this size and less has no direction to speak of.
_NO_DIRECTION_N = 2.0


class ExternalForce(FloatingEffect):
    """A force at a point p of the link, constant in the world but for springs: F − k x − k' f (f · x), x = p − mean p.

    A cord of length L under tension T resists by T/L across its direction f = F/|F| and by its own stiffness
    along it; a spring that resists alike in all directions has k' = 0. Where on the link it is hooked is not
    known; the link's origin is but the likeliest place.
    """

    name: ClassVar[str] = "external_force"
    reads_as: ClassVar[str] = "sensor bias (the unloaded foot tells), base orientation (bend and turn)"
    confusable_with: ClassVar[tuple[str, ...]] = ("sensor_bias", "base_orientation_bias")
    says = Beyond.FORCES

    def locations(self, state: State) -> tuple[str, ...]:
        """Links."""
        return links(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Mean force in the world, stiffness across it, the point in the link's frame, and what is added along it."""
        force = tuple(Parameter(axis, "N", 15.0, 1.0) for axis in ("fx", "fy", "fz"))
        along = Parameter("further_stiffness_along", "N/m", 30.0, 1.0)
        return (*force, Parameter("stiffness", "N/m", 30.0, 1.0), *points(), along)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Add it."""
        point = state.poses.point(segment_of(state, location) + 1, theta[4:7])
        return state.replace(
            extra=state.extra + state.at_base(_pull(theta, point - point.mean(axis=0)), point)
        )

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """In closed form: it is tried at every link."""
        joint = segment_of(state, location) + 1
        point, axes = state.poses.point(joint, theta[4:7]), state.poses.rotation[:, joint]
        away, turned = point - point.mean(axis=0), axes - axes.mean(axis=0)
        direction = _direction(theta)
        along = (away @ direction)[:, None]
        # How the direction turns with the force.
        turns = (np.eye(3) - np.outer(direction, direction)) / np.hypot(
            np.linalg.norm(theta[:3]), _NO_DIRECTION_N
        )
        out = np.empty((len(point), 3, 8))
        out[:, :, :3] = np.eye(3) - theta[7] * (
            along[:, :, None] * turns + direction[:, None] * (away @ turns)[:, None]
        )
        out[:, :, 3], out[:, :, 7] = -away, -along * direction
        out[:, :, 4:7] = -theta[3] * turned
        out[:, :, 4:7] -= theta[7] * direction[:, None] * np.einsum("nik,i->nk", turned, direction)[:, None]
        return columns_of_force(state, joint, point, _pull(theta, away), out, slice(4, 7))


def _direction(theta: Array) -> Array:
    """``(3,)`` of the mean force; shorter than one where there is hardly any."""
    return np.asarray(theta[:3] / np.hypot(np.linalg.norm(theta[:3]), _NO_DIRECTION_N))


def _pull(theta: Array, away: Array) -> Array:
    """``(n, 3)`` force where the point is ``away (n, 3)`` from its mean [N]."""
    direction = _direction(theta)
    return np.asarray(theta[:3] - theta[3] * away - theta[7] * (away @ direction)[:, None] * direction)
