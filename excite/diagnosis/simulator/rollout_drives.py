"""What a simulation starts from and what drives it: windows of a record, logged torques, position servos."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from excite.arrays import Array


@dataclass(frozen=True, eq=False)
class Past:
    """The record before a window: what bristles, filters and soft gears remember.

    Attributes:
        time: ``(n,)`` of the trial [s], evenly spaced; the last one is the window's start.
        q: ``(n, n_joints)`` positions [rad].
        v: ``(n, n_joints)`` velocities [rad/s].
    """

    time: Array
    q: Array
    v: Array


@dataclass(frozen=True, eq=False)
class Window:
    """A piece of a record to be simulated.

    Attributes:
        q: ``(n_joints,)`` positions at its start [rad].
        v: velocities at its start [rad/s].
        load: torque that the links need at its start [N·m]; sets how far soft and loose gears are deflected of which
            that is not told.
        time: ``(n_steps,)`` of the steps [s] since the trial's start.
        session_s: time of its start within the session [s].
        growth: by joint, how far friction that drifts has come at its start; from the session's clock where it
            is not given.
        past: the record before it; without it the robot was at rest.
        deflected: by joint, how far a soft or loose gear is deflected at its start [rad] and how fast it moves
            [rad/s]; it rests under its load where that is not given.
    """

    q: Array
    v: Array
    load: Array
    time: Array
    session_s: float
    growth: Mapping[str, float] = field(default_factory=dict)
    past: Past | None = None
    deflected: Mapping[str, tuple[float, float]] = field(default_factory=dict)


class Drive(Protocol):
    """Where a simulation's torques come from."""

    def offers(self, times: Array) -> Array:
        """Torques of the motors in the zero position at rest ``(n, n_joints)`` [N·m], at times of the trial."""
        ...

    def answer(self, offer: Array, q: Array, v: Array) -> Array:
        """Torques of the motors at positions and velocities, from what is offered, all ``(…, n_joints)``."""
        ...


@dataclass(frozen=True, eq=False)
class LoggedTorque:
    """The record's own torques, no feedback.

    Attributes:
        time: ``(n,)`` [s].
        tau: ``(n, n_joints)`` [N·m].
    """

    time: Array
    tau: Array

    def offers(self, times: Array) -> Array:
        """The logged torques at those times."""
        return _interpolated(self.time, self.tau, times)

    def answer(self, offer: Array, q: Array, v: Array) -> Array:
        """What is offered: nothing is fed back."""
        return offer


@dataclass(frozen=True, eq=False)
class PositionServo:
    """``kp (q_cmd − q) + kd (v_cmd − v) + feedforward``, commands interpolated.

    Attributes:
        time: ``(n,)`` [s].
        q_cmd: ``(n, n_joints)``, v_cmd and feedforward alike.
        v_cmd: commanded velocities [rad/s].
        feedforward: torque added to it [N·m].
        kp: ``(n_joints,)`` [N·m/rad].
        kd: ``(n_joints,)`` [N·m·s/rad].
        undamped: leave ``−kd v`` to the one who asks.
    """

    time: Array
    q_cmd: Array
    v_cmd: Array
    feedforward: Array
    kp: Array
    kd: Array
    undamped: bool = False

    def offers(self, times: Array) -> Array:
        """What the servo asks for with the joints at zero and at rest."""
        asked = self.kp * self.q_cmd + self.kd * self.v_cmd + self.feedforward
        return _interpolated(self.time, asked, times)

    def answer(self, offer: Array, q: Array, v: Array) -> Array:
        """What is offered less what the joints have already done of it."""
        asked = offer - self.kp * q
        return asked if self.undamped else asked - self.kd * v


def _interpolated(time: Array, values: Array, times: Array) -> Array:
    """Rows of ``values`` between those at ``time``, the first and last one beyond."""
    k = np.clip(np.searchsorted(time, times) - 1, 0, len(time) - 2)
    share = np.clip((times - time[k]) / (time[k + 1] - time[k]), 0.0, 1.0)[:, None]
    return (1.0 - share) * values[k] + share * values[k + 1]
