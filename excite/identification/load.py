"""A load at the end effector, and the gains of the drives that a known one gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit

from excite.arrays import Array, Flags, Indices, jackknife_std
from excite.conversion.torques import torque_gains
from excite.doctor.thresholds import THRESHOLD, is_near_one
from excite.errors import InputError, LogError
from excite.identification.problem import IdentificationProblem, build_problem
from excite.identification.regression import RANK_TOLERANCE, minimum_norm, square_factor
from excite.logs.log import Log
from excite.regressor.base_parameters import base_parameters
from excite.regressor.columns import PARAMETERS
from excite.robot.robot import Robot
from excite.rows.joint_rows import drive_terms
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread

# The same robot without and with loads, condensed to what the search for drive gains needs.

_BLOCKS = 8


@dataclass(frozen=True, eq=False)
class LoadRuns:
    """Triangles of all logs by joint, of each stretch of time or of several together.

    Columns: base parameters' own, ten of each load, the joint's drive, current.

    Attributes:
        joints: names.
        factors: ``(n_blocks, n_joints, w, w)``, or ``(n_joints, w, w)``.
        counts: ``(n_blocks, n_joints)`` rows, or ``(n_joints,)``.
        n_base: number of base columns.
        n_loads: number of logs with a load, each with a load of its own.
        signal: ``(n_joints,)`` standard deviation of the currents or torques.
    """

    joints: tuple[str, ...]
    factors: Array
    counts: Array
    n_base: int
    n_loads: int
    signal: Array

    def together(self, left_out: int | None = None) -> LoadRuns:
        """The stretches of the logs as one, maybe without one of them."""
        kept = [k for k in range(len(self.factors)) if k != left_out]
        factors = [square_factor(np.vstack(list(parts))) for parts in self.factors[kept].swapaxes(0, 1)]
        return replace(self, factors=np.stack(factors), counts=self.counts[kept].sum(axis=0))


def load_runs(
    robot: Robot, unloaded: Log, loaded: Sequence[Log], settings: ProblemSettings | None
) -> LoadRuns:
    """Rows of logs of the same robot, condensed by joint and stretch of time.

    Args:
        unloaded: log of currents or torques; all its trials are used.
        loaded: the like, each with a load of its own on the last link.
        settings: filters and drive terms; its drive gains are not used.

    Raises:
        LogError: the logs do not all hold currents, or torques, of the same joints.
    """
    header, logs = unloaded.header, (unloaded, *loaded)
    for log in loaded:
        for name, place in (("joints", "joints"), ("torque_joints", "no_torque")):
            if getattr(log.header, name) != getattr(header, name):
                raise LogError("differs from that of the log without load", source=log.folder, field=place)
    for log in logs:
        if log.header.torque != header.torque or log.header.torque in {None, "none"}:
            raise LogError(
                "holds no currents and no torques, or others than the first log",
                source=log.folder,
                field="torque",
                remedy="log i.JOINT in all, or tau.JOINT in all",
            )
    joints = header.torque_joints
    settings = replace(settings or ProblemSettings(), drive_gains=dict.fromkeys(joints, 1.0))
    problems = [build_problem(robot, log, settings, role=None) for log in logs]
    inertial = problems[0].n_inertial
    rows = np.vstack([square_factor(problem.Y[:, :inertial]) for problem in problems])
    own = base_parameters(rows, problems[0].parameter_names[:inertial], RANK_TOLERANCE).independent
    factors, counts = [], []
    for run, problem in enumerate(problems):
        carried = [run == load for load in range(1, len(problems))]
        for block in _cut_stretches(problem):
            masks = [block & (problem.channel == c) for c in range(len(joints))]
            factors.append([_joint_triangle(problem, mask, own, c, carried) for c, mask in enumerate(masks)])
            counts.append([int(mask.sum()) for mask in masks])
    currents = np.concatenate([problem.y for problem in problems])
    channel = np.concatenate([problem.channel for problem in problems])
    # A joint that never moves has no rows.
    signal = [np.std(currents[channel == c]) if (channel == c).any() else 1.0 for c in range(len(joints))]
    return LoadRuns(joints, np.array(factors), np.array(counts), len(own), len(loaded), np.array(signal))


def _cut_stretches(problem: IdentificationProblem) -> list[Flags]:
    """Rows cut into stretches of time, trial by trial."""
    n = max(1, _BLOCKS // len(problem.trial_names))
    masks = []
    for trial in range(len(problem.trial_names)):
        inside = problem.trial == trial
        time = problem.time[inside]
        edges = np.linspace(time.min(), time.max(), n + 1)[1:-1]
        part = np.searchsorted(edges, problem.time, side="right")
        masks += [inside & (part == k) for k in range(n)]
    return masks


def _joint_triangle(
    problem: IdentificationProblem, rows: Flags, own: Indices, joint: int, carried: Sequence[bool]
) -> Array:
    """Triangle of one joint's rows; drives of other joints have nothing there, nor have loads not ``carried``."""
    n, joint_name = problem.n_inertial, problem.channel_names[joint]
    names = problem.parameter_names[n:]
    drives = [n + i for i, name in enumerate(names) if name.split(".")[1] == joint_name]
    matrix = problem.Y[rows]
    loads = [matrix[:, n - 10 : n] * float(here) for here in carried]
    return square_factor(np.column_stack([matrix[:, own], *loads, matrix[:, drives], problem.y[rows]]))


