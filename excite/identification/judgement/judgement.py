"""What the parameters are worth: bodies that can exist, predictions, changes, total mass, stated bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import eigh

from excite.arrays import Array
from excite.display import percent
from excite.finding import Finding, list_names
from excite.identification.changed_segments import Changes
from excite.identification.constraints.linear import measured_total_mass
from excite.identification.estimators.estimator import Estimate
from excite.identification.estimators.registry import ESTIMATORS
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.inertia import central_inertia_matrices, inertia_matrices, pseudo_inertia_matrices
from excite.identification.noise import NoiseModel
from excite.identification.parameter_statistics import ParameterStatistics
from excite.identification.physical.bounds import BoundsReport, KnownBounds
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, prior_std
from excite.identification.statistics import BaseStatistics
from excite.logs.columns import WRENCH_AXES
from excite.results import ADDED, Name, Stated, Unbounded, UnboundedPositive, plain

# Whether identified parameters are those of bodies that can exist.

_ROUNDING = 1e-9


@dataclass(frozen=True)
class Consistency(Stated):
    """Physical consistency of a set of segments, recomputed from the parameters themselves.

    Attributes:
        mass_positive: every mass is positive.
        inertia_positive_definite: every inertia about its joint frame's origin is positive definite.
        triangle_inequality: the principal inertias about every centre of mass obey the triangle inequality.
        pseudo_inertia_min_eigenvalue: least eigenvalue of all pseudo-inertias (units mixed: kg, kg·m, kg·m²).
        inconsistent: names of the segments whose pseudo-inertia is not positive semidefinite.
    """

    mass_positive: bool = field(metadata=ADDED)
    inertia_positive_definite: bool = field(metadata=ADDED)
    triangle_inequality: bool = field(metadata=ADDED)
    pseudo_inertia_min_eigenvalue: Unbounded = field(metadata=ADDED)
    inconsistent: tuple[Name, ...] = ()


def check_consistency(parameters: Array, names: tuple[str, ...]) -> Consistency:
    """Check the mass, inertia and pseudo-inertia of every segment.

    Args:
        parameters: ``(10·n_segments,)``, pinocchio's order, joint frames [SI].
        names: names of the segments.

    Returns:
        The verdicts; a segment with moments and no mass has no centre of mass and fails the triangle
        inequality; one with neither is no body.
    """
    # Links between the axes of one joint have neither mass nor moments: there is no body to judge.
    ten = np.asarray(parameters, dtype=float).reshape(-1, 10)
    there = np.asarray(ten.any(axis=1))
    if not there.all() and there.any():
        return check_consistency(
            ten[there].ravel(), tuple(name for name, is_body in zip(names, there, strict=True) if is_body)
        )
    masses = ten[:, 0]
    inertia = np.linalg.eigvalsh(inertia_matrices(parameters))
    central = central_inertia_matrices(parameters)
    known = np.isfinite(central).all(axis=(1, 2))
    principal = np.full((len(masses), 3), np.nan)
    principal[known] = np.linalg.eigvalsh(central[known])
    slack = principal[:, 0] + principal[:, 1] - principal[:, 2]
    pseudo = np.linalg.eigvalsh(pseudo_inertia_matrices(parameters))
    # Rounding is relative to the body: a hand's inertia is a millionth of a trunk's.
    bad = pseudo[:, 0] < -_ROUNDING * np.abs(pseudo).max(axis=1)
    return Consistency(
        mass_positive=bool((masses > 0.0).all()),
        inertia_positive_definite=bool((inertia[:, 0] > 0.0).all()),
        triangle_inequality=bool(known.all() and (slack >= -_ROUNDING * principal[:, 2]).all()),
        pseudo_inertia_min_eigenvalue=float(pseudo[:, 0].min()),
        inconsistent=tuple(name for name, flag in zip(names, bad, strict=True) if flag),
    )


# How well parameters reproduce what was measured, channel by channel.


@dataclass(frozen=True)
class ChannelFit(Stated):
    """Agreement of one channel, as in Table II of Jovic et al. (Humanoids 2015).

    Attributes:
        unit: unit of the root mean square errors, N or N·m.
        rmse: root mean square of measured minus predicted by the identified parameters.
        cc: Pearson's correlation of measured and predicted; None where one of them is constant.
        reference_rmse: the same for the nominal parameters.
        reference_cc: the same for the nominal parameters.
        std: standard deviation of the measured channel.
    """

    unit: Name = field(metadata=ADDED)
    rmse: UnboundedPositive
    cc: float | None
    reference_rmse: UnboundedPositive = field(metadata=ADDED)
    reference_cc: float | None = field(metadata=ADDED)
    std: UnboundedPositive = field(metadata=ADDED)


def channel_fits(
    problem: IdentificationProblem, parameters: Array, reference: Array
) -> dict[str, ChannelFit]:
    """Compare identified and reference parameters on every channel of a problem.

    Args:
        problem: rows of the trials to judge by.
        parameters: identified parameters ``(n_params,)``.
        reference: parameters to compare with ``(n_params,)``, usually the nominal ones.

    Returns:
        By channel name, in the problem's order; a channel without rows is left out.
    """
    predicted, nominal = problem.Y @ parameters, problem.Y @ reference
    fits = {}
    for name, unit in zip(problem.channel_names, problem.channel_units, strict=True):
        rows = problem.rows_of(name)
        if not rows.any():
            continue
        measured = problem.y[rows]
        fits[name] = channel_fit(unit, measured, predicted[rows], nominal[rows])
    return fits


def channel_fit(unit: str, measured: Array, predicted: Array, nominal: Array) -> ChannelFit:
    """Agreement of a measured signal ``(n,)`` with what two models predict."""
    return ChannelFit(
        unit=unit,
        rmse=_rms(measured - predicted),
        cc=correlation(measured, predicted),
        reference_rmse=_rms(measured - nominal),
        reference_cc=correlation(measured, nominal),
        std=float(measured.std()),
    )


def correlation(a: Array, b: Array) -> float | None:
    """Pearson's correlation coefficient of two signals ``(n,)``, None where one of them does not vary."""
    da, db = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((da @ da) * (db @ db)))
    floor = 1e-12 * len(a) * max(float(np.abs(a).max()), 1e-30) * max(float(np.abs(b).max()), 1e-30)
    return None if scale <= floor else float(np.clip(da @ db / scale, -1.0, 1.0))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True)
