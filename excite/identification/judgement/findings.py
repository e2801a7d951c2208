"""What a careful reader of an identification should know: of data, solution, validation and doubts of the estimate."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import eigh

from excite.arrays import Array
from excite.finding import Finding, list_names
from excite.identification.estimators.estimator import Estimate
from excite.identification.estimators.registry import DEFAULT_METHOD
from excite.identification.judgement.judgement import POOR_RSD, TotalMassReport
from excite.identification.regression import prior_std
from excite.identification.result import Identification
from excite.identification.statistics import BaseStatistics

_CONFLICT = 5.0
_MOST_NAMED = 5
_DOUBTS_MOST_NAMED = 4
_LARGE_DISPERSION = 4.0
_MASS_DISAGREES = 0.01
# Unmodelled equipment weighs less than this share.
_MASS_FAR = 0.4
# A mass whose standard deviation is a larger share of the known one is not told by the record. Torques of three
# quadrupeds that sway tell theirs to 27 and 30 % where friction or a constant is missing, and are then off by 170 to
# 220 %; those of humanoids that squat to 0.1 %.
_MASS_TOLD = 0.1
_WORSE_ON_VALIDATION = 2.0


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
        *_constraints_reached(estimate.active),
    )


def _unexcited(estimate: Estimate, statistics: BaseStatistics, spread: Array) -> Iterator[Finding]:
    """Directions of base parameters in which the data know less than the nominal model.

    Generalised eigenvalues of the estimate's covariance against that of parameters scattered about the
    nominal ones; above one, what is measured there is mostly noise.
    """
    matrix = statistics.base.matrix * prior_std(estimate.regression.problem, spread)
    prior = matrix @ matrix.T
    size = np.sqrt(np.diag(prior))
    if not (size > 0.0).all():
        return
    scaled = np.outer(size, size)
    # Base parameters can be nearly the same combination; a small ridge keeps the pencil definite.
    expected = prior / scaled + 1e-9 * np.eye(len(size))
    ratios, directions = eigh(statistics.covariance / scaled, expected)
    blind = ratios > 1.0
    if blind.any():
        weight = ((expected @ directions[:, blind]) ** 2).sum(axis=1)
        order = np.argsort(-weight, kind="stable")[:_DOUBTS_MOST_NAMED]
        names = tuple(statistics.base.labels[i] for i in order)
        text = (
            f"in {int(blind.sum())} of {len(ratios)} directions the data say less than the nominal model; what is "
            f"identified there is the model's or noise, most in {list_names(names)}: excite these joints more"
        )
        figures = {"directions": float(blind.sum()), "worst_ratio": float(np.sqrt(ratios.max()))}
        yield Finding("unexcited", text, figures, names)


def _conflict(estimate: Estimate, statistics: BaseStatistics) -> Iterator[Finding]:
    """Base parameters that constraints or the nominal model have moved far beyond their own uncertainty."""
    base = statistics.base
    moved = np.abs(base.values(estimate.parameters) - statistics.estimate)
    distance = moved / np.maximum(statistics.std, 1e-300)
    order = np.argsort(-distance, kind="stable")[: int((distance > _CONFLICT).sum())]
    if len(order):
        names = tuple(base.labels[i] for i in order)
        leading = base.independent[order[:_DOUBTS_MOST_NAMED]]
        cause = (
            "the rows hold something that no rigid body does, or the torque scale is off"
            if (leading < estimate.regression.problem.n_inertial).any()
            else "friction does not follow the terms that were fitted (it may fall with speed, or differ by direction)"
        )
        text = (
            f"{estimate.method} and plain least squares differ by up to {distance.max():.0f} standard deviations "
            f"in {list_names(names, _DOUBTS_MOST_NAMED)}: {cause}"
        )
        yield Finding("conflict", text, {"standard_deviations": float(distance.max())}, names)


def _constraints_reached(active: tuple[str, ...]) -> Iterator[Finding]:
    if active:
        many = "1 constraint holds" if len(active) == 1 else f"{len(active)} constraints hold"
        named = list_names(active, _DOUBTS_MOST_NAMED)
        text = f"{many} with equality, beyond which the data would go: {named}"
        yield Finding("at_bound", text, {"constraints": float(len(active))}, active)


def find_warnings(result: Identification) -> tuple[Finding, ...]:
    """Findings on data, solution and validation, in this order; empty where all is well."""
    return (*_of_data(result), *_of_mass(result.total_mass), *_of_solution(result), *_of_prediction(result))


def _of_data(result: Identification) -> Iterator[Finding]:
    if result.unmeasured:
        text = f"not seen by the sensors, kept nominal: {', '.join(result.unmeasured)}"
        yield Finding("unmeasured", text, places=result.unmeasured)
    base, rank = result.base, result.structural_rank
    missing = 0 if rank is None else rank - len(base)
    if missing > 0:
        text = f"the motions leave {missing} of {rank} base parameters without excitation"
        yield Finding("rank", text, {"missing": float(missing)})
    poor = tuple(item.name for item in base if item.rsd_percent > POOR_RSD)
    if poor:
        text = f"{len(poor)} of {len(base)} base parameters have an RSD above {POOR_RSD:.0f} %"
        yield Finding("poor_rsd", text, {"parameters": float(len(poor))}, poor)


def _of_mass(mass: TotalMassReport) -> Iterator[Finding]:
    """The measured forces against a weighed mass, or roughly against the model's."""
    if mass.measured is None or mass.measured_std is None:
        return
    known, name, tolerance = mass.nominal, "the model", _MASS_FAR
    if mass.weighed is not None:
        known, name, tolerance = mass.weighed, "the scale", _MASS_DISAGREES
    share = mass.measured / known - 1.0
    if abs(share) > tolerance and mass.measured_std <= _MASS_TOLD * known:
        by = "torques" if mass.of_torques else "forces"
        cause = {
            ("forces", False): "check the force sensors' gain and zero",
            ("forces", True): "the wrenches look like those that the robot exerts, not those on the robot",
            ("torques", False): "check their unit and gear",
            ("torques", True): "check their sign, unit and gear",
        }[by, share < -1.0]
        text = f"the {by} say {mass.measured:.2f} kg, {name} {known:.2f} kg ({100 * share:+.1f} %): {cause}"
        yield Finding("force_scale", text, {"measured_kg": mass.measured, "known_kg": known})