def _gains_of(runs: LoadRuns, gains: Mapping[str, float] | None) -> Array | None:
    """Gains in the order of the joints; raises LogError where one is missing."""
    if gains is None:
        return None
    missing = [name for name in runs.joints if name not in gains]
    if missing:
        raise LogError("has no gain", field=f"drive_gains.{missing[0]}", remedy="state N·m/A")
    return np.array([gains[name] for name in runs.joints])


_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class LoadSolution:
    """Gains and loads of some rows.

    Attributes:
        gains: ``(n_joints,)`` torque per current, or per logged torque.
        loads: ``(n_loads, 10)`` about the last joint's frame, pinocchio's order [SI].
        seen: ``(n_loads, 10)`` share of each that the rows let be told from all else.
        residual: ``(n_joints,)`` root mean square of what is left.
    """

    gains: Array
    loads: Array
    seen: Array
    residual: Array


def solve_loads(
    condensed: LoadRuns, masses: Sequence[float | None], gains: Array | None, start: Array | None = None
) -> LoadSolution:
    """Least squares on the currents; gains are searched, all else is linear given them (variable projection).

    Currents alone give a robot's parameters up to the drives' gains. A load of known mass makes the gains of all joints
    that carry it known, too (Gautier and Briot, 2014). Noise is in the currents, so these are what is predicted:
    dividing the equation by the gain keeps the estimate free of the attenuation that currents in the regressor bring.
    Logged torques whose scale is not trusted are treated alike.

    Args:
        condensed: rows without and with the loads.
        masses: of the loads [kg], None where one is to be found.
        gains: ``(n_joints,)``, None where they are to be found, which one load's mass allows.
        start: ``(n_joints,)`` gains to begin the search at.
    """
    n = len(condensed.factors)
    judged = _without_drives(condensed)
    std = np.ones(n)
    inverse = np.full(n, 0.1) if gains is None else 1.0 / gains
    if gains is None and start is not None:
        inverse = 1.0 / start
    for _ in range(_ROUNDS):
        if gains is None:
            # Gains are positive and of any size: search their logarithms.
            found = least_squares(
                lambda x, std=std: _linear_solution(judged, np.exp(x), std, masses).rest, np.log(inverse)
            )
            inverse = np.exp(found.x)
        inner = _linear_solution(condensed, inverse, std, masses)
        left = inner.rest.reshape(n, -1) * std[:, None]
        rms = np.sqrt((left**2).sum(axis=1) / np.maximum(condensed.counts, 1))
        std = np.maximum(rms, 1e-6 * rms.max())
    return LoadSolution(1.0 / inverse, inner.loads, inner.seen(), rms)


