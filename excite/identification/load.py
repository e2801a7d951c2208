"""A load at the end effector, and the gains of the drives that a known one gives."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import stdtrit

from excite.arrays import Array
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
    """Triangles of all logs by joint and stretch of time.

    Columns: base parameters' own, ten of each load, the joint's drive, current.

    Attributes:
        joints: names.
        factors: ``(n_blocks, n_joints, w, w)``.
        counts: ``(n_blocks, n_joints)`` rows.
        n_base: number of base columns.
        n_loads: number of logs with a load, each with a load of its own.
        signal: ``(n_joints,)`` standard deviation of the currents or torques.
        unit: of the gains.
    """

    joints: tuple[str, ...]
    factors: Array
    counts: Array
    n_base: int
    n_loads: int
    signal: Array
    unit: str


@dataclass(frozen=True, eq=False)
class Condensed:
    """All stretches together.

    Attributes:
        factors: triangles of the rows of each joint, ``(n_joints, w, w)``.
        counts: rows of each joint, ``(n_joints,)``.
        n_base: number of columns of base parameters.
        n_loads: number of loads.
    """

    factors: Array
    counts: Array
    n_base: int
    n_loads: int


def load_runs(
    robot: Robot, unloaded: Log, loaded: Sequence[Log], settings: ProblemSettings | None
) -> LoadRuns:
    """Rows of logs of the same robot, condensed by joint and stretch of time.

    Args:
        robot: the robot without load.
        unloaded: log of currents or torques; all its trials are used.
        loaded: the like, each with a load of its own on the last link.
        settings: filters and drive terms; its drive gains are not used.

    Raises:
        LogError: the logs do not all hold currents, or torques, of the same joints.
    """
    settings = settings or ProblemSettings()
    for log in loaded:
        if unloaded.header.joints != log.header.joints:
            raise LogError("differ from those of the log without load", source=log.folder, field="joints")
        if unloaded.header.torque_joints != log.header.torque_joints:
            raise LogError("differs from that of the log without load", source=log.folder, field="no_torque")
    ones = dict.fromkeys(unloaded.header.torque_joints, 1.0)
    settings = replace(settings, drive_gains=ones)
    for log in (unloaded, *loaded):
        if log.header.torque != unloaded.header.torque or log.header.torque in {None, "none"}:
            raise LogError(
                "holds no currents and no torques, or others than the first log",
                source=log.folder,
                field="torque",
                remedy="log i.JOINT in all, or tau.JOINT in all",
            )
    problems = [build_problem(robot, log, settings, role=None) for log in (unloaded, *loaded)]
    inertial = problems[0].n_inertial
    rows = np.vstack([square_factor(problem.Y[:, :inertial]) for problem in problems])
    names = problems[0].parameter_names[:inertial]
    own = base_parameters(rows, names, RANK_TOLERANCE).independent
    factors, counts = [], []
    for run, problem in enumerate(problems):
        carried = [run == load for load in range(1, len(problems))]
        for block in _stretches(problem):
            parts = [
                _triangle(problem, block & (problem.channel == c), own, c, carried) for c in range(len(ones))
            ]
            factors.append(np.stack(parts))
            counts.append([int((block & (problem.channel == c)).sum()) for c in range(len(ones))])
    currents = np.concatenate([problem.y for problem in problems])
    channel = np.concatenate([problem.channel for problem in problems])
    # A joint that never moves has no rows.
    signal = np.array(
        [np.std(currents[channel == c]) if (channel == c).any() else 1.0 for c in range(len(ones))]
    )
    unit = "N·m/A" if unloaded.header.torque == "current" else "(true per logged torque)"
    return LoadRuns(tuple(ones), np.stack(factors), np.array(counts), len(own), len(loaded), signal, unit)


def _stretches(problem: IdentificationProblem) -> list[NDArray[np.bool_]]:
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


def _triangle(
    problem: IdentificationProblem,
    rows: NDArray[np.bool_],
    own: NDArray[np.int64],
    joint: int,
    carried: Sequence[bool],
) -> Array:
    """Triangle of one joint's rows; drives of other joints have nothing there, nor have loads not ``carried``."""
    inertial = problem.n_inertial
    drives = [
        inertial + i
        for i, name in enumerate(problem.parameter_names[inertial:])
        if name.split(".")[1] == problem.channel_names[joint]
    ]
    body = problem.Y[rows, :inertial]
    loads = [body[:, inertial - 10 :] * float(here) for here in carried]
    return square_factor(np.column_stack([body[:, own], *loads, problem.Y[rows][:, drives], problem.y[rows]]))


def together(runs: LoadRuns, blocks: Iterable[int]) -> Condensed:
    """Some of the stretches of the logs as one."""
    chosen = list(blocks)
    n_joints = len(runs.joints)
    factors = [square_factor(np.vstack(list(runs.factors[chosen, c]))) for c in range(n_joints)]
    return Condensed(np.stack(factors), runs.counts[chosen].sum(axis=0), runs.n_base, runs.n_loads)


