"""The same robot without and with a load, condensed to what the search for drive gains needs."""

from __future__ import annotations

from collections.abc import Iterable
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
class LoadPair:
    """Triangles of both logs by joint and stretch of time.

    Columns: base parameters' own, ten of the load, the joint's drive, current.

    Attributes:
        joints: names.
        factors: ``(n_blocks, n_joints, w, w)``.
        counts: ``(n_blocks, n_joints)`` rows.
        n_unloaded: number of blocks of the log without load, which come first.
        n_base: number of base columns.
        signal: ``(n_joints,)`` standard deviation of the currents or torques.
        unit: of the gains.
    """

    joints: tuple[str, ...]
    factors: Array
    counts: Array
    n_unloaded: int
    n_base: int
    signal: Array
    unit: str


@dataclass(frozen=True, eq=False)
class Condensed:
    """All stretches together.

    Attributes:
        factors: triangles of the rows of each joint, ``(n_joints, w, w)``.
        counts: rows of each joint, ``(n_joints,)``.
        n_base: number of columns of base parameters.
    """

    factors: Array
    counts: Array
    n_base: int


def load_pair(robot: Robot, unloaded: Log, loaded: Log, settings: ProblemSettings | None) -> LoadPair:
    """Rows of two logs of the same robot, condensed by joint and stretch of time.

    Args:
        robot: the robot without load.
        unloaded: log of currents or torques; all its trials are used.
        loaded: the like with the load on the last link.
        settings: filters and drive terms; its drive gains are not used.

    Raises:
        LogError: the logs do not both hold currents, or torques, of the same joints.
    """
    settings = settings or ProblemSettings()
    if unloaded.header.joints != loaded.header.joints:
        raise LogError("differ between the two logs", source=loaded.folder, field="joints")
    if unloaded.header.torque_joints != loaded.header.torque_joints:
        raise LogError("differs between the two logs", source=loaded.folder, field="no_torque")
    ones = dict.fromkeys(unloaded.header.torque_joints, 1.0)
    settings = replace(settings, drive_gains=ones)
    for log in (unloaded, loaded):
        if log.header.torque != unloaded.header.torque or log.header.torque in {None, "none"}:
            raise LogError(
                "holds no currents and no torques, or others than the first log",
                source=log.folder,
                field="torque",
                remedy="log i.JOINT in both, or tau.JOINT in both",
            )
    problems = [build_problem(robot, log, settings, role=None) for log in (unloaded, loaded)]
    inertial = problems[0].n_inertial
    rows = np.vstack([square_factor(problem.Y[:, :inertial]) for problem in problems])
    names = problems[0].parameter_names[:inertial]
    own = base_parameters(rows, names, RANK_TOLERANCE).independent
    factors, counts = [], []
    n_unloaded = 0
    for problem, carries in zip(problems, (False, True), strict=True):
        for block in _stretches(problem):
            parts = [
                _triangle(problem, block & (problem.channel == c), own, c, carries) for c in range(len(ones))
            ]
            factors.append(np.stack(parts))
            counts.append([int((block & (problem.channel == c)).sum()) for c in range(len(ones))])
            n_unloaded += not carries
    currents = np.concatenate([problem.y for problem in problems])
    channel = np.concatenate([problem.channel for problem in problems])
    # A joint that never moves has no rows.
    signal = np.array(
        [np.std(currents[channel == c]) if (channel == c).any() else 1.0 for c in range(len(ones))]
    )
    unit = "N·m/A" if unloaded.header.torque == "current" else "(true per logged torque)"
    return LoadPair(tuple(ones), np.stack(factors), np.array(counts), n_unloaded, len(own), signal, unit)


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
    problem: IdentificationProblem, rows: NDArray[np.bool_], own: NDArray[np.int64], joint: int, carries: bool
) -> Array:
    """Triangle of one joint's rows; drives of other joints have nothing there."""
    inertial = problem.n_inertial
    drives = [
        inertial + i
        for i, name in enumerate(problem.parameter_names[inertial:])
        if name.split(".")[1] == problem.channel_names[joint]
    ]
    body = problem.Y[rows, :inertial]
    last = body[:, inertial - 10 :] if carries else np.zeros((len(body), 10))
    return square_factor(np.column_stack([body[:, own], last, problem.Y[rows][:, drives], problem.y[rows]]))


def together(pair: LoadPair, blocks: Iterable[int]) -> Condensed:
    """Some of the stretches of a pair as one."""
    chosen = list(blocks)
    n_joints = len(pair.joints)
    factors = [square_factor(np.vstack(list(pair.factors[chosen, c]))) for c in range(n_joints)]
    return Condensed(np.stack(factors), pair.counts[chosen].sum(axis=0), pair.n_base)