class TotalMassReport(Stated):
    """Total mass as it was known from several sides [kg]; None where a side says nothing.

    Attributes:
        identified: sum of the identified masses.
        nominal: sum of the model's masses.
        measured: what the measured forces say.
        measured_std: its standard deviation.
        weighed: what the scale said.
        of_torques: whether joints' torques measure it, in place of wrenches.
    """

    identified: Unbounded
    nominal: Unbounded
    measured: Unbounded | None
    measured_std: UnboundedPositive | None
    weighed: float | None
    of_torques: bool = False


@dataclass(frozen=True, eq=False)
class Judgement:
    """What the parameters are worth.

    Attributes:
        consistency: physical consistency of the inertial parameters.
        fit: by channel, on the identification trials.
        validation: by channel, on the validation trials; empty where there are none.
        changes: segments that are not what the model says.
        total_mass: the total mass from all sides.
        bounds: stated bounds against the parameters, None where none were stated.
    """

    consistency: Consistency
    fit: dict[str, ChannelFit]
    validation: dict[str, ChannelFit]
    changes: Changes
    total_mass: TotalMassReport
    bounds: BoundsReport | None = None

    def to_json(self) -> dict[str, Any]:
        """Its blocks of the document."""
        return {
            "bounds": plain(self.bounds),
            "consistency": plain(self.consistency),
            "fit": plain(self.fit),
            "validation": plain(self.validation),
            "changed_segments": plain(self.changes.segments),
            "changes": {
                "explained": self.changes.explained,
                "dispersion": self.changes.dispersion,
                "beside": plain(self.changes.beside),
            },
            "total_mass": plain(self.total_mass),
        }


def judge(
    problem: IdentificationProblem,
    validation: IdentificationProblem | None,
    identified: IdentifiedParameters,
    *,
    changes: Changes,
    total_mass: TotalMassReport,
    bounds: KnownBounds | None,
) -> Judgement:
    """Hold the parameters against the rows, other trials, and what was known before.

    Args:
        problem: rows of the identification trials.
        validation: rows of the validation trials, None where there are none.
        identified: the parameters.
        changes: segments that are not what the model says.
        total_mass: the total mass from all sides.
        bounds: what was stated of the parameters, None if nothing.
    """
    parameters = identified.all
    return Judgement(
        consistency=check_consistency(identified.inertial, identified.segments),
        fit=channel_fits(problem, parameters, problem.prior),
        validation={} if validation is None else channel_fits(validation, parameters, problem.prior),
        changes=changes,
        total_mass=total_mass,
        bounds=None
        if bounds is None
        else bounds.judge(identified.links, identified.inertial, identified.by_drive()),
    )