def _without_drives(condensed: LoadRuns) -> LoadRuns:
    """The rows without what each joint's drive explains, whatever gains and loads are.

    A drive's columns stand in its own joint's rows alone, and no gain scales them: they are projected out once, and the
    search is left with base parameters and loads.
    """
    factors, drives = condensed.factors, condensed.n_base + 10 * condensed.n_loads
    kept = []
    for rows in factors:
        columns, rest = rows[:, drives:-1], np.delete(rows, np.s_[drives:-1], axis=1)
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        space, size, _ = np.linalg.svd(columns / scale, full_matrices=False)
        space = space[:, size > RANK_TOLERANCE * max(1.0, *size)]
        kept.append(square_factor(rest - space @ (space.T @ rest)))
    return replace(condensed, factors=np.stack(kept))


@dataclass(frozen=True, eq=False)
class _Linear:
    """Solution for given gains: what it leaves, the loads, the scaled columns of what was free, what of loads was."""

    rest: Array
    loads: Array
    columns: Array
    free: Flags

    def seen(self) -> Array:
        """As of :class:`LoadSolution`; the search asks for a hundred solutions, and this of the last."""
        shares = np.ones(self.free.shape)
        _, size, rows = np.linalg.svd(square_factor(self.columns), full_matrices=False)
        seen = rows[size > RANK_TOLERANCE * size[0], : int(self.free.sum())]
        shares[self.free] = (seen**2).sum(axis=0)
        return shares


