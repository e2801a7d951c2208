"""From a log to an :class:`~excite.identification.result.Identification`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.linalg import LinAlgError

from excite.arrays import Array
from excite.doctor.examine import examine
from excite.errors import LogError, NoSolutionError
from excite.finding import Finding
from excite.identification.adaptation import (
    Adaptation,
    Candidates,
    adapt_problem,
    adaptation_finding,
    beats_nominal,
    drives_finding,
    list_candidates,
    predicts_better,
    with_shown_drives,
    without_terms,
)
from excite.identification.changed_segments import Changes, find_changes
from excite.identification.estimators.conic import Adaptive, AdaptiveSettings
from excite.identification.estimators.estimator import (
    Estimate,
    Estimator,
    SolveStatus,
    estimate_at,
    no_solution,
)
from excite.identification.estimators.method_settings import own_settings
from excite.identification.estimators.registry import DEFAULT_METHOD, find_estimator
from excite.identification.estimators.settings import (
    BoxSettings,
    EstimatorSettings,
    StatedBoundsSettings,
    share_limits,
)
from excite.identification.identified_parameters import identified_parameters
from excite.identification.judgement import channel_fits, check_consistency, mass_report
from excite.identification.parameter_statistics import (
    base_parameter_table,
    essential_parameter_table,
    parameter_uncertainty,
    structural_rank,
)
from excite.identification.physical.default_bounds import derived_boxes
from excite.identification.problem import IdentificationProblem, build_problem
from excite.identification.regression import Regression, condense_problem, iterate_weights, log_evidence
from excite.identification.result import Identification, find_doubts, find_warnings
from excite.identification.statistics import base_statistics
from excite.logs.files import load_log
from excite.logs.log import Log
from excite.logs.robot import nominal_faults
from excite.progress import Progress, silent, step, told_to
from excite.robot.load import RobotLike, as_robot
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread

# Once bodies are known to have changed, the others are believed this much more (see _informed_settings).
_UNCHANGED_SHARE = 0.1
_NONE = Candidates()


def identify(
    robot: RobotLike,
    log: str | Path | Log,
    method: str = DEFAULT_METHOD,
    *,
    settings: EstimatorSettings | None = None,
    problem_settings: ProblemSettings | None = None,
    progress: Progress = silent,
) -> Identification:
    """Identify a robot's parameters from a log and judge them on its validation trials.

    Methods, by what they give (:func:`~excite.identification.estimators.registry.method_summaries` says when to take
    which): bodies that can exist, as near to the nominal ones as the log supports, ``adaptive``; base parameters from
    the data alone ``ls``, ``wls``; parameters near the nominal model
    ``map``, ``qp``, ``hqp``; parameters within bounds ``cls1``, ``cls2``; parameters of bodies that can exist
    ``cls3``, ``lmi``, ``physical``.

    Args:
        robot: the robot, or what :func:`~excite.robot.load.load_robot` takes.
        log: a log folder, or a log in memory; trials of role ``identification`` are used, those of role
            ``validation`` judge.
        method: registry name of the estimator.
        settings: settings of the estimator, from
            :func:`~excite.identification.estimators.method_settings.estimator_settings`; defaults if None.
        problem_settings: filters, decimation, friction terms; defaults if None.
        progress: told at each step.

    Returns:
        Parameters about the joints' frames [SI], how well they are known, and what they are worth.

    Raises:
        UnknownNameError: no such method.
        LogError: the log and the robot do not fit, or leave no rows.
        IllLogError: no check can save the log; with the findings.
        NoSolutionError: the estimator found no parameters that pass its checks; ``best`` is an Identification
            with the best point known, marked by its status and its first finding.
        InputError: a setting that the method does not know.
    """
    robot = as_robot(robot)
    if not isinstance(log, Log):
        log = load_log(log, robot)
    estimator = find_estimator(method)
    own = own_settings(estimator, settings)
    with told_to(progress):
        chart = examine(robot, log, problem_settings)
        chart.check_usable()
        log, asked = chart.log, Candidates()
        with equations_of(log):
            if isinstance(own, AdaptiveSettings):
                problem_settings, asked = list_candidates(log, problem_settings, own)
            problem = build_problem(robot, log, problem_settings, role="identification")
            validation = None
            if log.role("validation"):
                validation = build_problem(robot, log, problem_settings, role="validation")
            # A mistake in the log is the likeliest reason for whatever else is found, so it is said first.
            odd = (*nominal_faults(robot), *chart.findings)
            return identify_problem(problem, validation, estimator, own, odd, asked)


@one_blas_thread
@step("estimate and judge")
def identify_problem(
    problem: IdentificationProblem,
    validation: IdentificationProblem | None,
    estimator: Estimator[Any],
    settings: EstimatorSettings | None = None,
    known: Sequence[Finding] = (),
    asked: Candidates = _NONE,
) -> Identification:
    """Identify from a problem that has been built.

    Args:
        problem: the rows to identify from.
        validation: rows to judge by, None where there are none.
        settings: its settings; defaults if None.
        known: what was found of the log already, which comes before all other findings.
        asked: terms with columns in both problems that an adaptive method may leave out.

    Raises:
        NoSolutionError: see :func:`identify`.
        InputError: a setting that the estimator does not know.
    """
    robot = problem.robot
    settings = own_settings(estimator, settings)
    boxes, notes = _find_com_boxes(robot, settings)
    if isinstance(settings, BoxSettings):
        settings = replace(settings, com_boxes=boxes)
    names, whole = problem.parameter_names[problem.n_inertial :], problem
    if isinstance(settings, AdaptiveSettings):
        problem = with_shown_drives(problem, asked, settings)
        validation = None if validation is None else validation.with_drives(problem.parameter_names)
    addable = asked.by_blocks
    # What is known of rigid bodies and friction is stated without the terms that only an adaptive method adds.
    plain = without_terms(problem, addable)
    weighted = iterate_weights(condense_problem(plain))
    weighted_statistics = base_statistics(weighted)
    too_few = _too_few_instants(plain, weighted_statistics.base.rank)
    changes = guess = Changes((), 0.0, 1.0)
    wrenches = plain.channel_names[0] == "fx"
    if not too_few:
        changes = find_changes(weighted, weighted_statistics.noise, asked=without_terms(whole, addable))
        # A guess for the estimate, which blocks and evidence judge: that bodies have taken all of the change.
        guess = find_changes(weighted, weighted_statistics.noise, bodies_alone=True)
    informed = _informed_settings(robot, settings, guess)
    adaptation = Adaptation((), 1.0, 1.0)
    if informed != settings and wrenches:
        settings = informed if predicts_better(plain, weighted, settings, informed) else settings
    elif isinstance(settings, AdaptiveSettings) and not wrenches:
        tried = [
            settings,
            *(one for one in (informed,) if isinstance(one, AdaptiveSettings) and one != settings),
        ]
        adaptation, settings = adapt_problem(problem, weighted, tried, Adaptive(), addable)
    else:
        settings = max(settings, informed, key=lambda one: log_evidence(weighted, one.spreads(robot)))
    left_out = [term for term in addable if term not in adaptation.terms]
    problem = without_terms(problem, left_out)
    validation = None if validation is None else without_terms(validation, left_out)
    keeps_nominal = bool(too_few) and (
        isinstance(settings, AdaptiveSettings) or not beats_nominal(plain, weighted, estimator, settings)
    )
    if keeps_nominal:
        kept = estimate_at(estimator.name, weighted, problem.prior.copy(), SolveStatus.SOLVED)
        estimate, failure = replace(kept, distance=0.0), None
    else:
        estimate, failure = attempt_estimate(
            estimator, problem, settings, condense_problem(problem) if adaptation.terms else weighted
        )
    identified = identified_parameters(problem, estimate.parameters)
    if adaptation.terms:
        estimate = replace(estimate, parameters=estimate.parameters[: plain.n_params], regression=weighted)
    same_weights = np.array_equal(estimate.regression.std, weighted.std)
    statistics = weighted_statistics if same_weights else base_statistics(estimate.regression)
    spreads, parameters = settings.spreads(robot), identified.all
    doubts = find_doubts(estimate, statistics, spreads)
    if adaptation.terms:
        # Plain least squares knows nothing of the added terms, so that it differs says no more than they do.
        doubts = tuple(item for item in doubts if item.kind != "conflict")
    bounds = settings.bounds if isinstance(settings, StatedBoundsSettings) else None
    instants = np.column_stack([estimate.regression.problem.trial, estimate.regression.problem.time])
    result = Identification(
        robot=robot.name,
        method=estimate.method,
        status=estimate.status.value,
        solved=estimate.status is SolveStatus.SOLVED,
        n_samples=len(np.unique(instants, axis=0)),
        violations=dict(estimate.violations or {}),
        certificate=estimate.certificate,
        held_mass=estimate.total_mass,
        identified=identified,
        base=base_parameter_table(plain, statistics, estimate.parameters),
        structural_rank=structural_rank(plain, statistics.base.rank),
        essential=essential_parameter_table(plain, statistics),
        uncertainty=parameter_uncertainty(plain, statistics, spreads),
        consistency=check_consistency(identified.inertial, identified.segments),
        fit=channel_fits(problem, parameters, problem.prior),
        validation={} if validation is None else channel_fits(validation, parameters, problem.prior),
        changes=changes,
        total_mass=mass_report(weighted, weighted_statistics.noise, settings, identified),
        bounds=None
        if bounds is None
        else bounds.judge(identified.links, identified.inertial, identified.by_drive()),
    )
    # What a reader of the parameters has to know first.
    said = f"{failure and failure.what}: these parameters are only the best that is known, do not use them"
    failed = () if failure is None else (Finding("no_solution", said),)
    findings = (
        *known,
        *failed,
        *too_few,
        *notes,
        *drives_finding(asked, names, identified),
        *adaptation_finding(adaptation, identified),
        *find_warnings(result),
        *doubts,
    )
    result = replace(result, findings=findings)
    if failure is not None:
        raise NoSolutionError(failure.what, best=result, remedy=failure.remedy) from failure
    return result


def _too_few_instants(problem: IdentificationProblem, rank: int) -> tuple[Finding, ...]:
    """A finding where contact wrenches were used at fewer instants than there are base parameters.

    Each of the six channels alone could then be fitted exactly, whatever its noise, which nothing tells: neither
    changes of bodies nor parameters better than the nominal ones follow.
    """
    instants = int(np.bincount(problem.channel).max())
    if problem.channel_names[0] != "fx" or instants >= rank:
        return ()
    text = (
        f"{instants} instants for {rank} base parameters: each channel could be fitted exactly, so that nothing tells "
        "noise from bodies; no changed segment is looked for, and the nominal bodies are kept unless a chosen method "
        "predicts stretches left out better than they do: record longer and more varied motions"
    )
    return (Finding("too_few_instants", text, {"instants": float(instants), "base_parameters": float(rank)}),)


def _find_com_boxes(robot: Robot, settings: EstimatorSettings) -> tuple[Array, tuple[Finding, ...]]:
    """Boxes of the centres of mass that are stated, else from the geometry, else from the nominal inertias."""
    if isinstance(settings, BoxSettings) and settings.com_boxes is not None:
        return settings.com_boxes, ()
    boxes, error = derived_boxes(robot)
    text = f"boxes of the centres of mass come from the nominal inertias, not from the geometry: {error}"
    return boxes, () if error is None else (Finding("com_boxes", text),)


def _informed_settings(robot: Robot, settings: EstimatorSettings, changes: Changes) -> EstimatorSettings:
    """Settings that let the bodies that have changed take the change.

    What a joint lets move between neighbours the data do not place; an even pull to the nominal model spreads
    an added body over the whole chain. The bodies that have changed get a spread that fits their change, the others
    a tenth of theirs; spreads that the caller set stay. Whether that is right the rows say: people, whose segments all
    differ from the tables', and arms whose torques hold what no body explains are more probable without.
    """
    if not changes.segments:
        return settings
    masses = robot.nominal_parameters[::10].tolist()
    nominal = dict(zip((s.link for s in robot.segments), masses, strict=True))
    spread = dict.fromkeys(nominal, _UNCHANGED_SHARE * settings.prior_spread)
    for item in changes.segments:
        relative = 2.0 * abs(item.mass_change_kg) / max(nominal[item.link], 1e-3)
        spread[item.link] = max(settings.prior_spread, relative)
    least, most = share_limits(settings, "segment_spread")
    spread = {link: float(np.clip(value, least, most)) for link, value in spread.items()}
    return replace(settings, segment_spread={**spread, **settings.segment_spread})


def attempt_estimate(
    estimator: Estimator[Any], problem: IdentificationProblem, settings: EstimatorSettings, rows: Regression
) -> tuple[Estimate, NoSolutionError | None]:
    """Estimate; a failure comes with the best point known, the nominal model where there is no other.

    Args:
        rows: the rows condensed and weighted, for the residual of the nominal model.

    Returns:
        The estimate, and None or the error of its solver.
    """
    try:
        return estimator.estimate(problem, settings), None
    except NoSolutionError as error:
        failure = error
    except LinAlgError as error:
        nominal = estimate_at(estimator.name, rows, problem.prior.copy(), SolveStatus.NOT_FINITE)
        failure = no_solution(SolveStatus.NOT_FINITE, nominal)
        failure.__cause__ = error
    if isinstance(failure.best, Estimate):
        return failure.best, failure
    return estimate_at(estimator.name, rows, problem.prior.copy(), SolveStatus.INFEASIBLE), failure


@contextmanager
def equations_of(log: Log) -> Iterator[None]:
    """Say of a log whose equations cannot be solved, not even by the nominal model's side, what is likely wrong.

    Numbers of sixteen digits cannot hold channels that are further apart than any two of one robot.

    Raises:
        LogError: what is done in the block raised LinAlgError.
    """
    try:
        yield
    except LinAlgError as error:
        raise LogError(
            f"its equations cannot be solved ({' '.join(str(error).split())})",
            source=log.folder,
            remedy="a channel is in another unit or all noise: see `excite diagnose`, or plot the torques",
        ) from error
