"""Effects of external forces on a floating base: pulls, unlogged and pressed contacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Any, ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.effect import (
    Beyond,
    FloatingEffect,
    Parameter,
    Reads,
    links,
    points,
    segment_of,
)
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.state import State, cross

# Something pulls at a link: a cable, a tether, a hand.

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
    seen_by = frozenset(Reads)

    def locations(self, state: State) -> tuple[str, ...]:
        """Links; the base alone, if its feet hold it, where joints' torques would carry it as well."""
        robot = state.record.robot
        return links(state) if robot.sensors else links(state)[: bool(robot.feet)]

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


# Forces at a point of a link.


def columns_of_force(state: State, joint: int, point: Array, force: Array, change: Array, at: slice) -> Array:
    """Minus the derivative of the residual, ``(n, 6, k)``, of a force whose point is a parameter as well.

    Args:
        state: where to linearise.
        joint: of the link, index in the tree.
        point: ``(n, 3)`` where it acts, world [m].
        force: ``(n, 3)`` world [N].
        change: ``(n, 3, k)`` its derivative by each parameter.
        at: the three parameters that are the point's coordinates in the joint's frame.
    """
    columns = -state.at_base(change, point)
    base = state.poses.rotation[:, 1]
    turned = np.einsum("nji,nj->ni", base, force)
    columns[:, 3:6, at] += cross(turned, base.transpose(0, 2, 1) @ state.poses.rotation[:, joint])
    return columns


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

    def share(self, along: Array, raised: float = 0.0, deeper: float = 0.0) -> Array:
        """Share of its largest force at positions ``along`` the normal.

        Args:
            along: ``(…)`` [m].
            raised: added to the height [m].
            deeper: logarithm of a factor on the depth.
        """
        s = self._sunk(along, raised, deeper)
        return s**2 * (3.0 - 2.0 * s) if self.rounded else s

    def slopes(self, along: Array, raised: float, deeper: float) -> tuple[Array, Array]:
        """Derivatives of the share by ``raised`` and by ``deeper``; arguments as above."""
        s = self._sunk(along, raised, deeper)
        rate = np.where((s > 0.0) & (s < 1.0), 6.0 * s * (1.0 - s) if self.rounded else 1.0, 0.0)
        return rate / (self.depth * np.exp(deeper)), -s * rate

    def _sunk(self, along: Array, raised: float, deeper: float) -> Array:
        """How far it is pressed in, 0 to 1."""
        s: Array = np.clip((self.height + raised - along) / (self.depth * np.exp(deeper)), 0.0, 1.0)
        return s


