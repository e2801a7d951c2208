"""From a log to an :class:`~excite.identification.result.Identification`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.doctor.examine import examine
from excite.errors import InputError, NoSolutionError, RobotError
from excite.finding import Finding
from excite.identification.attempt import attempt, equations_of, failure_finding
from excite.identification.constraints.com_box import equivalent_boxes
from excite.identification.constraints.mass import measured_total_mass
from excite.identification.estimators.base import Estimate, Estimator, SolveStatus
from excite.identification.estimators.registry import ESTIMATORS, find_estimator
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.judgement.changes import Changes, find_changes
from excite.identification.judgement.consistency import check_consistency
from excite.identification.judgement.doubts import find_doubts
from excite.identification.judgement.essential import essential_parameters
from excite.identification.judgement.statistics import BaseStatistics, base_statistics
from excite.identification.judgement.uncertainty import parameter_uncertainty
from excite.identification.judgement.validation import channel_fits
from excite.identification.judgement.warnings import find_warnings
from excite.identification.noise.correlated import NoiseModel
from excite.identification.problem import IdentificationProblem, build_problem
from excite.identification.regression import Regression, iterate_weights, regression
from excite.identification.result import BaseParameter, Identification, TotalMassReport
from excite.logs.bare_urdf import nominal_faults
from excite.logs.log import Log
from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.columns import DRIVE_TERMS
from excite.robot.robot import Robot
from excite.robot.shapes.com_box import com_boxes
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread

# Once bodies are known to have changed, the others are believed this much more (see _informed_settings).
_UNCHANGED_SHARE = 0.1
_EXPLAINED = 0.9


def identify(
    robot: Robot,
    log: Log,
    method: str = "qp",
    *,
    settings: EstimatorSettings | None = None,
    problem_settings: ProblemSettings | None = None,
) -> Identification:
    """Identify a robot's parameters from a log and judge them on its validation trials.

    Args:
        robot: the robot.
        log: the log; trials of role ``identification`` are used, those of role ``validation`` judge.
        method: registry name of the estimator: ``ls``, ``wls``, ``qp``, ``lmi``.
        settings: settings of the estimator; defaults if None.
        problem_settings: filters, decimation, friction terms; defaults if None.

    Raises:
        UnknownNameError: no such method.
        LogError: the log and the robot do not fit, or leave no rows.
        IllLogError: no check can save the log; with the findings.
        NoSolutionError: the estimator found no parameters that pass its checks; ``best`` is an Identification
            with the best point known, marked by its status and its first finding.
        InputError: the settings state bounds that the method does not keep.
    """
    estimator = find_estimator(method)
    chart = examine(robot, log, problem_settings)
    chart.check_usable()
    log = chart.log
    with equations_of(log):
        problem = build_problem(robot, log, problem_settings, role="identification")
        validation = None
        if log.role("validation"):
            validation = build_problem(robot, log, problem_settings, role="validation")
        odd = (*nominal_faults(robot), *chart.findings)
        try:
            result = identify_problem(problem, validation, estimator, settings or EstimatorSettings())
        except NoSolutionError as error:
            if isinstance(error.best, Identification):
                # A mistake in the log is the likeliest reason.
                error.best = replace(error.best, findings=(*odd, *error.best.findings))
            raise
        return replace(result, findings=(*odd, *result.findings))


@one_blas_thread
def identify_problem(
    problem: IdentificationProblem,
    validation: IdentificationProblem | None,
    estimator: Estimator,
    settings: EstimatorSettings,
) -> Identification:
    """Identify from a problem that has been built; see :func:`identify`."""
    _check_bounds(estimator, settings)
    notes: list[Finding] = []
    if settings.com_boxes is None:
        settings = replace(settings, com_boxes=_boxes(problem.robot, notes))
    weighted = iterate_weights(regression(problem))
    weighted_statistics = base_statistics(weighted)
    changes = find_changes(weighted, weighted_statistics.noise)
    settings = _informed_settings(problem, settings, changes)
    estimate, failure = attempt(estimator, problem, settings, weighted)
    same_weights = np.array_equal(estimate.regression.std, weighted.std)
    statistics = weighted_statistics if same_weights else base_statistics(estimate.regression)
    result = _assemble(problem, validation, estimate, statistics, changes)
    mass = _mass_report(weighted, weighted_statistics.noise, settings, result)
    uncertainty = parameter_uncertainty(problem, statistics, settings.spreads(problem.robot))
    result = replace(result, total_mass=mass, uncertainty=uncertainty)
    if settings.bounds is not None:
        drives = dict(zip(result.drive_names, result.drives.tolist(), strict=True))
        result = replace(result, bounds=settings.bounds.judge(result.links, result.parameters, drives))
    doubts = find_doubts(estimate, statistics, settings.spreads(problem.robot))
    result = replace(result, findings=(*notes, *find_warnings(result), *doubts))
    if failure is not None:
        result = replace(result, findings=(failure_finding(failure), *result.findings))
        raise NoSolutionError(failure.what, best=result, remedy=failure.remedy) from failure
    return result


def _check_bounds(estimator: Estimator, settings: EstimatorSettings) -> None:
    if settings.bounds is not None and not estimator.bounded:
        able = sorted(name for name, kind in ESTIMATORS.items() if kind.bounded)
        raise InputError(
            f"bounds mean nothing to method {estimator.name}",
            source=settings.bounds.source,
            remedy="choose one of " + ", ".join(able),
        )


def _boxes(robot: Robot, notes: list[Finding]) -> np.ndarray:
    """Boxes of the centres of mass from the geometry, else from the nominal inertias."""
    try:
        return com_boxes(robot)
    except RobotError as error:
        text = f"boxes of the centres of mass come from the nominal inertias, not from the geometry: {error}"
        notes.append(Finding("com_boxes", text))
        return equivalent_boxes(robot)


def _informed_settings(
    problem: IdentificationProblem, settings: EstimatorSettings, changes: Changes
) -> EstimatorSettings:
    """Let the bodies that have changed take the change.

    What a joint lets move between neighbours the data do not place; an even pull to the nominal model spreads
    an added body over the whole chain. Where few bodies explain what the nominal model leaves, they get a
    spread that fits their change, the others a tenth of theirs. Spreads that the caller set stay.
    """
    if not changes.segments or changes.explained < _EXPLAINED:
        return settings
    nominal = dict(zip((s.link for s in problem.robot.segments), problem.prior[::10], strict=False))
    spread = dict.fromkeys(nominal, _UNCHANGED_SHARE * settings.prior_spread)
    for item in changes.segments:
        relative = 2.0 * abs(item.mass_change_kg) / max(nominal[item.link], 1e-3)
        spread[item.link] = max(settings.prior_spread, relative)
    return replace(settings, segment_spread={**spread, **settings.segment_spread})


def _assemble(
    problem: IdentificationProblem,
    validation: IdentificationProblem | None,
    estimate: Estimate,
    statistics: BaseStatistics,
    changes: Changes,
) -> Identification:
    n = problem.n_inertial
    robot, parameters = problem.robot, estimate.parameters
    names = tuple(segment.name for segment in robot.segments)
    values = statistics.base.values(parameters)
    essential = essential_parameters(statistics)
    return Identification(
        robot=robot.name,
        method=estimate.method,
        status=estimate.status.value,
        solved=estimate.status is SolveStatus.SOLVED,
        violations=dict(estimate.violations or {}),
        certificate=estimate.certificate,
        n_samples=len(np.unique(np.column_stack([problem.trial, problem.time]), axis=0)),
        links=tuple(segment.link for segment in robot.segments),
        segments=names,
        unmeasured=tuple(robot.segments[k].link for k in problem.unmeasured),
        parameters=parameters[:n].copy(),
        nominal=problem.prior[:n].copy(),
        drive_names=problem.parameter_names[n:],
        drives=parameters[n:].copy(),
        base=_base_parameters(problem, statistics, values, statistics.std, range(len(values))),
        structural_rank=_structural_rank(problem),
        essential=_base_parameters(problem, statistics, essential.values, essential.std, essential.kept),
        consistency=check_consistency(parameters[:n], names),
        fit=channel_fits(problem, parameters, problem.prior),
        validation={} if validation is None else channel_fits(validation, parameters, problem.prior),
        changes=changes,
        total_mass=TotalMassReport(
            float(parameters[:n:10].sum()), float(problem.prior[:n:10].sum()), *[None] * 3
        ),
        findings=(),
    )


def _base_parameters(problem, statistics, values, std, indices) -> tuple[BaseParameter, ...]:
    whole = len(values) == len(statistics.std)
    rsd = statistics.rsd_percent(values) if whole else None
    half = statistics.half_width() if whole else None
    found = []
    for place, index in enumerate(indices):
        column = int(statistics.base.independent[index])
        inertial = column < problem.n_inertial
        size = abs(float(values[place]))
        percent = rsd[place] if rsd is not None else (100.0 * std[place] / size if size > 0.0 else np.inf)
        found.append(
            BaseParameter(
                name=statistics.base.names[column],
                expression=statistics.base.expressions[index],
                link=problem.robot.segments[column // 10].link if inertial else None,
                value=float(values[place]),
                std=float(std[place]),
                rsd_percent=float(percent),
                half_width_95=None if half is None else float(half[place]),
            )
        )
    return tuple(found)


def _structural_rank(problem: IdentificationProblem) -> int | None:
    """Base parameters that free motion would determine; None where rows and robot do not correspond."""
    drives = dict.fromkeys(name.split(".")[0] for name in problem.parameter_names[problem.n_inertial :])
    if problem.robot.floating != (problem.channel_names[0] == "fx") or not drives.keys() <= set(DRIVE_TERMS):
        return None
    if not problem.robot.floating and len(problem.channel_names) < problem.robot.n_joints:
        return None
    return structural_base_parameters(problem.robot, tuple(drives)).rank


def _mass_report(
    rows: Regression, noise: NoiseModel, settings: EstimatorSettings, result: Identification
) -> TotalMassReport:
    measured = measured_total_mass(replace(rows, noise=noise))
    return TotalMassReport(
        identified=float(result.masses.sum()),
        nominal=float(result.nominal[::10].sum()),
        measured=measured.value if measured.identifiable else None,
        measured_std=measured.std if measured.identifiable else None,
        weighed=settings.total_mass,
    )