def mass_report(
    rows: Regression, noise: NoiseModel, settings: EstimatorSettings, identified: IdentifiedParameters
) -> TotalMassReport:
    """The total mass from all sides.

    Args:
        rows: condensed and weighted rows, of which those of the forces tell the mass.
        noise: their noise.
        settings: hold what the scale said.
        identified: the parameters.
    """
    measured = measured_total_mass(replace(rows, noise=noise))
    return TotalMassReport(
        identified=float(identified.masses.sum()),
        nominal=float(identified.nominal[::10].sum()),
        measured=measured.value if measured.identifiable else None,
        measured_std=measured.std if measured.identifiable else None,
        weighed=settings.total_mass,
        of_torques=not set(rows.problem.channel_names) <= set(WRENCH_AXES),
    )


# What the rows and the estimate, beside each other, leave in doubt.

_CONFLICT = 5.0
_DOUBTS_MOST_NAMED = 4


def find_doubts(estimate: Estimate, statistics: BaseStatistics, spread: Array) -> tuple[Finding, ...]:
    """Directions that the data leave to the nominal model, conflict with plain least squares, bounds reached.

    Args:
        estimate: the estimate.
        statistics: least-squares base parameters of the same rows and weights.
        spread: expected spread of each segment's mass about nominal, as share of it, ``(n_segments,)``.
    """
    return (
        *_unexcited(estimate, statistics, spread),
        *_conflict(estimate, statistics),
        *_bounds(estimate),
    )


def _unexcited(estimate: Estimate, statistics: BaseStatistics, spread: Array) -> list[Finding]:
    """Directions of base parameters in which the data know less than the nominal model.

    Generalised eigenvalues of the estimate's covariance against that of parameters scattered about the
    nominal ones; above one, what is measured there is mostly noise.
    """
    matrix = statistics.base.matrix * prior_std(estimate.regression.problem, spread)
    prior = matrix @ matrix.T
    size = np.sqrt(np.diag(prior))
    if not (size > 0.0).all():
        return []
    scaled = np.outer(size, size)
    # Base parameters can be nearly the same combination; a small ridge keeps the pencil definite.
    expected = prior / scaled + 1e-9 * np.eye(len(size))
    ratios, directions = eigh(statistics.covariance / scaled, expected)
    blind = ratios > 1.0
    if not blind.any():
        return []
    weight = ((expected @ directions[:, blind]) ** 2).sum(axis=1)
    labels = statistics.base.labels
    names = tuple(labels[i] for i in np.argsort(-weight, kind="stable")[:_DOUBTS_MOST_NAMED])
    text = (
        f"in {int(blind.sum())} of {len(ratios)} directions the data say less than the nominal model; what is "
        f"identified there is the model's or noise, most in {list_names(names)}: excite these joints more"
    )
    worst = float(np.sqrt(ratios.max()))
    return [Finding("unexcited", text, {"directions": float(blind.sum()), "worst_ratio": worst}, names)]


def _conflict(estimate: Estimate, statistics: BaseStatistics) -> list[Finding]:
    """Base parameters that constraints or the nominal model have moved far beyond their own uncertainty."""
    values = statistics.base.values(estimate.parameters)
    distance = np.abs(values - statistics.estimate) / np.maximum(statistics.std, 1e-300)
    far = distance > _CONFLICT
    if not far.any():
        return []
    order = np.argsort(-distance, kind="stable")[: int(far.sum())]
    names = tuple(statistics.base.labels[i] for i in order)
    inertial = estimate.regression.problem.n_inertial
    in_bodies = any(statistics.base.independent[i] < inertial for i in order[:_DOUBTS_MOST_NAMED])
    cause = (
        "the rows hold something that no rigid body does, or the torque scale is off"
        if in_bodies
        else "friction does not follow the terms that were fitted (it may fall with speed, or differ by direction)"
    )
    text = (
        f"{estimate.method} and plain least squares differ by up to {distance.max():.0f} standard deviations "
        f"in {list_names(names, _DOUBTS_MOST_NAMED)}: {cause}"
    )
    return [Finding("conflict", text, {"standard_deviations": float(distance.max())}, names)]


