"""Virtual iiwas: one that moves as Table 4 measured, one simulated in MuJoCo with Tables 6 and 7 as truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from excite.arrays import Array
from excite.logs.signals.butterworth import lowpass
from excite.motion.motion import Motion
from excite.simulation.true_parameters import TrueParameters, nominal_drives
from excite.simulation.virtual_robot import VirtualRobot
from tests.reproduction.iiwa import (
    CUTOFF_HZ,
    N_COLUMNS,
    N_INERTIAL,
    N_JOINTS,
    ORDER,
    PERIOD_S,
    RATE_HZ,
    allowed_near,
    iiwa,
    published_base,
    published_parameters,
    rows,
)
from tests.reproduction.iiwa_excitation import excitation
from tests.reproduction.periods import average_periods, periodic_derivatives
from tests.simulation.motions import simulate

# Table 8, columns of the base parameters: what they leave, for reference trajectories 1, 2 and 3 [N·m].
UNEXPLAINED = {
    1: np.array([0.320, 0.407, 0.205, 0.299, 0.125, 0.122, 0.111]),
    2: np.array([0.297, 0.288, 0.129, 0.128, 0.076, 0.103, 0.193]),
    3: np.array([0.378, 0.497, 0.287, 0.274, 0.181, 0.152, 0.230]),
}
# Second reference: q = A (cos ωt − B), section IV.E; one period of it.
_AMPLITUDE = np.pi / np.array([12.0, 6.0, 12.0, 6.0, 12.0, 6.0, 12.0])
_OFFSET, _OMEGA = 0.1, 0.03
# Third reference: "very slow joint velocity"; here the excitation at a tenth of its speed.
_SLOWER = 10.0
_PERIODS = 4


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recording of a reference trajectory.

    Attributes:
        time: ``(n,)`` [s].
        q: ``(n, 7)`` [rad].
        v: ``(n, 7)``.
        a: ``(n, 7)``.
        tau: ``(n, 7)`` joint torques [N·m].
    """

    time: Array
    q: Array
    v: Array
    a: Array
    tau: Array

    def regressor(self) -> Array:
        """Rows of eq. (5), ``(7n, 84)``."""
        return rows(self.q, self.v, self.a).reshape(-1, N_COLUMNS)


def reference(number: int) -> tuple[float, Callable[[Array, int], Array]]:
    """Duration [s] and curve ``(t, order)`` of reference trajectory 1, 2 or 3."""
    if number == 2:
        return 2.0 * np.pi / _OMEGA, _cosine
    slower = 1.0 if number == 1 else _SLOWER
    return slower * PERIOD_S, lambda t, order: excitation().evaluate(t / slower, order) / slower**order


def _cosine(t: Array, order: int) -> Array:
    values = _OMEGA**order * np.cos(_OMEGA * t + 0.5 * np.pi * order)
    return _AMPLITUDE * (values[:, None] - (_OFFSET if order == 0 else 0.0))


def measured_base() -> Array:
    """Parameters ``(84,)`` whose base parameters are those of Table 4; all others are zero."""
    parameters = np.zeros(N_COLUMNS)
    for row in published_base():
        parameters[row.column] = row.base
    return parameters


@cache
def measured_twin(number: int) -> Recorded:
    """The robot of the paper as far as the paper tells: torques of Table 4's base parameters.

    White noise stands for what they left unexplained (Table 8), 10000 samples as in the paper.
    """
    duration, curve = reference(number)
    n = round(PERIOD_S * RATE_HZ)
    time = np.arange(n) * duration / n
    q, v, a = (curve(time, order) for order in range(3))
    noise = np.random.default_rng(number).standard_normal((n, N_JOINTS)) * UNEXPLAINED[number]
    return Recorded(time, q, v, a, rows(q, v, a) @ measured_base() + noise)


@cache
def true_parameters() -> Array:
    """Truth of the simulated robot ``(84,)``: the published solution, moved to where bodies can exist."""
    return allowed_near(published_parameters("xu2020"))


@cache
def simulated_twin(number: int) -> Recorded:
    """A MuJoCo robot under its position servo, torque sensors after the gears, their noise included.

    Position averaged over periods and differentiated in the frequency domain up to the low-pass (the servo sags
    under gravity, which adds harmonics to the five commanded), torque averaged and filtered,
    as in section II.C, and the second and third reference, of one period each, alike.
    """
    robot, truth = iiwa(), true_parameters()
    friction = truth[N_INERTIAL:].reshape(2, N_JOINTS)
    # Friction after the torque sensors, which is what eq. (1) has in the measured torque.
    drives = replace(
        nominal_drives(robot),
        viscous=np.zeros(N_JOINTS),
        coulomb=np.zeros(N_JOINTS),
        bearing_viscous=friction[0],
        bearing_coulomb=friction[1],
    )
    virtual = VirtualRobot(robot, TrueParameters(truth[:N_INERTIAL].copy()), drives)
    duration, curve = reference(number)
    periods = _PERIODS if number == 1 else 1
    time = np.arange(round(periods * duration * RATE_HZ) + 1) / RATE_HZ
    motion = Motion(
        f"reference_{number}",
        robot.name,
        robot.joint_names,
        time,
        *(curve(time, order) for order in range(3)),
    )
    trial = simulate(virtual, [motion], seed=number).trials[0]
    per_period = round(duration * RATE_HZ)
    q = average_periods(trial.q, per_period).mean
    tau = average_periods(trial.tau, per_period).mean
    derivatives = periodic_derivatives(q, RATE_HZ, CUTOFF_HZ)
    settled = lowpass(np.vstack([tau] * 3), RATE_HZ, CUTOFF_HZ, ORDER)[per_period : 2 * per_period]
    return Recorded(time[:per_period], derivatives.value, derivatives.first, derivatives.second, settled)
