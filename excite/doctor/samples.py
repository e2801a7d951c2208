"""Samples of a log's trials for any reading of its channels, and mistakes by which channels are read otherwise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from scipy.optimize import minimize_scalar

from excite.arrays import Array, Flags, Indices, Moved
from excite.doctor.channel_mapping import Reading
from excite.doctor.doubt import Doubt
from excite.doctor.inertial_prior import Judgement
from excite.errors import LogError
from excite.logs.log import Log, Trial
from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot
from excite.rows.kinematics import TrialKinematics

Made = TypeVar("Made")

# Bodies beyond a joint turn with it, their first moments with the angle, their inertias with its double, and with these
# every torque: trigonometric polynomials of second degree in the joint's angle, which five angles determine [rad].
TURNS = 2.0 * np.pi * np.arange(5) / 5


def _weigh_turns(angles: Array) -> Array:
    """Weights of the values at :data:`TURNS` in those at angles ``(k,)``: ``(k, 5)`` (trigonometric interpolation)."""
    away = np.asarray(angles, dtype=float)[:, None] - TURNS
    return np.asarray(1.0 + 2.0 * np.cos(away) + 2.0 * np.cos(2.0 * away)) / len(TURNS)


@dataclass(frozen=True, eq=False, kw_only=True)
class Samples(ABC):
    """Samples of a log's trials, channels as they stand in it.

    Attributes:
        robot: the robot in the log.
        joints: the log's joints; ``places`` their indices into ``v``.
        logged: ``(n_all, …)`` torques or wrenches, filtered as the positions, every sample of the trials [SI].
        rows: ``(n,)`` where in ``logged`` the samples are; ``first``, ``last`` the ends of their trials there.
        rate_hz: of ``logged``, and of the stamps.
    """

    what: ClassVar[str]
    """What was measured, in a word."""

    robot: Robot
    joints: tuple[str, ...]
    places: Indices
    logged: Array
    rows: Indices
    first: Indices
    last: Indices
    rate_hz: float
    _known: dict[str, dict[Hashable, Any]] = field(default_factory=dict, init=False, repr=False)

    @property
    @abstractmethod
    def channels(self) -> tuple[str, ...]:
        """What is predicted: joints with a torque, or components of the wrench on the base."""

    @abstractmethod
    def tells(self, reading: Reading) -> Flags:
        """Which channels the model's bodies make a good share of, ``(n_channels,)``; the rest is friction."""

    @abstractmethod
    def left(self, reading: Reading) -> Array:
        """Half the logarithm of the share of each channel's power that nothing explains, ``(n_channels,)``."""

    @abstractmethod
    def judged(self, reading: Reading, counts: Array | None = None) -> Judgement:
        """The same beside the likeliest bodies, by so many effective samples a channel; slower."""

    @abstractmethod
    def mixed(
        self, readings: Sequence[Reading], weights: Callable[[Array], Array]
    ) -> Callable[[Array], Array]:
        """What is left of mixtures of what the model needs in some readings, that differ in the motion alone.

        Torques are linear in a joint's zero and in gravity once these are written out, so that many readings are
        mixtures of few.

        Args:
            readings: the parts.
            weights: ``(k, n_parts)`` of values ``(k, …)``.

        Returns:
            Function of the values, ``(k, n_channels)``.
        """

    def keep_made(self, kind: str, key: Hashable, make: Callable[[], Made], most: int = 64) -> Made:
        """What was made of a kind for a key; corrections change one thing at a time and come back to the same few."""
        known: dict[Hashable, Made] = self._known.setdefault(kind, {})
        if key not in known:
            known[key] = make()
            if len(known) > most:
                del known[next(iter(known))]
        return known[key]

    def thin_out(self, readings: int) -> Samples:
        """The same with less samples where this many readings are to be compared; those of wrenches are few."""
        return self

    def by_zero(self, reading: Reading, joint: int) -> Callable[[Array], Array]:
        """What is left, as a function of angles added to a joint's zero ``(k,)`` [rad]: ``(k, n_channels)``."""
        return self.mixed([reading.with_position(joint, zero=float(t)) for t in TURNS], _weigh_turns)

    def by_gravity(self, reading: Reading) -> Callable[[Array], Array]:
        """What is left, as a function of gravities ``(k, 3)`` [m/s²]: ``(k, n_channels)``."""
        pulls = [replace(reading, gravity=pull) for pull in np.vstack([np.zeros(3), np.eye(3)])]
        return self.mixed(pulls, lambda g: np.column_stack([1.0 - np.sum(g, axis=1), g]))

    @property
    def sliding(self) -> Flags:
        """Which of ``joints`` slide: they have no quarter turns."""
        return np.array([is_prismatic(self.robot.model, int(place)) for place in self.places])

    def read_motion(self, motion: Moved, reading: Reading) -> Moved:
        """``q (n, nq)``, ``v``, ``a (n, nv)`` with the joints as the reading has them."""
        q, v, a = (values.copy() for values in motion)
        shift = q.shape[1] - v.shape[1]
        factor = reading.position_sign * reading.unit
        source = self.places[reading.position_of]
        for values, offset, scale in ((q, shift, 1.0), (v, 0, reading.tick), (a, 0, reading.tick**2)):
            values[:, self.places + offset] = values[:, source + offset] * factor / scale @ reading.joined.T
        q[:, self.places + shift] += reading.zero
        return Moved(q, v, a)

    def logged_late(self, reading: Reading) -> Array:
        """What was logged ``late_s`` after the samples, ``(n, …)``."""
        if reading.late_s == 0.0:
            return self.logged[self.rows]
        at = np.clip(self.rows + reading.late_s / reading.tick * self.rate_hz, self.first, self.last - 1e-9)
        below = at.astype(np.int64)
        share = (at - below).reshape(-1, *(1,) * (self.logged.ndim - 1))
        return np.asarray((1.0 - share) * self.logged[below] + share * self.logged[below + 1])


