"""A load at the last link, from logs without and with it, with intervals that know the gains' own uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import stdtrit

from excite.arrays import Array
from excite.errors import InputError
from excite.identification.load.drive_gains import (
    DriveGains,
    check_mass,
    identify_drive_gains,
    identify_load,
    identify_load_by_calibration,
)
from excite.identification.load.load_runs import load_runs, together
from excite.identification.load.projection import solve_loads
from excite.logs.log import Log
from excite.robot.robot import Robot
from excite.rows.joint_rows import drive_terms
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread

_NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_UNITS = ("kg", *("kg·m",) * 3, *("kg·m²",) * 6)
# Least share of a parameter that has to lie in what the motions excite; what is less is another parameter's as well.
_SEEN = 0.99
_GROWING = "load_friction"


@dataclass(frozen=True, eq=False)
class WeighedLoad:
    """A load about the frame of the last joint.

    Attributes:
        parameters: ``(10,)`` in pinocchio's order [SI].
        half_width_95: ``(10,)`` half the width of their 95 % intervals, by leaving out one stretch of the logs at a
            time (the jackknife), those of the gains included; zero where stated.
        determined: ``(10,)`` whether the motions tell the parameter from all others, and from zero.
        gains: torque per logged torque or current by joint.
        gains_source: where they come from, in words.
        left: by joint, what is left of the torques or currents as share of their deviation.
        drive_terms: what the drives were taken to have.
    """

    parameters: Array
    half_width_95: Array
    determined: Array
    gains: Mapping[str, float]
    gains_source: str
    left: Mapping[str, float]
    drive_terms: tuple[str, ...] = ()

    @property
    def mass(self) -> float:
        """[kg]"""
        return float(self.parameters[0])

    @property
    def center(self) -> Array | None:
        """Centre of mass in the frame of the last joint ``(3,)`` [m]; None where it is not determined."""
        if not self.determined[:4].any() or self.mass <= 0.0 or not self.determined[0]:
            return None
        return np.asarray(self.parameters[1:4] / self.mass)

    def to_json(self) -> dict[str, Any]:
        """A document ``excite.load/1``."""
        rows = zip(_NAMES, _UNITS, self.parameters, self.half_width_95, self.determined, strict=True)
        return {
            "schema": "excite.load/1",
            "parameters": {
                name: {
                    "value": float(value),
                    "half_width_95": float(half),
                    "unit": unit,
                    "determined": bool(told),
                }
                for name, unit, value, half, told in rows
            },
            "center_of_mass": None if self.center is None else self.center.tolist(),
            "gains": dict(self.gains),
            "gains_source": self.gains_source,
            "left": dict(self.left),
            "drive_terms": list(self.drive_terms),
        }

    def summary(self) -> str:
        """Mass, first moments and what is not determined, in lines."""
        lines = []
        for name, unit, value, half, told in zip(
            _NAMES, _UNITS, self.parameters, self.half_width_95, self.determined, strict=True
        ):
            if told and half > 0.0:
                lines.append(f"{name:>4} {value:8.4f} ± {half:.4f} {unit} (95 %)")
            elif told:
                lines.append(f"{name:>4} {value:8.4f} {unit} (stated)")
        lost = [name for name, told in zip(_NAMES, self.determined, strict=True) if not told]
        if lost:
            lines.append(f"these motions do not tell {', '.join(lost)}")
        lines.append(f"gains: {self.gains_source}")
        if _GROWING in self.drive_terms:
            lines.append("friction of the drives grows with the load: the logs ask for it")
        left = ", ".join(f"{name} {100 * value:.1f} %" for name, value in self.left.items())
        return "\n".join([*lines, f"left of the torques: {left}"])


@one_blas_thread
def weigh_load(
    robot: Robot,
    without: Log,
    loaded: Log,
    *,
    mass: float | None = None,
    calibration: tuple[Log, float] | None = None,
    settings: ProblemSettings | None = None,
) -> WeighedLoad:
    """Identify a load from a log without it and one with it.

    Mass and torque scales are only known together. So either the load's ``mass`` is known, and tells the gains and the
    rest of the load; or a ``calibration`` load of known mass tells the gains first; or else the log's torque constants
    are believed.

    Args:
        robot: the robot without load.
        without: log of currents or torques; all its trials are used.
        loaded: the like with the load on the last link, best the same motions.
        mass: of the load [kg], where it was weighed.
        calibration: a log with another load on the last link, and that one's mass [kg].
        settings: filters and drive terms; its drive gains are not used. Where it states no drive terms, they are the
            log's and, if the logs ask for it (:func:`friction_that_grows`), friction that grows with the load, which a
            load would else be taken for in part: without it the UR10e's 2.8 kg are known to 0.17 kg, with it to 0.10.

    Returns:
        The load, with what of it the motions determine.

    Raises:
        InputError: a mass is not positive, or both ways to the gains are given.
        LogError: the logs do not both hold currents, or torques, of the same joints.
    """
    if mass is not None and calibration is not None:
        raise InputError(
            "is stated beside a calibration load", source="load", field="mass", remedy="give one of both"
        )
    known: tuple[Log, float | None, Mapping[str, float] | None] = (loaded, mass, None)
    if calibration is not None:
        known = (*calibration, None)
    elif mass is None:
        known = (loaded, None, _stated_gains(without))
    if known[1] is not None:
        check_mass(known[1])
    settings = friction_that_grows(robot, without, known, settings or ProblemSettings())
    if mass is not None:
        found = identify_drive_gains(robot, without, loaded, mass, settings)
        return _weigh_load(found, f"from the stated mass of {mass:g} kg", settings)
    if calibration is None:
        gains = _stated_gains(without)
        found = identify_load(robot, without, loaded, gains, settings)
        return _weigh_load(found, "as the log states them; what they are off, the load is too", settings)
    found = identify_load_by_calibration(robot, without, calibration, loaded, settings)
    return _weigh_load(found, f"from a calibration load of {calibration[1]:g} kg", settings)


def friction_that_grows(
    robot: Robot,
    without: Log,
    known: tuple[Log, float | None, Mapping[str, float] | None],
    settings: ProblemSettings,
) -> ProblemSettings:
    """The settings, with a friction that grows with the load where the logs ask for it and no terms are stated.

    Asked for is what lowers Schwarz's criterion, of rows that are about independent after decimation: the logarithm of
    what is left of each joint's channel, times its rows, against the added parameters.

    Args:
        robot: the robot without load.
        without: its log.
        known: a log with a load, and the load's mass or the gains, whichever is known.
        settings: filters and drive terms.
    """
    if settings.drive_terms is not None:
        return settings
    stated = drive_terms(without.header, settings)
    found = []
    for terms in (stated, (*stated, _GROWING)):
        tried = replace(settings, drive_terms=terms)
        log, mass, gains = known
        runs = load_runs(robot, without, [log], tried)
        values = None if gains is None else np.array([gains.get(name, 1.0) for name in runs.joints])
        rows = together(runs, range(len(runs.factors)))
        left = np.maximum(solve_loads(rows, [mass], values).residual, 1e-12 * runs.signal)
        cost = float(
            (rows.counts * np.log(left**2)).sum() + len(terms) * len(left) * np.log(rows.counts.sum())
        )
        found.append((cost, tried))
    return min(found, key=lambda one: one[0])[1]


def _weigh_load(found: DriveGains, source: str, settings: ProblemSettings) -> WeighedLoad:
    half = stdtrit(len(found.gains_left_out) - 1, 0.975) * found.load_std
    return WeighedLoad(
        parameters=found.load,
        half_width_95=half,
        determined=(found.load_seen > _SEEN) & (np.abs(found.load) > half),
        gains=found.by_joint,
        gains_source=source,
        left=dict(zip(found.joints, (found.residual / found.signal).tolist(), strict=True)),
        drive_terms=settings.drive_terms or (),
    )


def _stated_gains(log: Log) -> dict[str, float]:
    """Torque constants of a log of currents, ones for a log of torques."""
    if log.header.torque != "current":
        return dict.fromkeys(log.header.torque_joints, 1.0)
    return {
        name: log.header.torque_constants[name]
        for name in log.header.torque_joints
        if name in log.header.torque_constants
    }