def _of_solution(result: Identification) -> Iterator[Finding]:
    bad = tuple(result.consistency.inconsistent)
    if bad:
        text = (
            f"no body has the parameters of {list_names(bad, _MOST_NAMED)}; method {DEFAULT_METHOD} gives ones that "
            "exist"
        )
        yield Finding("inconsistent", text, {"segments": float(len(bad))}, bad)
    names = () if result.bounds is None else tuple(item.name for item in result.bounds.broken)
    if names:
        text = (
            f"outside the stated bounds: {list_names(names, _MOST_NAMED)}; method physical keeps all of them, except "
            "of links that the sensors do not see"
        )
        yield Finding("outside_bounds", text, {"parameters": float(len(names))}, names)
    yield from _impossible(result)
    dispersion = result.changes.dispersion
    if result.changes.segments and dispersion > _LARGE_DISPERSION:
        text = (
            "the changed segments do not explain everything: what is left is "
            f"{dispersion:.0f} times the noise per base parameter"
        )
        yield Finding("unexplained", text, {"dispersion": dispersion})


def _impossible(result: Identification) -> Iterator[Finding]:
    """Changed segments that no body can be: a scapegoat for something else.

    They weigh less than nothing, or gain more than the known total mass has gained and other named ones have lost.
    """
    segments, total = result.changes.segments, result.total_mass
    mass_of = dict(zip(result.links, result.nominal[::10].tolist(), strict=True))
    weighed = total.weighed is not None
    known, std = (total.weighed, 0.0) if weighed else (total.measured, total.measured_std)
    room = np.inf
    if known is not None and std is not None:
        lost = (min(2.0 * one.std_kg - one.mass_change_kg, mass_of[one.link]) for one in segments)
        room = known - total.nominal + 2.0 * std + sum(max(0.0, one) for one in lost)
    light = {
        one.link: f"{one.link} ({one.mass_change_kg:+.2f} kg of {mass_of[one.link]:.2f} kg)"
        for one in segments
        if one.mass_change_kg + 2.0 * one.std_kg < -mass_of[one.link]
    }
    heavy = {
        one.link: f"{one.link} ({one.mass_change_kg:+.2f} kg)"
        for one in segments
        if one.mass_change_kg - 2.0 * one.std_kg > room
    }
    cause = "no body has changed there, the torque scale, the drives or the nominal model's geometry are off"
    for kind, found, would in (
        ("weightless", light, "weigh less than nothing"),
        ("overweight", heavy, "gain more than the known total mass has gained and others have lost"),
    ):
        if found:
            text = f"named as changed, {list_names(list(found.values()))} would {would}: {cause}"
            yield Finding(kind, text, {"segments": float(len(found))}, tuple(found))


def _of_prediction(result: Identification) -> Iterator[Finding]:
    if not result.validation:
        yield Finding("no_validation", "no validation trials: the fit says nothing about other motions")
    blind = tuple(name for name in result.validation if name not in result.fit)
    if blind:
        text = (
            f"{list_names(blind, _MOST_NAMED)}: no rows on the identification trials, so what acts there alone is the "
            "nominal model's; let the joint move"
        )
        yield Finding("no_rows", text, places=blind)
    for name, own in result.fit.items():
        fit = result.validation.get(name)
        if fit is None:
            continue
        figures = {"validation_rmse": fit.rmse, "fit_rmse": own.rmse}
        if fit.rmse >= fit.reference_rmse:
            text = f"{name}: no better than the nominal model on the validation trials"
            yield Finding("no_better", text, figures, (name,))
        elif fit.rmse > _WORSE_ON_VALIDATION * own.rmse:
            text = (
                f"{name}: residual {fit.rmse / own.rmse:.1f} times larger on validation trials "
                "than on those identified from; excite more, or look for what the model lacks"
            )
            yield Finding("validation_gap", text, figures, (name,))
