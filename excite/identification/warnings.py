"""What a careful reader of an identification should know, in sentences."""

from __future__ import annotations

from excite.identification.estimators.registry import ESTIMATORS
from excite.identification.result import Identification

_POOR_RSD = 30.0
_LARGE_DISPERSION = 4.0
_MASS_DISAGREES = 0.01
_WORSE_ON_VALIDATION = 2.0
_MOST_NAMED = 5


def find_warnings(result: Identification) -> tuple[str, ...]:
    """Warnings on data, solution and validation, in this order; empty where all is well."""
    return (*_of_data(result), *_of_solution(result), *_of_prediction(result))


def _of_data(result: Identification) -> list[str]:
    texts = []
    if result.unmeasured:
        texts.append(f"not seen by the sensors, kept nominal: {', '.join(result.unmeasured)}")
    missing = 0 if result.structural_rank is None else result.structural_rank - len(result.base)
    if missing > 0:
        texts.append(
            f"the motions leave {missing} of {result.structural_rank} base parameters without excitation"
        )
    poor = [item for item in result.base if item.rsd_percent > _POOR_RSD]
    if poor:
        texts.append(f"{len(poor)} of {len(result.base)} base parameters have an RSD above {_POOR_RSD:.0f} %")
    mass = result.total_mass
    if mass.weighed is not None and mass.measured is not None:
        share = mass.measured / mass.weighed - 1.0
        if abs(share) > _MASS_DISAGREES:
            texts.append(
                f"the forces say {mass.measured:.2f} kg, the scale {mass.weighed:.2f} kg "
                f"({100 * share:+.1f} %): check the force sensors' gain and zero"
            )
    return texts


def _of_solution(result: Identification) -> list[str]:
    texts = []
    bad = result.consistency.inconsistent
    if bad:
        named = ", ".join(bad[:_MOST_NAMED]) + (
            f" and {len(bad) - _MOST_NAMED} more" if len(bad) > _MOST_NAMED else ""
        )
        consistent = next(name for name, kind in ESTIMATORS.items() if kind.consistent)
        texts.append(f"no body has the parameters of {named}; method {consistent} gives ones that exist")
    if result.changes.segments and result.changes.dispersion > _LARGE_DISPERSION:
        texts.append(
            "the changed segments do not explain everything: what is left is "
            f"{result.changes.dispersion:.0f} times the noise per base parameter"
        )
    return texts


def _of_prediction(result: Identification) -> list[str]:
    if not result.validation:
        return ["no validation trials: the fit says nothing about other motions"]
    texts = []
    for name, fit in result.validation.items():
        if fit.rmse >= fit.reference_rmse:
            texts.append(f"{name}: no better than the nominal model on the validation trials")
        elif fit.rmse > _WORSE_ON_VALIDATION * result.fit[name].rmse:
            texts.append(
                f"{name}: residual {fit.rmse / result.fit[name].rmse:.1f} times larger on validation trials "
                "than on those identified from; excite more, or look for what the model lacks"
            )
    return texts
