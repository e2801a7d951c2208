"""What the parameters are worth: bodies that can exist, predictions, changes, total mass, stated bounds."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from excite.identification.constraints.mass import measured_total_mass
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.judgement.changes import Changes
from excite.identification.judgement.consistency import Consistency, check_consistency
from excite.identification.judgement.validation import ChannelFit, channel_fits
from excite.identification.noise.correlated import NoiseModel
from excite.identification.physical.known_bounds import BoundsReport, KnownBounds
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression
from excite.logs.columns import WRENCH_AXES


@dataclass(frozen=True)
class TotalMassReport:
    """Total mass as it was known from several sides [kg]; None where a side says nothing.

    Attributes:
        identified: sum of the identified masses.
        nominal: sum of the model's masses.
        measured: what the measured forces say.
        measured_std: its standard deviation.
        weighed: what the scale said.
        of_torques: whether joints' torques measure it, in place of wrenches.
    """

    identified: float
    nominal: float
    measured: float | None
    measured_std: float | None
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
            "bounds": None if self.bounds is None else self.bounds.to_json(),
            "consistency": {**asdict(self.consistency), "inconsistent": list(self.consistency.inconsistent)},
            "fit": {name: asdict(item) for name, item in self.fit.items()},
            "validation": {name: asdict(item) for name, item in self.validation.items()},
            "changed_segments": [
                {**asdict(item), "tied_with": list(item.tied_with)} for item in self.changes.segments
            ],
            "changes": {"explained": self.changes.explained, "dispersion": self.changes.dispersion},
            "total_mass": asdict(self.total_mass),
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
