"""What a careful reader of an identification should know."""

from __future__ import annotations

from excite.finding import Finding, list_names
from excite.identification.estimators.registry import ESTIMATORS
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.judgement.changes import Changes
from excite.identification.judgement.judgement import Judgement, TotalMassReport
from excite.identification.judgement.poor import POOR_RSD
from excite.identification.parameter_statistics import ParameterStatistics

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
    found += _weightless(identified, judgement.changes)
    dispersion = judgement.changes.dispersion
    if judgement.changes.segments and dispersion > _LARGE_DISPERSION:
        text = (
            "the changed segments do not explain everything: what is left is "
            f"{dispersion:.0f} times the noise per base parameter"
        )
        found.append(Finding("unexplained", text, {"dispersion": dispersion}))
    return found


def _weightless(identified: IdentifiedParameters, changes: Changes) -> list[Finding]:
    """Changed segments that would weigh less than nothing: a scapegoat for something else."""
    nominal = dict(zip(identified.links, identified.nominal[::10].tolist(), strict=True))
    light = {
        item.link: (item.mass_change_kg, nominal[item.link])
        for item in changes.segments
        if item.mass_change_kg + 2.0 * item.std_kg < -nominal[item.link]
    }
    if not light:
        return []
    said = [f"{link} ({change:+.2f} kg of {mass:.2f} kg)" for link, (change, mass) in light.items()]
    text = (
        f"named as changed, {list_names(said)} would weigh less than nothing: no body has changed there, the torque "
        "scale, the drives or the nominal model's geometry are off"
    )
    return [Finding("weightless", text, {"segments": float(len(light))}, tuple(light))]


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