def _linear_solution(
    condensed: LoadRuns, inverse: Array, std: Array, masses: Sequence[float | None]
) -> _Linear:
    """Base parameters, loads and drives for given ``1/gain``; what is left, weighted, ``(n_joints·w,)``."""
    factors, base, loads = condensed.factors, condensed.n_base, 10 * condensed.n_loads
    n, width, _ = factors.shape
    n_drive = width - 1 - base - loads
    # Loads first: their masses are known or not; then base parameters; then each joint's drive by itself.
    matrix = np.zeros((n * width, loads + base + n * n_drive))
    target = np.zeros(n * width)
    for c in range(n):
        rows = slice(c * width, (c + 1) * width)
        r = factors[c] / std[c]
        matrix[rows, :loads] = inverse[c] * r[:, base : base + loads]
        matrix[rows, loads : loads + base] = inverse[c] * r[:, :base]
        start = loads + base + c * n_drive
        matrix[rows, start : start + n_drive] = r[:, base + loads : -1]
        target[rows] = r[:, -1]
    found = np.zeros((condensed.n_loads, 10))
    free = np.ones(found.shape, dtype=bool)
    for k, mass in enumerate(masses):
        if mass is not None:
            found[k, 0], free[k, 0] = mass, False
            target = target - mass * matrix[:, 10 * k]
    columns = matrix[:, np.concatenate([free.ravel(), np.ones(matrix.shape[1] - loads, dtype=bool)])]
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    solution = minimum_norm(columns / scale, target) / scale
    found[free] = solution[: free.sum()]
    return _Linear(target - columns @ solution, found, columns / scale, free)


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
        seen: ``(10,)`` whether the motions tell the parameter from all others.
        determined: ``(10,)`` whether they tell it from zero, too.
        gains: torque per current by joint [N·m/A or N/A], or true torque per logged torque [1].
        gains_std: their standard deviations, by leaving out one stretch of the logs at a time.
        gains_source: where they come from, in words.
        left: by joint, what is left of the torques or currents as share of their deviation.
        drive_terms: what the drives were taken to have.
    """

    parameters: Array
    half_width_95: Array
    seen: Flags
    determined: Flags
    gains: Mapping[str, float]
    gains_source: str
    left: Mapping[str, float]
    drive_terms: tuple[str, ...] = ()
    gains_std: Mapping[str, float] = field(default_factory=dict)

    @property
    def mass(self) -> float:
        """[kg]"""
        return float(self.parameters[0])

    @property
    def center(self) -> Array | None:
        """Centre of mass in the frame of the last joint ``(3,)`` [m]; None where it is not determined."""
        if not self.determined[0] or self.mass <= 0.0:
            return None
        return np.asarray(self.parameters[1:4] / self.mass)

    def _list_parameters(self) -> list[tuple[Any, ...]]:
        """Name, unit, value, half the interval's width of each parameter, and whether it is determined."""
        values = (self.parameters, self.half_width_95, self.determined)
        return list(zip(PARAMETERS, _UNITS, *(one.tolist() for one in values), strict=True))

    def to_json(self) -> dict[str, Any]:
        """A document ``excite.load/1``."""
        keys = ("unit", "value", "half_width_95", "determined")
        return {
            "schema": "excite.load/1",
            "parameters": {name: dict(zip(keys, row, strict=True)) for name, *row in self._list_parameters()},
            "center_of_mass": None if self.center is None else self.center.tolist(),
            "gains": dict(self.gains),
            "gains_std": dict(self.gains_std),
            "gains_source": self.gains_source,
            "left": dict(self.left),
            "drive_terms": list(self.drive_terms),
        }

    def summary(self) -> str:
        """Mass, first moments and what is not determined, in lines."""
        lines = [
            f"{name:>4} {value:8.4f} " + (f"± {half:.4f} {unit} (95 %)" if half > 0.0 else f"{unit} (stated)")
            for name, unit, value, half, told in self._list_parameters()
            if told
        ]
        lost = [name for name, *_, told in self._list_parameters() if not told]
        lines += [f"these motions do not tell {', '.join(lost)}"] if lost else []
        least, most = min(self.gains.values()), max(self.gains.values())
        lines.append(f"gains: {self.gains_source}; {least:.3g} to {most:.3g} per logged unit")
        grows = "friction of the drives grows with the load: the logs ask for it"
        lines += [grows] if _GROWING in self.drive_terms else []
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
    gains: Mapping[str, float] | None = None,
    settings: ProblemSettings | None = None,
) -> WeighedLoad:
    """Identify a load from a log without it and one with it.

    Mass and torque scales are only known together. So either the load's ``mass`` is known, and tells the gains and the
    rest of the load; or a ``calibration`` load of known mass tells the gains first; or else stated ``gains``, or the
    log's torque constants, are believed.

    Args:
        robot: the robot without load.
        without: log of currents or torques; all its trials are used.
        loaded: the like with the load on the last link, best the same motions.
        mass: of the load [kg], where it was weighed.
        calibration: a log with another load on the last link, and that one's mass [kg].
        gains: torque per unit of the logged channel by joint, where neither of these is given.
        settings: filters and drive terms; its drive gains are not used. Where it states no drive terms, they are the
            log's and, if the logs ask for it (:func:`friction_that_grows`), friction that grows with the load, which a
            load would else be taken for in part: without it the UR10e's 2.8 kg are known to 0.17 kg, with it to 0.10.

    Returns:
        The load, with what of it the motions determine.

    Raises:
        InputError: a mass is not positive, or makes the bare robot far heavier or lighter than its model, or both ways
            to the gains are given.
        LogError: the logs do not both hold currents, or torques, of the same joints.
    """
    if mass is not None and calibration is not None:
        raise InputError(
            "is stated beside a calibration load", source="load", field="mass", remedy="give one of both"
        )
    logs, masses = [loaded], [mass]
    source = f"from the stated mass of {mass or 0.0:g} kg"
    if calibration is not None:
        # Gains, both loads and the bare robot are fitted to all three logs at once: what the second load's motions say
        # of the gains, and the calibration's of the robot, counts too.
        logs, masses = [calibration[0], loaded], [calibration[1], None]
        source = f"from a calibration load of {calibration[1]:g} kg"
    elif mass is None:
        source = "as stated; what they are off, the load is too"
        if gains is None:
            gains, source = (
                _stated_gains(without),
                "as the log states them; what they are off, the load is too",
            )
    known = masses[0]
    if known is not None:
        gains = None
        if not 0.0 < known < np.inf:
            raise InputError(f"is {known!r}", source="load", field="mass", remedy="weigh it [kg]")
    settings = friction_that_grows(robot, without, logs[0], known, gains, settings or ProblemSettings())
    runs = load_runs(robot, without, logs, settings)
    fixed = _gains_of(runs, gains)
    whole = solve_loads(runs.together(), masses, fixed)
    if known is not None:
        _check_mass(known, dict(zip(runs.joints, whole.gains, strict=True)), robot, without)
    # Standard deviations by leaving out one stretch at a time (the jackknife).
    rest = [solve_loads(runs.together(k), masses, fixed, whole.gains) for k in range(len(runs.factors))]
    load, gain = whole.loads[-1], np.array([item.gains for item in rest])
    std = jackknife_std(np.array([item.loads[-1] for item in rest]))
    half, seen = stdtrit(len(rest) - 1, 0.975) * std, whole.seen[-1] > _SEEN
    half[0] *= masses[-1] is None
    by_joint = (whole.gains, jackknife_std(gain), whole.residual / runs.signal)
    found = [dict(zip(runs.joints, values.tolist(), strict=True)) for values in by_joint]
    return WeighedLoad(
        parameters=load,
        half_width_95=half,
        seen=seen,
        determined=seen & (np.abs(load) > half),
        gains=found[0],
        gains_std=found[1],
        gains_source=source,
        left=found[2],
        drive_terms=settings.drive_terms or (),
    )