class PressedContact(FloatingEffect):
    """A world force at a point of the link that rises as the point sinks into a surface.

    What :class:`UnloggedContact` learns instant by instant is here a function of where the point is, so that
    soft things, which never are fully on or off, have their form too. The force is larger while the point
    sinks than while it rises (Hunt and Crossley 1975, eq. 10), and the surface rubs against the point's motion
    along it (Coulomb, smoothed about standstill).
    """

    name: ClassVar[str] = "unlogged_contact"
    form: ClassVar[str] = "pressed_contact"
    reads_as: ClassVar[str] = "a spring, where the link never leaves it"
    confusable_with: ClassVar[tuple[str, ...]] = ("external_force",)
    says = Beyond.FORCES

    def __init__(self, surface: Surface):
        self.surface = surface

    def holds(self, record: FloatingRecord) -> dict[str, Any]:
        """The surface."""
        return {"surface": asdict(self.surface)}

    def holding(self, said: Mapping[str, Any], record: FloatingRecord) -> PressedContact:
        """That is pressed on the surface which is said."""
        surface = said["surface"]
        return PressedContact(Surface(**{**surface, "normal": tuple(surface["normal"])}))

    def locations(self, state: State) -> tuple[str, ...]:
        """Links."""
        return links(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The largest force, world frame; the point in the link's frame; what the first guess is off by."""
        force = tuple(Parameter(axis, "N", 25.0, 1.0) for axis in ("fx", "fy", "fz"))
        shape = (Parameter("raised", "m", 0.05, 1e-3), Parameter("deeper", "1", 0.7, 0.02))
        moving = (Parameter("friction", "1", 0.3, 0.01), Parameter("damping", "s/m", 0.5, 0.02))
        return (*force, *points(), *shape, *moving)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Add it."""
        point = state.poses.point(segment_of(state, location) + 1, theta[3:6])
        normal = np.array(self.surface.normal)
        share = self.surface.share(point @ normal, theta[6], theta[7])
        force = share[:, None] * theta[:3]
        if theta[8:].any():
            speed = _speed(state, point)
            sinking = -(speed @ normal)
            sliding = speed + sinking[:, None] * normal
            smooth = np.sqrt((sliding**2).sum(axis=1) + _STANDSTILL_M_S**2)
            rubs = theta[8] * share * float(theta[:3] @ normal) / smooth
            force = (force - rubs[:, None] * sliding) * np.maximum(0.0, 1.0 + theta[9] * sinking)[:, None]
        return state.replace(extra=state.extra + state.at_base(force, point))

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """In closed form: a search fits dozens of surfaces."""
        joint, normal = segment_of(state, location) + 1, np.array(self.surface.normal)
        point, axes = state.poses.point(joint, theta[3:6]), state.poses.rotation[:, joint]
        along = point @ normal
        share = self.surface.share(along, theta[6], theta[7])
        raised, deeper = self.surface.slopes(along, theta[6], theta[7])
        push, press = theta[:3], float(theta[:3] @ normal)

        speed, turning = _speed(state, point), _speed(state, axes)
        sinking, turned_in = -(speed @ normal), -np.einsum("nik,i->nk", turning, normal)
        sliding = speed + sinking[:, None] * normal
        smooth = np.sqrt((sliding**2).sum(axis=1) + _STANDSTILL_M_S**2)[:, None]
        rub = sliding / smooth
        across = turning + normal[:, None] * turned_in[:, None]
        rubbed = (across - rub[:, :, None] * np.einsum("ni,nik->nk", rub, across)[:, None]) / smooth[
            :, :, None
        ]

        resist = np.maximum(0.0, 1.0 + theta[9] * sinking)[:, None]
        full = push - theta[8] * press * rub
        out = np.zeros((len(point), 3, 10))
        out[:, :, :3] = (share[:, None] * resist)[:, :, None] * (
            np.eye(3) - theta[8] * rub[:, :, None] * normal
        )
        out[:, :, 6], out[:, :, 7] = (slope[:, None] * full * resist for slope in (raised, deeper))
        out[:, :, 8] = -press * share[:, None] * rub * resist
        out[:, :, 9] = share[:, None] * full * np.where(resist > 0.0, sinking[:, None], 0.0)
        # Where the point is: how deep, how fast it slides and how fast it sinks.
        out[:, :, 3:6] = -out[:, :, 6, None] * np.einsum("nik,i->nk", axes, normal)[:, None]
        out[:, :, 3:6] -= theta[8] * press * (share[:, None] * resist)[:, :, None] * rubbed
        sunk = np.where(resist > 0.0, theta[9] * share[:, None] * full, 0.0)
        out[:, :, 3:6] += sunk[:, :, None] * turned_in[:, None]

        force = share[:, None] * full * resist
        return columns_of_force(state, joint, point, force, out, slice(3, 6))


def _speed(state: State, points: Array) -> Array:
    """``(n, …)`` rate of change of what moves with a link, by central differences within each trial [1/s]."""
    spans, rate = state.record.spans, state.record.rate_hz
    return np.concatenate([np.gradient(points[span], 1.0 / rate, axis=0) for span in spans])


# A hand or a knee rests on something that nobody logged.


class UnloggedContact(FloatingEffect):
    """A world force at a point of the link while the contact lasts; when it lasts is learnt from the record.

    ``share (n,)``, between 0 and 1, says when: a member made without it has no places. ``coarse`` is the same
    for a thinned record; ``price`` is that of the moments at which it comes and goes.
    """

    name: ClassVar[str] = "unlogged_contact"
    reads_as: ClassVar[str] = "any force that comes and goes; two levels, and the same link each time"
    confusable_with: ClassVar[tuple[str, ...]] = ("external_force",)
    says = Beyond.FORCES

    def __init__(self, share: Array | None = None, coarse: Array | None = None, price: float = 0.0):
        self.share, self.coarse, self.price = share, coarse, price

    def holds(self, record: FloatingRecord) -> dict[str, Any]:
        """When it lasts: by trial, how many samples in a row have which share."""
        spells = {}
        for trial, span in zip(record.trials, record.spans, strict=True):
            values = [round(float(x), 4) for x in self._share(record.n_samples)[span]]
            spells[trial] = [[len(list(run)), share] for share, run in groupby(values)]
        return {"spells": spells}

    def holding(self, said: Mapping[str, Any], record: FloatingRecord) -> UnloggedContact:
        """The contact that lasts as is said."""
        share = np.zeros(record.n_samples)
        for trial, span in zip(record.trials, record.spans, strict=True):
            runs = said["spells"].get(trial, [])
            values = np.repeat([run[1] for run in runs], [int(run[0]) for run in runs])
            share[span][: len(values)] = values[: span.stop - span.start]
        return UnloggedContact(share)

    def locations(self, state: State) -> tuple[str, ...]:
        """Links, once it is known when there was a contact."""
        return () if self.share is None else links(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The force while in contact, world frame, and the point in the link's frame."""
        force = tuple(Parameter(axis, "N", 25.0, 1.0) for axis in ("fx", "fy", "fz"))
        return (*force, *points())

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Add it."""
        share = self._share(len(state.q))
        point = state.poses.point(segment_of(state, location) + 1, theta[3:])
        return state.replace(extra=state.extra + state.at_base(share[:, None] * theta[:3], point))

    def _share(self, n: int) -> Array:
        """``(n,)`` share of a record with so many samples."""
        known = [share for share in (self.share, self.coarse) if share is not None]
        return next((share for share in known if len(share) == n), np.zeros(n))
