"""Contacts of a tossed body with level ground: friction, restitution, and how long a touch may last.

No force is measured. A body that slides on three corners or more is slowed by ``μ (g + a_z)``. A corner that touches
alone between two flights takes the impulse ``m Δv``: its tangential part over its normal one is the friction while the
corner slides throughout, and the speed at which the corner leaves over that at which it came is the restitution
(Newton's hypothesis, Stronge 2000, chapter 3). Mass and inertia cancel.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError

# Samples of a flight that is fitted, and of a slide: 27 and 47 ms at 148 Hz, in which a touch ends and a slide hardly
# slows.
_FLIGHT, _SLIDE = 5, 8
# Share of the body's size within which a corner is on the ground, and beyond which it is free of it: motion capture of
# an acrylic cube of 105 mm lay within 4 mm of its table.
_ON, _OFF = 0.04, 0.02
# Of the speed of a face that slides, the most that its turning may add at a corner: friction of corners that slide to
# different sides adds up to less than all of it, by half the square of this.
_TURNS = 0.2
# Fewest tosses that an effect is told of.
_FEWEST = 5
# Draws of the tosses behind an interval.
_DRAWS = 400


@dataclass(frozen=True, eq=False)
class Toss:
    """A recorded toss.

    Attributes:
        time: ``(n,)`` even [s].
        position: ``(n, 3)`` of the centre of mass, z up [m].
        rotation: ``(n, 3, 3)`` from the body to the world.
    """

    time: Array
    position: Array
    rotation: Array


@dataclass(frozen=True)
class ContactEffect:
    """An effect of the ground.

    Attributes:
        name: ``ground_friction`` while a face slides, ``impact_friction`` while a corner strikes, ``restitution``.
        value: the median over events.
        low: lower end of the 95 % interval, by tosses drawn anew.
        high: its upper end.
        tosses: how many tosses tell it.
    """

    name: str
    value: float
    low: float
    high: float
    tosses: int


@dataclass(frozen=True)
class ContactDiagnosis:
    """What tosses tell of the ground.

    Attributes:
        effects: by name.
        lacking: by the name of an effect that is not told, the recording that would tell it.
        contact_time: time within which a touch was over, at most [s]: its stiffness is beyond the camera's rate.
    """

    effects: Mapping[str, ContactEffect]
    contact_time: float
    lacking: Mapping[str, str] = field(default_factory=dict)

    def summary(self) -> str:
        """What there is to say, a line an effect."""
        told = [
            f"{one.name.replace('_', ' ')} {one.value:.3f} ({one.low:.3f}…{one.high:.3f}, {one.tosses} tosses)"
            for one in self.effects.values()
        ]
        missing = [f"{name.replace('_', ' ')}: not told; {remedy}" for name, remedy in self.lacking.items()]
        return "\n".join([*told, *missing, f"a touch lasts less than {1e3 * self.contact_time:.0f} ms"])


_WOULD_TELL = {
    "ground_friction": "toss the body flat and fast, so that it slides on a face",
    "impact_friction": "toss it askew and fast along the ground, so that a corner strikes alone",
    "restitution": "toss it askew, so that a corner strikes alone",
}


def diagnose_tosses(
    tosses: Sequence[Toss], corners: Array, *, gravity: float = 9.81, rng: np.random.Generator | None = None
) -> ContactDiagnosis:
    """Friction and restitution of the ground that a body was tossed on.

    Args:
        tosses: poses of the centre of mass.
        corners: of the body, ``(n_corners, 3)`` from its centre of mass [m].
        gravity: [m/s²].
        rng: of the intervals.

    Returns:
        The effects with intervals, and what the tosses do not tell.

    Raises:
        InputError: too few corners, no toss lies flat on the ground, or flights do not fall as gravity has it.
    """
    if np.shape(corners)[1:] != (3,) or len(corners) < 4:
        raise InputError(
            f"have the shape {np.shape(corners)}",
            source="tosses",
            field="corners",
            remedy="give four points or more of the body from its centre of mass, a row each [m]",
        )
    rng = rng or np.random.default_rng(0)
    size = float(np.ptp(corners, axis=0).max())
    lowest = [np.asarray(toss.position[:, 2:] + toss.rotation[:, 2] @ corners.T) for toss in tosses]
    ground = _ground_height(tosses, lowest, _ON * size)
    events: dict[str, list[tuple[int, float]]] = {name: [] for name in _WOULD_TELL}
    falls: list[float] = []
    for number, (toss, above) in enumerate(zip(tosses, lowest, strict=True)):
        heights = above - ground
        falls += _find_falls(toss, np.abs(heights.min(axis=1)), _OFF * size)
        events["ground_friction"] += [(number, mu) for mu in _find_slides(toss, heights, size, gravity)]
        for mu, restitution in _find_strikes(toss, heights, corners, _OFF * size, gravity):
            events["restitution"].append((number, restitution))
            events["impact_friction"] += [] if mu is None else [(number, mu)]
    if falls and abs(np.median(falls) / gravity - 1.0) > 0.1:
        raise InputError(
            f"fall with {np.median(falls):.3g} m/s², not {gravity:g}",
            source="tosses",
            field="position",
            remedy="give metres and seconds, z up",
        )
    effects = {}
    for name, found in events.items():
        values = [np.array([v for k, v in found if k == one]) for one in dict.fromkeys(k for k, _ in found)]
        if len(values) >= _FEWEST:
            drawn = [
                np.median(np.concatenate([values[k] for k in rng.integers(len(values), size=len(values))]))
                for _ in range(_DRAWS)
            ]
            low, high = np.quantile(drawn, [0.025, 0.975])
            middle = float(np.median(np.concatenate(values)))
            effects[name] = ContactEffect(name, middle, float(low), float(high), len(values))
    step = max(float(np.median(np.diff(toss.time))) for toss in tosses)
    lacking = {name: remedy for name, remedy in _WOULD_TELL.items() if name not in effects}
    return ContactDiagnosis(effects, 2.0 * step, lacking)


def _ground_height(tosses: Sequence[Toss], heights: Sequence[Array], near: float) -> float:
    """Height of the ground: where three corners lie that neither rise nor sink."""
    found = []
    for toss, above in zip(tosses, heights, strict=True):
        three = np.sort(above, axis=1)[:, :3]
        still = np.abs(np.gradient(toss.position[:, 2], toss.time)) < near
        flat = (np.ptp(three, axis=1) < near) & still
        found += three[flat].mean(axis=1).tolist()
    if not found:
        raise InputError(
            "never lies on a face", source="tosses", field="position", remedy="record until it is at rest"
        )
    return float(np.median(found))


def _find_falls(toss: Toss, away: Array, clear: float) -> Iterator[float]:
    """Acceleration downwards off the ground [m/s²]: above it, or below where z points down."""
    for window in _find_windows(np.asarray(away > clear), _SLIDE):
        yield -_fit_motion(toss, window)[1][2]


def _find_windows(inside: NDArray[np.bool_], length: int) -> Iterator[slice]:
    """Stretches of samples that all are ``inside``."""
    for start in range(len(inside) - length + 1):
        if inside[start : start + length].all():
            yield slice(start, start + length)


def _fit_motion(toss: Toss, window: slice) -> tuple[Array, Array]:
    """Velocity at the middle of a window, and acceleration, of the centre."""
    t = toss.time[window] - toss.time[window].mean()
    basis = np.column_stack([np.ones_like(t), t, 0.5 * t**2])
    _, velocity, acceleration = np.linalg.lstsq(basis, toss.position[window], rcond=None)[0]
    return velocity, acceleration


def _find_slides(toss: Toss, heights: Array, size: float, gravity: float) -> Iterator[float]:
    """Friction in stretches in which a face slides on straight, and does not come to rest."""
    near = _ON * size
    flat = np.asarray(np.sort(heights, axis=1)[:, 2] < near)
    for window in _find_windows(flat, _SLIDE):
        velocity, acceleration = _fit_motion(toss, window)
        speed = float(np.hypot(*velocity[:2]))
        slowed = -float(acceleration[:2] @ velocity[:2]) / max(speed, 1e-9)
        lasts = float(toss.time[window][-1] - toss.time[window][0])
        turned = float(np.linalg.norm(pin.log3(toss.rotation[window][-1] @ toss.rotation[window][0].T)))
        straight = 2.0 * _TURNS * speed * lasts / size
        # What it would lose in the rest of the window it still has.
        if speed > 2.0 * abs(slowed) * lasts and turned < straight:
            yield slowed / (gravity + float(acceleration[2]))


def _find_strikes(
    toss: Toss, heights: Array, corners: Array, clear: float, gravity: float
) -> Iterator[tuple[float | None, float]]:
    """Friction, None where the corner stops sliding, and restitution of each touch of one corner between flights."""
    n, step = _FLIGHT, float(np.median(np.diff(toss.time)))
    fall = np.array([0.0, 0.0, gravity])
    for window in _find_windows(np.asarray(heights.min(axis=1) > clear), n):
        k = window.stop - 1
        place, speed, turn = _fit_flight(toss, window, fall)
        soon = np.linspace(0.0, 3.0 * step, 61)
        turned = np.array([pin.exp3(turn * tau) @ toss.rotation[k] for tau in soon])
        offset = heights[k, 0] - toss.position[k, 2] - toss.rotation[k, 2] @ corners[0]
        centre = place[2] + speed[2] * soon - 0.5 * gravity * soon**2
        ahead = centre[:, None] + turned[:, 2] @ corners.T + offset
        touches = np.flatnonzero(ahead.min(axis=1) < 0.0)
        if not len(touches):
            continue
        at = touches[0]
        corner, (_, second) = int(ahead[at].argmin()), np.sort(ahead[at])[:2]
        first = k + int(np.ceil(soon[at] / step)) + 1
        after = slice(first, first + n)
        rest = np.delete(heights[after], corner, axis=1)
        if (
            second < 4.0 * clear
            or len(rest) < n
            or rest.min() < 2.0 * clear
            or heights[after][1:, corner].min() < 0.0
        ):
            continue
        moment = toss.time[k] + soon[at]
        before = speed - fall * soon[at]
        _, left, left_turn = _fit_flight(toss, after, fall, moment)
        arm = turned[at] @ corners[corner]
        came, leaves = before + np.cross(turn, arm), left + np.cross(left_turn, arm)
        impulse = left - before
        if came[2] >= 0.0 or impulse[2] <= 0.0:
            continue
        slides = came[:2] @ leaves[:2] > 0.5 * float(came[:2] @ came[:2]) > 0.0
        yield (float(np.hypot(*impulse[:2]) / impulse[2]) if slides else None), float(-leaves[2] / came[2])


class _Flight(NamedTuple):
    """Place, velocity and turning rate at a moment of a flight, ``(3,)`` each."""

    place: Array
    velocity: Array
    turn: Array


def _fit_flight(toss: Toss, window: slice, fall: Array, moment: float | None = None) -> _Flight:
    """A free flight at a moment, at the window's last sample if None."""
    t = toss.time[window] - (toss.time[window][-1] if moment is None else moment)
    straight = toss.position[window] + 0.5 * t[:, None] ** 2 * fall
    place, velocity = np.linalg.lstsq(np.column_stack([np.ones_like(t), t]), straight, rcond=None)[0]
    turned = pin.log3(toss.rotation[window][-1] @ toss.rotation[window][0].T)
    return _Flight(place, velocity, turned / float(t[-1] - t[0]))
