"""The same robot without and with loads, condensed to what the search for drive gains needs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import LogError
from excite.identification.problem import IdentificationProblem, build_problem
from excite.identification.regression import RANK_TOLERANCE, square_factor
from excite.logs.log import Log
from excite.regressor.base_parameters import base_parameters
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings

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