# Torque per ampere of every joint from the same robot with and without a load of known mass.
#
# Logged torques whose scale is not trusted are treated alike: their gains have no unit and are near one.
#
# Motor currents alone give a robot's parameters up to the drives' gains. A load whose mass is known makes the
# gains of all joints that carry it known too (Gautier and Briot, 2014); its centre of mass and inertia are
# found on the way. Noise is in the currents, so these are what is predicted: dividing the equation by the
# gain keeps the least-squares estimate free of the attenuation that currents in the regressor bring.


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
    return _with_spread(runs, [None], _gains_of(runs, gains))


def _gains_of(runs: LoadRuns, gains: Mapping[str, float] | None) -> Array | None:
    """Gains in the order of the joints; raises LogError where one is missing."""
    if gains is None:
        return None
    missing = [name for name in runs.joints if name not in gains]
    if missing:
        raise LogError("has no gain", field=f"drive_gains.{missing[0]}", remedy="state N·m/A")
    return np.array([gains[name] for name in runs.joints])


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
    condensed: Condensed, masses: Sequence[float | None], gains: Array | None, start: Array | None = None
) -> LoadSolution:
    """Least squares on the currents; gains are searched, all else is linear given them (variable projection).

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


def _without_drives(condensed: Condensed) -> Condensed:
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
    return Condensed(np.stack(kept), condensed.counts, condensed.n_base, condensed.n_loads)


@dataclass(frozen=True, eq=False)
class _Linear:
    """Solution for given gains: what it leaves, the loads, the scaled columns of what was free, what of loads was."""

    rest: Array
    loads: Array
    columns: Array
    free: NDArray[np.bool_]

    def seen(self) -> Array:
        """As of :class:`LoadSolution`; the search asks for a hundred solutions, and this of the last."""
        shares = np.ones(self.free.shape)
        shares[self.free] = _seen_share(self.columns, int(self.free.sum()))
        return shares


def _linear_solution(
    condensed: Condensed, inverse: Array, std: Array, masses: Sequence[float | None]
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


def _seen_share(matrix: Array, count: int) -> Array:
    """Share of each of the first columns' parameters that lies in the row space, ``(count,)``."""
    _, size, rows = np.linalg.svd(square_factor(matrix), full_matrices=False)
    return np.asarray((rows[size > RANK_TOLERANCE * size[0], :count] ** 2).sum(axis=0))


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
        gains: torque per logged torque or current by joint.
        gains_source: where they come from, in words.
        left: by joint, what is left of the torques or currents as share of their deviation.
        drive_terms: what the drives were taken to have.
    """

    parameters: Array
    half_width_95: Array
    seen: NDArray[np.bool_]
    determined: NDArray[np.bool_]
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
        if not self.determined[0] or self.mass <= 0.0:
            return None
        return np.asarray(self.parameters[1:4] / self.mass)

    def to_json(self) -> dict[str, Any]:
        """A document ``excite.load/1``."""
        rows = zip(PARAMETERS, _UNITS, self.parameters, self.half_width_95, self.determined, strict=True)
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
            PARAMETERS, _UNITS, self.parameters, self.half_width_95, self.determined, strict=True
        ):
            if told and half > 0.0:
                lines.append(f"{name:>4} {value:8.4f} ± {half:.4f} {unit} (95 %)")
            elif told:
                lines.append(f"{name:>4} {value:8.4f} {unit} (stated)")
        lost = [name for name, told in zip(PARAMETERS, self.determined, strict=True) if not told]
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
    logs, masses, gains = [loaded], [mass], None
    source = f"from the stated mass of {mass or 0.0:g} kg"
    if calibration is not None:
        # Gains, both loads and the bare robot are fitted to all three logs at once: what the second load's motions say
        # of the gains, and the calibration's of the robot, counts too.
        logs, masses = [calibration[0], loaded], [calibration[1], None]
        source = f"from a calibration load of {calibration[1]:g} kg"
    elif mass is None:
        gains = _stated_gains(without)
        source = "as the log states them; what they are off, the load is too"
    if masses[0] is not None:
        check_mass(masses[0])
    settings = friction_that_grows(robot, without, logs[0], masses[0], gains, settings or ProblemSettings())
    runs = load_runs(robot, without, logs, settings)
    return _weigh_load(_with_spread(runs, masses, _gains_of(runs, gains)), source, settings)


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
        robot: the robot without load.
        without: its log.
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
        rows = together(runs, range(len(runs.factors)))
        found_there = solve_loads(rows, [mass], _gains_of(runs, gains))
        left = np.maximum(found_there.residual, 1e-12 * runs.signal)
        cost = float(
            (rows.counts * np.log(left**2)).sum() + len(terms) * len(left) * np.log(rows.counts.sum())
        )
        found.append((cost, tried))
    return min(found, key=lambda one: one[0])[1]


def _weigh_load(found: DriveGains, source: str, settings: ProblemSettings) -> WeighedLoad:
    half = stdtrit(len(found.gains_left_out) - 1, 0.975) * found.load_std
    seen = found.load_seen > _SEEN
    return WeighedLoad(
        parameters=found.load,
        half_width_95=half,
        seen=seen,
        determined=seen & (np.abs(found.load) > half),
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