def _check_mass(mass: float, gains: Mapping[str, float], robot: Robot, without: Log) -> None:
    """Refuse a load's mass whose gains make the bare robot far heavier or lighter than its model."""
    stated, logged = _stated_gains(without), torque_gains(robot, without)
    factors = [one.gain * gains[name] / stated.get(name, 1.0) for name, one in logged.items()]
    factor = float(np.median(factors)) if factors else 1.0
    if not is_near_one(factor, THRESHOLD.scales_far):
        what = f"is {mass:g} kg, which makes the bare robot weigh {factor:.3g} times what its model does"
        remedy = "weigh it [kg], or give the model of the robot that was recorded"
        raise InputError(what, source="load", field="mass", remedy=remedy)


def friction_that_grows(
    robot: Robot,
    without: Log,
    loaded: Log,
    mass: float | None,
    gains: Mapping[str, float] | None,
    settings: ProblemSettings,
) -> ProblemSettings:
    """The settings, with a friction that grows with the load where the logs ask for it and no terms are stated.

    Asked for is what lowers Schwarz's criterion, of rows that are about independent after decimation: the logarithm of
    what is left of each joint's channel, times its rows, against the added parameters.

    Args:
        loaded: a log with a load.
        mass: of the load [kg], where the gains are not known.
        gains: by joint, where the mass is not known.
        settings: filters and drive terms.
    """
    if settings.drive_terms is not None:
        return settings
    stated = drive_terms(without.header, settings)
    found = []
    for terms in (stated, (*stated, _GROWING)):
        tried = replace(settings, drive_terms=terms)
        runs = load_runs(robot, without, [loaded], tried)
        rows = runs.together()
        found_there = solve_loads(rows, [mass], _gains_of(runs, gains))
        left = np.maximum(found_there.residual, 1e-12 * runs.signal)
        cost = float(
            (rows.counts * np.log(left**2)).sum() + len(terms) * len(left) * np.log(rows.counts.sum())
        )
        found.append((cost, tried))
    return min(found, key=lambda one: one[0])[1]


def _stated_gains(log: Log) -> dict[str, float]:
    """Torque constants of a log of currents, ones for a log of torques."""
    if log.header.torque != "current":
        return dict.fromkeys(log.header.torque_joints, 1.0)
    return {
        name: log.header.torque_constants[name]
        for name in log.header.torque_joints
        if name in log.header.torque_constants
    }
