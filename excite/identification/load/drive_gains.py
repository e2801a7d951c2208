"""Torque per ampere of every joint from the same robot with and without a load of known mass.

Logged torques whose scale is not trusted are treated alike: their gains have no unit and are near one.

Motor currents alone give a robot's parameters up to the drives' gains. A load whose mass is known makes the
gains of all joints that carry it known too (Gautier and Briot, 2014); its centre of mass and inertia are found
on the way. Noise is in the currents, so these are what is predicted: dividing the equation by the gain keeps
the least-squares estimate free of the attenuation that currents in the regressor bring.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.errors import InputError, LogError
from excite.identification.load.load_runs import LoadRuns, load_runs, together
from excite.identification.load.projection import LoadSolution, solve_loads
from excite.logs.log import Log
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread


@dataclass(frozen=True, eq=False)
class DriveGains:
    """Drive gains and the load that they were found with.

    Attributes:
        joints: names of the joints.
        gains: ``(n_joints,)`` torque per ampere [N·m/A or N/A], or true torque per logged torque [1].
        gains_std: ``(n_joints,)`` standard deviations, from leaving out one stretch of the logs at a time.
        load: ``(10,)`` the load's parameters about the last joint's frame, pinocchio's order [SI].
        load_std: ``(10,)`` standard deviations; zero where known.
        load_seen: ``(10,)`` share of each that the motions let be told from all else, 1 for all of it.
        gains_left_out: ``(n_stretches, n_joints)`` the gains with one stretch of the logs left out after the other.
        residual: ``(n_joints,)`` root mean square of what is left of the currents [A], or torques.
        signal: ``(n_joints,)`` standard deviation of the currents [A], or torques.
        unit: of the gains.
    """

    joints: tuple[str, ...]
    gains: Array
    gains_std: Array
    load: Array
    load_std: Array
    load_seen: Array
    gains_left_out: Array
    residual: Array
    signal: Array
    unit: str = "N·m/A"

    @property
    def by_joint(self) -> dict[str, float]:
        """As ``drive_gains`` of the problem settings takes them."""
        return dict(zip(self.joints, self.gains.tolist(), strict=True))

    def summary(self) -> str:
        """A line for each joint and one for the load."""
        rows = zip(self.joints, self.gains, self.gains_std, self.residual / self.signal, strict=True)
        lines = []
        for name, gain, std, left in rows:
            said = f"{gain:.3f} ± {std:.3f} {self.unit}" if std < gain else "not determined by this load"
            lines.append(f"{name}: {said}, {100 * left:.1f} % left")
        return "\n".join([*lines, f"load: {self.load[0]:.3f} ± {self.load_std[0]:.3f} kg"])


@one_blas_thread
def identify_drive_gains(
    robot: Robot, unloaded: Log, loaded: Log, load_mass: float, settings: ProblemSettings | None = None
) -> DriveGains:
    """Drive gains from a log without and one with a load on the last link, of known mass.

    Args:
        robot: the robot without load.
        unloaded: log of currents or torques; all its trials are used.
        loaded: the like with the load, joints in the same order, best the same motions.
        load_mass: [kg].
        settings: filters and drive terms; its drive gains are not used.

    Returns:
        A gain for each joint, with its standard deviation.

    Raises:
        InputError: the mass is not positive.
        LogError: the logs do not both hold currents, or torques, the joints differ, or a joint does not feel the load.
    """
    check_mass(load_mass)
    return _with_spread(load_runs(robot, unloaded, [loaded], settings), [load_mass], None)


@one_blas_thread
def identify_load(
    robot: Robot,
    unloaded: Log,
    loaded: Log,
    gains: Mapping[str, float],
    settings: ProblemSettings | None = None,
) -> DriveGains:
    """A load of unknown mass from the same two logs, the gains being known.

    Args:
        robot: the robot.
        unloaded: a log of the bare robot.
        loaded: a log of the same motions with the load.
        gains: by joint, torque per unit of the logged channel.
        settings: how rows are made of a log.

    Returns:
        The load on the last link, with the gains that were given.

    Raises:
        LogError: as of :func:`identify_drive_gains`, or a joint's gain is missing.
    """
    runs = load_runs(robot, unloaded, [loaded], settings)
    missing = [name for name in runs.joints if name not in gains]
    if missing:
        raise LogError("has no gain", field=f"drive_gains.{missing[0]}", remedy="state N·m/A")
    return _with_spread(runs, [None], np.array([gains[name] for name in runs.joints]))


@one_blas_thread
def identify_load_by_calibration(
    robot: Robot,
    unloaded: Log,
    calibration: tuple[Log, float],
    loaded: Log,
    settings: ProblemSettings | None = None,
) -> DriveGains:
    """A load of unknown mass, the gains from a third log with a load of known mass.

    Gains, both loads and the bare robot are fitted to all three logs at once: what the second load's motions say of the
    gains, and the calibration's of the robot, counts too.

    Args:
        robot: the robot without load.
        unloaded: log of currents or torques.
        calibration: a log with another load on the last link, and that one's mass [kg].
        loaded: the log with the load in question.
        settings: filters and drive terms; its drive gains are not used.

    Returns:
        The load.

    Raises:
        InputError: the mass is not positive.
        LogError: as of :func:`identify_drive_gains`.
    """
    known, mass = calibration
    check_mass(mass)
    return _with_spread(load_runs(robot, unloaded, [known, loaded], settings), [mass, None], None)


def check_mass(mass: float) -> None:
    """Raise InputError for a mass that no load has."""
    if not 0.0 < mass < np.inf:
        raise InputError(f"is {mass!r}", source="load", field="mass", remedy="weigh it [kg]")


def _with_spread(runs: LoadRuns, masses: Sequence[float | None], gains: Array | None) -> DriveGains:
    """The last load, with standard deviations by leaving out one stretch at a time (the jackknife)."""
    n = len(runs.factors)

    def solved(left: int | None = None, start: Array | None = None) -> LoadSolution:
        kept = [k for k in range(n) if k != left]
        return solve_loads(together(runs, kept), masses, gains, start)

    whole = solved()
    rest = [solved(left, whole.gains) for left in range(n)]
    left_out = np.array([item.gains for item in rest])
    return DriveGains(
        joints=runs.joints,
        gains=whole.gains,
        gains_std=jackknife_std(left_out),
        load=whole.loads[-1],
        load_std=jackknife_std(np.array([item.loads[-1] for item in rest])),
        load_seen=whole.seen[-1],
        gains_left_out=left_out,
        residual=whole.residual,
        signal=runs.signal,
        unit=runs.unit,
    )


def jackknife_std(values: Array) -> Array:
    """Standard deviations of ``(n_left_out, k)`` estimates that each leave out one part of the data, ``(k,)``."""
    n = len(values)
    return np.asarray(np.sqrt((n - 1) / n * ((values - values.mean(axis=0)) ** 2).sum(axis=0)))
