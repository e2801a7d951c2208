"""What an identification hands to the report: curves of a validation trial, masses."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from excite.arrays import Array, Moved
from excite.doctor.examine import examine
from excite.documents.document import read_document
from excite.documents.truth import Truth
from excite.errors import LogError
from excite.identification.adaptation import with_terms_of
from excite.identification.preparation import prepare_trial
from excite.identification.problem import IdentificationProblem, build_problem
from excite.identification.result import Identification
from excite.identification.rollout import HORIZON_S, model_departures
from excite.logs.columns import BASE_POSE
from excite.logs.log import Log, LogHeader, Trial
from excite.report.comparisons import NORMAL_95, ForceComparison, MassComparison, PathComparison
from excite.report.data import ReportData, save_report_data
from excite.robot.robot import Robot
from excite.rows.kinematics import trial_kinematics
from excite.rows.settings import ProblemSettings

# Rate at which models are run along a trial [Hz].
_PATH_HZ = 200.0


def save_findings(
    robot: Robot,
    identification: Identification,
    log: Log,
    folder: Path,
    settings: ProblemSettings | None = None,
) -> Path:
    """Write ``report_data.npz`` of an identification: forces of a validation trial, masses, the trial in motion.

    Args:
        robot: the robot.
        identification: what was identified from ``log`` with ``settings``.
        log: the log.
        folder: folder to write to.
        settings: of the problem; defaults if None.

    Returns:
        The file.
    """
    data = findings_of(robot, identification, log, settings)
    return save_report_data(data, Path(folder) / "report_data.npz")


def findings_of(
    robot: Robot,
    identification: Identification,
    log: Log,
    settings: ProblemSettings | None = None,
    truth: Path | None = None,
) -> ReportData:
    """What a page shows of an identification: forces of a validation trial, masses, the trial in motion.

    Args:
        robot: the robot.
        identification: what was identified from ``log`` with ``settings``.
        log: the log.
        settings: of the problem; defaults if None.
        truth: ``truth.json`` of a virtual robot, where there may be one.
    """
    shown = _shown_trial(robot, identification, log, settings)
    return ReportData(
        forces=None if shown is None else _compare_forces(identification, shown),
        masses=mass_comparison(robot, identification, truth),
        path=None if shown is None else _compare_paths(identification, shown),
    )


def force_comparison(
    robot: Robot, identification: Identification, log: Log, settings: ProblemSettings | None = None
) -> ForceComparison | None:
    """Measured, nominal and identified curves of the validation trial that moves most; None without one.

    Filtered as for identification, but at the log's own rate: rows that identification thins out to some ten
    a second would draw corners.
    """
    shown = _shown_trial(robot, identification, log, settings)
    return None if shown is None else _compare_forces(identification, shown)


class _Shown(NamedTuple):
    """The trial that is shown, the log's header, and settings and rows at the log's own rate."""

    trial: Trial
    header: LogHeader
    settings: ProblemSettings
    problem: IdentificationProblem


def _shown_trial(
    robot: Robot, identification: Identification, log: Log, settings: ProblemSettings | None
) -> _Shown | None:
    """The validation trial that moves most."""
    if not log.role("validation"):
        return None
    settings = settings or ProblemSettings()
    if any(finding.repaired or finding.kind == "constant" for finding in identification.findings):
        # As it was identified from: the doctor turns signs and clocks, and takes a torque that never changes for none.
        log = examine(robot, log, settings).log
    trials = log.role("validation")
    settings = with_terms_of(identification.identified, log, settings)
    coarse = build_problem(robot, log, settings, role="validation")
    spread = [float(np.std(coarse.y[coarse.trial == i])) for i in range(len(coarse.trial_names))]
    trial = trials[int(np.argmax(spread))]
    fine = replace(settings, rate_hz=log.header.rate_hz)
    problem = build_problem(robot, replace(log, trials=(trial,)), fine, role="validation")
    problem = problem.with_drives(identification.identified.drive_names)
    return _Shown(trial, log.header, fine, problem)


def _compare_forces(identification: Identification, shown: _Shown) -> ForceComparison:
    problem = shown.problem
    time = np.unique(problem.time)
    # A joint that stands throughout the trial, or whose torque was not believed, has no rows in it.
    there = [channel for channel in range(len(problem.channel_names)) if (problem.channel == channel).any()]

    def curves(values: Array) -> Array:
        """One column a channel that has rows; these can leave out instants that others have."""
        columns = []
        for channel in there:
            rows = problem.channel == channel
            order = np.argsort(problem.time[rows], kind="stable")
            columns.append(np.interp(time, problem.time[rows][order], values[rows][order]))
        return np.column_stack(columns)

    return ForceComparison(
        trial=problem.trial_names[0],
        channels=tuple(problem.channel_names[channel] for channel in there),
        units=tuple(problem.channel_units[channel] for channel in there),
        time=time,
        measured=curves(problem.y),
        nominal=curves(problem.Y @ problem.prior),
        identified=curves(problem.Y @ identification.identified.all),
    )


def _compare_paths(identification: Identification, shown: _Shown) -> PathComparison | None:
    """The same trial as it moved, and as both models move it; None where they cannot be told to."""
    problem, robot, filters = shown.problem, shown.problem.robot, shown.problem.filters
    joints = tuple(shown.header.joints)
    if filters is None or not set(joints) <= set(robot.joint_names):
        return None
    trial = prepare_trial(shown.trial, shown.settings, filters).trial
    k = trial_kinematics(robot, shown.header, trial, shown.settings, filters)
    every = slice(None, None, max(1, int(k.rate_hz / _PATH_HZ)))
    time, record = k.time[every], Moved(k.q[every], k.v[every], k.a[every])
    moved = []
    for parameters in (problem.prior, identification.identified.all):
        departed = model_departures(problem, parameters, time, record)
        if departed is None:
            return None
        q = np.array([pin.integrate(robot.model, *pair) for pair in zip(record.q, departed, strict=True)])
        moved.append(_logged_columns(robot, joints, q))
    return PathComparison(
        trial=trial.name,
        joints=(*BASE_POSE, *joints) if robot.floating else joints,
        time=time,
        measured=_logged_columns(robot, joints, record.q),
        nominal=moved[0],
        identified=moved[1],
        horizon_s=HORIZON_S,
    )


def _logged_columns(robot: Robot, joints: tuple[str, ...], q: Array) -> Array:
    """Columns of the base's pose, if it is free, and of the logged joints."""
    columns = [robot.n_base_q + robot.joint_index(joint) for joint in joints]
    return q[:, [*range(robot.n_base_q), *columns]]


def mass_comparison(robot: Robot, identification: Identification, truth: Path | None) -> MassComparison:
    """Masses of all segments; the true ones where ``truth.json`` of a virtual robot is there."""
    changed = {item.link for item in identification.changes.segments} - identification.impossible_changes
    known = identification.statistics.uncertainty
    masses = slice(0, 10 * len(identification.masses), 10)
    return MassComparison(
        names=identification.identified.segments,
        nominal=identification.nominal[::10].copy(),
        identified=identification.masses,
        true=true_masses(robot, truth) if truth is not None and os.path.lexists(truth) else None,
        changed=np.array([link in changed for link in identification.links]),
        half_width=None if known is None else NORMAL_95 * known.std[masses],
        determined=None if known is None else known.determined[masses].copy(),
    )


def true_masses(robot: Robot, path: Path) -> Array:
    """Masses of a virtual robot, ``(n_segments,)`` [kg]; raises LogError."""
    remedy = "simulate the motions again"
    masses = read_document(path, Truth, remedy=remedy, error=LogError).masses
    for segment in robot.segments:
        if segment.link not in masses:
            raise LogError(f"has no {segment.link!r}", source=path, field="masses", remedy=remedy)
    return np.array([masses[segment.link] for segment in robot.segments])
