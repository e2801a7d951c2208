"""What a campaign has found."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.campaign.experiment import Truth
from excite.doctor.examine import examine
from excite.documents.campaign import Miss, Reason
from excite.documents.document import read_document
from excite.errors import LogError
from excite.excitation.conditioning import UnexcitedParameter
from excite.identification.adaptation import with_terms_of
from excite.identification.judgement import PATIENCE
from excite.identification.parameter_statistics import BaseParameter
from excite.identification.problem import IdentificationProblem, build_problem
from excite.identification.result import Identification
from excite.logs.log import Log
from excite.report.comparisons import (
    NORMAL_95,
    ForceComparison,
    MassComparison,
    ReportData,
    save_report_data,
)
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings

# Which base parameters are certain enough, which are not, and why.

# Deviations of averages fall with so much of a power of the number of samples.
_SQUARE_ROOT = 0.5


@dataclass(frozen=True)
class Earlier:
    """What an earlier iteration found.

    Attributes:
        seconds: motion that identification had after it [s].
        rsd_percent: by essential base parameter.
    """

    seconds: float
    rsd_percent: Mapping[str, float]


def missed_targets(
    robot: Robot,
    essential: Sequence[BaseParameter],
    unexcited: Sequence[UnexcitedParameter],
    target_rsd: float,
    *,
    seconds: float = 0.0,
    earlier: Sequence[Earlier] = (),
) -> tuple[Miss, ...]:
    """The parameters that are not certain enough.

    Only essential parameters have to reach the target (Xu et al. 2020, end of section II.A: a parameter whose
    contribution cannot be told from zero is no part of the model). Standard deviations fall with the square
    root of the amount of motion, so that ``(rsd / target)²`` times the motion would be needed; past ten times
    the miss is put down to noise. Where earlier iterations saw the parameter and it fell more slowly than that
    (``seconds^−p`` with p < ½), ``(rsd / target)^(1/p)`` times are needed, and past ten times it stalls. Of 11
    campaigns of five iterations, UR10 and Panda, target 6 %, none of the 15 misses so called was met by the end,
    with up to five times the motion; of the 78 others 18 were. (Parameters were counted at each iteration, and the
    same campaigns had led to the rule.)

    Args:
        robot: the robot.
        essential: estimates of the essential parameters.
        unexcited: structural base parameters that the motions do not excite at all.
        target_rsd: relative standard deviation to reach [percent].
        seconds: motion that identification had [s].
        earlier: iterations before this one, in order.
    """
    found = []
    for estimate in essential:
        if estimate.rsd_percent <= target_rsd:
            continue
        short = estimate.rsd_percent / target_rsd
        if short > PATIENCE**_SQUARE_ROOT:
            reason = Reason.NOISE
        elif short > PATIENCE ** _deviation_exponent(estimate.name, estimate.rsd_percent, seconds, earlier):
            reason = Reason.STALLED
        else:
            reason = Reason.MORE_MOTION
        found.append(Miss(estimate.name, estimate.rsd_percent, reason, _joints_moving(robot, estimate.name)))
    found += [
        Miss(item.label, None, Reason.NOT_EXCITED, _joints_moving(robot, item.label)) for item in unexcited
    ]
    return tuple(found)


def _deviation_exponent(
    parameter: str, rsd_percent: float, seconds: float, earlier: Sequence[Earlier]
) -> float:
    """The power of motion with which a parameter's deviation fell since it was first seen; at most ½, at least 0."""
    first = next((one for one in earlier if one.rsd_percent.get(parameter, 0.0) > 0.0), None)
    if first is None or not seconds > first.seconds > 0.0:
        return _SQUARE_ROOT
    fell = math.log(first.rsd_percent[parameter] / rsd_percent) / math.log(seconds / first.seconds)
    return min(max(fell, 0.0), _SQUARE_ROOT)


def joints_to_aim_at(robot: Robot, missed: Sequence[Miss]) -> tuple[str, ...]:
    """Joints whose motion helps the parameters that more motion can help, in the robot's order."""
    wanted = {joint for miss in missed if miss.reason.helped_by_motion for joint in miss.joints}
    return tuple(joint for joint in robot.joint_names if joint in wanted)


def _joints_moving(robot: Robot, parameter: str) -> tuple[str, ...]:
    """Joints that move the body of a parameter ``Izz(SEGMENT)``: its own and the one before; or a drive's."""
    inside = parameter.partition("(")[2].rstrip(")")
    if inside in robot.joint_names:
        return (inside,)
    for segment in robot.segments:
        if inside in (segment.name, segment.link):
            names = robot.model.names
            own, before = segment.joint, robot.model.parents[segment.joint]
            return tuple(names[joint] for joint in (own, before) if names[joint] in robot.joint_names)
    return ()


# What an identification hands to the report: curves of a validation trial, masses.

# Rate at which models are run along a trial [Hz].


def save_findings(
    robot: Robot,
    identification: Identification,
    log: Log,
    folder: Path,
    settings: ProblemSettings | None = None,
) -> Path:
    """Write ``report_data.npz`` of an identification: forces of a validation trial, masses.

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
    """What a page shows of an identification: forces of a validation trial, masses.

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
    )


def _shown_trial(
    robot: Robot, identification: Identification, log: Log, settings: ProblemSettings | None
) -> IdentificationProblem | None:
    """Rows of the validation trial that moves most.

    Filtered as for identification, but at the log's own rate: rows that identification thins out to some ten a second
    would draw corners.
    """
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
    return problem.with_drives(identification.identified.drive_names)


def _compare_forces(identification: Identification, problem: IdentificationProblem) -> ForceComparison:
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


def mass_comparison(robot: Robot, identification: Identification, truth: Path | None) -> MassComparison:
    """Masses of all segments; the true ones where ``truth.json`` of a virtual robot is there."""
    changed = {item.link for item in identification.changes.segments} - identification.impossible_changes
    known = identification.uncertainty
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