def _bounds(estimate: Estimate) -> list[Finding]:
    if not estimate.active:
        return []
    many = "1 constraint holds" if len(estimate.active) == 1 else f"{len(estimate.active)} constraints hold"
    text = f"{many} with equality, beyond which the data would go: {list_names(estimate.active, _DOUBTS_MOST_NAMED)}"
    return [Finding("at_bound", text, {"constraints": float(len(estimate.active))}, estimate.active)]


# When a parameter is known too poorly to be used by itself.

POOR_RSD = 30.0
"""Relative standard deviation above which a parameter is warned of [percent]."""

PATIENCE = 10.0
"""A parameter that would need more than this many times the motion run so far is left to the noise."""

# Even so much more motion would leave the value as uncertain as it is large: deviations fall with its root [percent].
_NOT_SHOWN = 100.0 * math.sqrt(PATIENCE)

NOT_SHOWN = "not shown by these motions"
"""What is said in place of a relative standard deviation that is no figure to compare any more."""


def said_rsd(rsd_percent: float | None) -> str:
    """A relative standard deviation for a person [percent]; None is one that is not known.

    >>> said_rsd(3.14), said_rsd(4880455121.0), said_rsd(None)
    ('3.1 %', 'not shown by these motions', 'not shown by these motions')
    """
    return NOT_SHOWN if rsd_percent is None or not rsd_percent <= _NOT_SHOWN else percent(rsd_percent)


# What a careful reader of an identification should know.

_LARGE_DISPERSION = 4.0
_MASS_DISAGREES = 0.01
# Unmodelled equipment weighs less than this share.
_MASS_FAR = 0.4
# A mass whose standard deviation is a larger share of the known one is not told by the record. Torques of three
# quadrupeds that sway tell theirs to 27 and 30 % where friction or a constant is missing, and are then off by 170 to
# 220 %; those of humanoids that squat to 0.1 %.
_MASS_TOLD = 0.1
_WORSE_ON_VALIDATION = 2.0
_MOST_NAMED = 5


def find_warnings(
    identified: IdentifiedParameters, statistics: ParameterStatistics, judgement: Judgement
) -> tuple[Finding, ...]:
    """Findings on data, solution and validation, in this order; empty where all is well.

    Args:
        identified: the parameters.
        statistics: how well they are known.
        judgement: what they are worth.
    """
    return (
        *_of_data(identified, statistics),
        *_of_mass(judgement.total_mass),
        *_of_solution(identified, judgement),
        *_of_prediction(judgement),
    )


def _of_data(identified: IdentifiedParameters, statistics: ParameterStatistics) -> list[Finding]:
    found = []
    if identified.unmeasured:
        text = f"not seen by the sensors, kept nominal: {', '.join(identified.unmeasured)}"
        found.append(Finding("unmeasured", text, places=identified.unmeasured))
    rank, base = statistics.structural_rank, statistics.base
    missing = 0 if rank is None else rank - len(base)
    if missing > 0:
        text = f"the motions leave {missing} of {rank} base parameters without excitation"
        found.append(Finding("rank", text, {"missing": float(missing)}))
    poor = tuple(item.name for item in base if item.rsd_percent > POOR_RSD)
    if poor:
        text = f"{len(poor)} of {len(base)} base parameters have an RSD above {POOR_RSD:.0f} %"
        found.append(Finding("poor_rsd", text, {"parameters": float(len(poor))}, poor))
    return found


def _of_mass(mass: TotalMassReport) -> list[Finding]:
    """The measured forces against a weighed mass, or roughly against the model's."""
    if mass.measured is None:
        return []
    known, name, tolerance = mass.nominal, "the model", _MASS_FAR
    if mass.weighed is not None:
        known, name, tolerance = mass.weighed, "the scale", _MASS_DISAGREES
    share = mass.measured / known - 1.0
    told = mass.measured_std is not None and mass.measured_std <= _MASS_TOLD * known
    if abs(share) <= tolerance or not told:
        return []
    by, cause = "forces", "check the force sensors' gain and zero"
    if share < -1.0:
        cause = "the wrenches look like those that the robot exerts, not those on the robot"
    if mass.of_torques:
        by, cause = (
            "torques",
            "check their sign, unit and gear" if share < -1.0 else "check their unit and gear",
        )
    text = f"the {by} say {mass.measured:.2f} kg, {name} {known:.2f} kg ({100 * share:+.1f} %): {cause}"
    return [Finding("force_scale", text, {"measured_kg": mass.measured, "known_kg": known})]