class TrialValues(NamedTuple):
    """What a trial tells.

    Attributes:
        kinematics: in every way in which its positions may be read; they have their times in common.
        logged: ``(n, …)`` torques or wrenches at these times, filtered.
        chosen: ``(n,)`` which of them are samples.
    """

    kinematics: Sequence[TrialKinematics]
    logged: Array
    chosen: Flags


def gather_samples(
    robot: Robot, log: Log, trials: Iterable[Trial], read: Callable[[Trial], TrialValues], most: float
) -> tuple[list[Moved], dict[str, Any]] | None:
    """Motions of the samples of trials, by how they are read, and the fields of :class:`Samples`; None for no samples.

    Args:
        robot: as it is in the log.
        log: the log.
        trials: those that are looked at; what raises LogError is left out.
        read: what a trial tells.
        most: samples are thinned out to about so many.
    """
    motions, logged, places, rate, end = [], [], [], 0.0, 0
    for trial in trials:
        try:
            kinematics, values, chosen = read(trial)
        except LogError:
            continue
        rows = np.flatnonzero(chosen)
        places.append(np.column_stack([rows + end, *np.tile([[end], [end + len(values) - 1]], len(rows))]))
        motions.append([Moved(k.q[rows], k.v[rows], k.a[rows]) for k in kinematics])
        logged.append(values)
        rate, end = kinematics[0].rate_hz, end + len(values)
    if not sum(map(len, places)):
        return None
    thinned = np.concatenate(places)
    some = slice(None, None, max(1, int(len(thinned) / most)))
    joined = [
        Moved(*(np.concatenate(parts)[some] for parts in zip(*one, strict=True)))
        for one in zip(*motions, strict=True)
    ]
    joints, fields = log.header.joints, dict(zip(("rows", "first", "last"), thinned[some].T, strict=True))
    of_joints = np.array([robot.n_base_v + robot.joint_index(name) for name in joints])
    whole = {"logged": np.concatenate(logged), "rate_hz": rate}
    return joined, {"robot": robot, "joints": joints, "places": of_joints, **fields, **whole}


def minimize_near(left: Callable[[Array], Array], best: float, step: float, within: float) -> float:
    """The value within a step of the best of a grid at which least is left.

    Args:
        left: what is left at values ``(k,)``, ``(k, n)`` of several channels.
        best: of the grid; ``step``, ``within``: of the grid, and to which the value is known.
    """
    bounds = (best - step, best + step)
    found = minimize_scalar(
        lambda value: float(left(np.array([value])).sum()),
        bounds=bounds,
        method="bounded",
        options={"xatol": within},
    )
    return float(found.x)


# A mistake in how a log calls its channels: what undoing it would make of them.

THE_UNIT = "find the unit; results are in the log's unit"
"""What is asked for where a unit is none that is known."""


@dataclass(frozen=True, eq=False)
class Correction:
    """A log read otherwise.

    Attributes:
        reading: the channels with the mistake undone.
        text: what looks wrong, in words.
        places: joints or channels concerned.
        figures: numbers of the finding, SI.
        changes: how many things were changed at will: each has to bring its share.
        surprise: how unlikely the numbers are without the mistake [nat], where likely bodies could make them too;
            None where the fit decides.
        ask: what a person has to say, where nobody else can; the log is then left as it is. Empty where it is mended.
        as_logged: of a correction that asks, what takes it out of a reading again.
        along: places among them that tell nothing of it and go with the others.
        certain: whether the log is mended with exactly what was found; an estimate leaves a rest.
        mends: what was done, where more is to be said of it than that it was put right.
    """

    reading: Reading
    text: str
    places: tuple[str, ...]
    figures: Mapping[str, float] = field(default_factory=dict)
    changes: int = 1
    surprise: float | None = None
    ask: str = ""
    as_logged: Callable[[Reading], Reading] | None = None
    along: tuple[str, ...] = ()
    certain: bool = True
    mends: str = ""


@dataclass(frozen=True)
class Mistake:
    """A way to call channels wrongly: a row of a table.

    Attributes:
        name: kind of its findings.
        corrections: of samples of the log and of the reading so far, other mistakes undone: readings in which it is
            undone, the plausible ones.
        leaves: what is known only about where it could not be undone exactly.
        of_posture: whether it is one of how joints or base were recorded, which those that were computed do not have.
        may_surprise: whether it has corrections that are believed though likely bodies explain the log as it is.
    """

    name: str
    corrections: Callable[[Any, Reading], Iterable[Correction]]
    leaves: frozenset[Doubt] = frozenset()
    of_posture: bool = False
    may_surprise: bool = False
