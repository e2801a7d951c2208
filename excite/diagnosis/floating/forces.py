"""Effects of external forces on a floating base: pulls, unlogged and pressed contacts."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.effect import (
    POINT,
    Absence,
    FloatingEffect,
    Parameter,
    Reads,
    link_names,
    segment_of,
)
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.state import State
from excite.logs.columns import WRENCH_AXES


class PointForce(FloatingEffect):
    """A force in the world at a point of a link.

    Attributes:
        at: the three parameters that are the point's coordinates in the frame of the link's joint.
    """

    says = Absence.FORCES
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
    confusable_with = ("sensor_bias", "base_orientation_bias")
    seen_by = frozenset(Reads)
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
    confusable_with = ("external_force",)
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

    ``share (n,)``, between 0 and 1, says when: a member made without it has no places. ``coarse`` is the same
    for a thinned record; ``price`` is that of the moments at which it comes and goes.
    """

    name = "unlogged_contact"
    reads_as = "any force that comes and goes; two levels, and the same link each time"
    confusable_with = ("external_force",)
    # The force while in contact, world frame, and the point in the link's frame.
    own = (*Parameter.of_names(_AXES, "N", 25.0, 1e-2), *POINT)

    def __init__(self, share: Array | None = None, coarse: Array | None = None, price: float = 0.0):
        self.share, self.coarse, self.price = share, coarse, price

    def stored_data(self, record: FloatingRecord) -> dict[str, Any]:
        """When it lasts: by trial, how many samples in a row have which share."""
        spells = {}
        for trial, span in zip(record.trials, record.spans, strict=True):
            values = [round(float(x), 4) for x in self._contact_share(record.n_samples)[span]]
            spells[trial] = [[len(list(run)), share] for share, run in groupby(values)]
        return {"spells": spells}

    def with_stored_data(self, said: Mapping[str, Any], record: FloatingRecord) -> UnloggedContact:
        """The contact that lasts as is said."""
        share = np.zeros(record.n_samples)
        for trial, span in zip(record.trials, record.spans, strict=True):
            runs = said["spells"].get(trial, [])
            values = np.repeat([run[1] for run in runs], [int(run[0]) for run in runs])
            share[span][: len(values)] = values[: span.stop - span.start]
        return UnloggedContact(share)

    def locations(self, state: State) -> tuple[str, ...]:
        """Links, once it is known when there was a contact."""
        return () if self.share is None else link_names(state)

    def force_at(self, state: State, point: Array, theta: Array) -> Array:
        """While it lasts."""
        return self._contact_share(len(state.q))[:, None] * theta[:3]

    def _contact_share(self, n: int) -> Array:
        """``(n,)`` share of a record with so many samples."""
        known = [share for share in (self.share, self.coarse) if share is not None]
        return next((share for share in known if len(share) == n), np.zeros(n))