def _of_solution(identified: IdentifiedParameters, judgement: Judgement) -> list[Finding]:
    found = []
    bad = tuple(judgement.consistency.inconsistent)
    if bad:
        consistent = next(name for name, kind in ESTIMATORS.items() if kind.consistent)
        text = (
            f"no body has the parameters of {list_names(bad, _MOST_NAMED)}; method {consistent} gives ones that "
            "exist"
        )
        found.append(Finding("inconsistent", text, {"segments": float(len(bad))}, bad))
    broken = () if judgement.bounds is None else judgement.bounds.broken
    if broken:
        names = tuple(item.name for item in broken)
        text = (
            f"outside the stated bounds: {list_names(names, _MOST_NAMED)}; method physical keeps all of them, except "
            "of links that the sensors do not see"
        )
        found.append(Finding("outside_bounds", text, {"parameters": float(len(names))}, names))
    found += _impossible(identified, judgement)
    dispersion = judgement.changes.dispersion
    if judgement.changes.segments and dispersion > _LARGE_DISPERSION:
        text = (
            "the changed segments do not explain everything: what is left is "
            f"{dispersion:.0f} times the noise per base parameter"
        )
        found.append(Finding("unexplained", text, {"dispersion": dispersion}))
    return found


def _impossible(identified: IdentifiedParameters, judgement: Judgement) -> list[Finding]:
    """Changed segments that no body can be: a scapegoat for something else.

    They weigh less than nothing, or gain more than the known total mass has gained and other named ones have lost.
    """
    nominal, segments = identified.nominal[::10], judgement.changes.segments
    mass_of = dict(zip(identified.links, nominal.tolist(), strict=True))
    light = {
        item.link: f"{item.link} ({item.mass_change_kg:+.2f} kg of {mass_of[item.link]:.2f} kg)"
        for item in segments
        if item.mass_change_kg + 2.0 * item.std_kg < -mass_of[item.link]
    }
    total = judgement.total_mass
    known, std = (total.weighed, 0.0) if total.weighed is not None else (total.measured, total.measured_std)
    heavy = {}
    if known is not None and std is not None:
        room = known - total.nominal + 2.0 * std
        room += sum(
            max(0.0, min(2.0 * one.std_kg - one.mass_change_kg, mass_of[one.link])) for one in segments
        )
        heavy = {
            item.link: f"{item.link} ({item.mass_change_kg:+.2f} kg)"
            for item in segments
            if item.mass_change_kg - 2.0 * item.std_kg > room
        }
    found = []
    cause = "no body has changed there, the torque scale, the drives or the nominal model's geometry are off"
    if light:
        text = f"named as changed, {list_names(list(light.values()))} would weigh less than nothing: {cause}"
        found.append(Finding("weightless", text, {"segments": float(len(light))}, tuple(light)))
    if heavy:
        text = (
            f"named as changed, {list_names(list(heavy.values()))} would gain more than the known total mass has "
            f"gained and others have lost: {cause}"
        )
        found.append(Finding("overweight", text, {"segments": float(len(heavy))}, tuple(heavy)))
    return found


def _of_prediction(judgement: Judgement) -> list[Finding]:
    if not judgement.validation:
        return [Finding("no_validation", "no validation trials: the fit says nothing about other motions")]
    found = []
    blind = tuple(name for name in judgement.validation if name not in judgement.fit)
    if blind:
        text = (
            f"{list_names(blind, _MOST_NAMED)}: no rows on the identification trials, so what acts there alone is the "
            "nominal model's; let the joint move"
        )
        found.append(Finding("no_rows", text, places=blind))
    for name in (name for name in judgement.validation if name in judgement.fit):
        fit = judgement.validation[name]
        figures = {"validation_rmse": fit.rmse, "fit_rmse": judgement.fit[name].rmse}
        if fit.rmse >= fit.reference_rmse:
            text = f"{name}: no better than the nominal model on the validation trials"
            found.append(Finding("no_better", text, figures, (name,)))
        elif fit.rmse > _WORSE_ON_VALIDATION * judgement.fit[name].rmse:
            text = (
                f"{name}: residual {fit.rmse / judgement.fit[name].rmse:.1f} times larger on validation trials "
                "than on those identified from; excite more, or look for what the model lacks"
            )
            found.append(Finding("validation_gap", text, figures, (name,)))
    return found
