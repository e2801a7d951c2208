"""What an identification says: parameters with their precision, fit and warnings, as a document and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.display import Row, Tabled, count
from excite.finding import Finding, list_names
from excite.identification.changed_segments import ChangedSegment, Changes
from excite.identification.estimators.estimator import Estimate, SolveStatus
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.judgement.judgement import ChannelFit, Consistency, Judgement, TotalMassReport
from excite.identification.judgement.uncertainty import ParameterUncertainty
from excite.identification.parameter_statistics import BaseParameter, ParameterStatistics
from excite.identification.physical.retrieval import Certificate
from excite.results import finite, plain

# Lines of an identification's summary.

# Links are no longer: a centre of mass that is known no better than this is anywhere in one [m].
_WITHIN_M = 1.0


def mass_change(item: ChangedSegment) -> str:
    """The change of mass, or that the rows say nothing of it: an arm's masses show only in combinations."""
    if item.std_kg > max(abs(item.mass_change_kg), 1.0):
        return "first moments or inertia; its mass alone is not determined"
    mass = f"{item.mass_change_kg:+.3f} ± {item.std_kg:.2g} kg"
    if item.centre_m is None or item.centre_std_m is None:
        return mass
    # Along axes that are all parallel nothing is felt of a centre of mass.
    shown = [std < _WITHIN_M for std in item.centre_std_m]
    if not any(shown):
        return f"{mass}; where is not determined"
    centre = ", ".join(f"{x:.3f}" if s else "–" for x, s in zip(item.centre_m, shown, strict=True))
    most = max(std for std, s in zip(item.centre_std_m, shown, strict=True) if s)
    hidden = "" if all(shown) else " (– is not determined)"
    return f"{mass} at ({centre}) ± {most:.2g} m from its joint{hidden}"


def fit_table(title: str, fits: dict[str, ChannelFit]) -> list[str]:
    """Lines with how well each channel is explained, by the identified model and by the nominal one."""
    width = max(len(name) for name in [*fits, "channel"])
    lines = [f"{title}, RMSE (correlation):", f"  {'channel':{width}}  {'identified':>20}  {'nominal':>20}"]
    for name, fit in fits.items():
        line = f"  {name:{width}}"
        for rmse, cc in ((fit.rmse, fit.cc), (fit.reference_rmse, fit.reference_cc)):
            said = f"{rmse:.3f} {fit.unit} ({'–' if cc is None else f'{cc:.3f}'})"
            line += f"  {said:>20}"
        lines.append(line)
    return lines


# How an identification's parameters were found, and what is proven of them.


@dataclass(frozen=True, eq=False)
class Solution:
    """How the parameters were found.

    Attributes:
        method: registry name of the estimator.
        status: advice on how the solve ended.
        solved: whether the estimator's answer passed its recomputation; what did not is no result.
        n_samples: instants that were used.
        violations: largest violation of each kind of constraint, recomputed; in the estimator's units.
        certificate: what is proven of the method's objective, None where it is convex.
        total_mass: that was imposed on the sum of all masses [kg], None where it was free.
    """

    method: str
    status: str
    solved: bool
    n_samples: int
    violations: dict[str, float]
    certificate: Certificate | None
    total_mass: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Its blocks of the document."""
        return {
            "method": self.method,
            "status": self.status,
            "solved": self.solved,
            "violations": self.violations,
            "certificate": plain(self.certificate),
            "n_samples": self.n_samples,
        }


def solution_of(estimate: Estimate) -> Solution:
    """What an estimate says of itself."""
    problem = estimate.regression.problem
    return Solution(
        method=estimate.method,
        status=estimate.status.value,
        solved=estimate.status is SolveStatus.SOLVED,
        n_samples=len(np.unique(np.column_stack([problem.trial, problem.time]), axis=0)),
        violations=dict(estimate.violations or {}),
        certificate=estimate.certificate,
        total_mass=estimate.total_mass,
    )


SCHEMA = "excite.identification/1"

# Order of the document's blocks, whichever part they come from.
_BLOCKS = (
    "schema robot method status solved violations certificate bounds n_samples standard_parameters "
    "drive_parameters base_parameters n_structural_base_parameters essential consistency fit validation "
    "changed_segments changes total_mass unmeasured warnings findings"
).split()


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Tabled):
    """Identified parameters, their quality, and how well they predict.

    What is asked for most stands here under its own name too; the rest is in the parts.

    Attributes:
        robot: name of the robot.
        solution: how the parameters were found, and what is proven of them.
        identified: parameters of bodies and drives, beside the nominal ones.
        statistics: how well they are known.
        judgement: what they are worth.
        findings: what a careful reader should know, with figures.
    """

    robot: str
    solution: Solution
    identified: IdentifiedParameters
    statistics: ParameterStatistics
    judgement: Judgement
    findings: tuple[Finding, ...]

    tables = ("parameters", "base", "essential", "drives", "fit", "validation")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`.

        Inertial parameters of all links beside the model's (about joint frames, SI), base or essential parameters,
        parameters of drives, or how well channels are predicted on trials of either kind.
        """
        if table == "parameters":
            return self.identified.rows(self.uncertainty)
        if table in ("base", "essential"):
            return [one.row() for one in (self.base if table == "base" else self.essential)]
        if table == "drives":
            return [{"parameter": name, "value": v} for name, v in self.identified.by_drive().items()]
        fits = self.fit if table == "fit" else self.validation
        return [one.row(channel=name) for name, one in fits.items()]

    @property
    def method(self) -> str:
        """Registry name of the estimator."""
        return self.solution.method

    @property
    def links(self) -> tuple[str, ...]:
        """Links of the segments, in model order."""
        return self.identified.links

    @property
    def parameters(self) -> Array:
        """Inertial parameters, ``(10·n_segments,)``, pinocchio's order, joint frames [SI]."""
        return self.identified.inertial

    @property
    def nominal(self) -> Array:
        """The model's inertial parameters, ``(10·n_segments,)``."""
        return self.identified.nominal

    @property
    def masses(self) -> Array:
        """Identified masses of the segments, ``(n_segments,)`` [kg]."""
        return self.identified.masses

    @property
    def drives(self) -> Array:
        """Parameters of the drives, ``(n_drives,)`` [SI]; their names are ``identified.drive_names``."""
        return self.identified.drives

    @property
    def base(self) -> tuple[BaseParameter, ...]:
        """Base parameters with their standard deviations."""
        return self.statistics.base

    @property
    def essential(self) -> tuple[BaseParameter, ...]:
        """Base parameters that are left after the negligible ones were removed, re-estimated."""
        return self.statistics.essential

    @property
    def uncertainty(self) -> ParameterUncertainty | None:
        """Of all parameters, from data and nominal model together; None where it was not computed."""
        return self.statistics.uncertainty

    @property
    def consistency(self) -> Consistency:
        """Whether the parameters are those of bodies that can exist."""
        return self.judgement.consistency

    @property
    def fit(self) -> dict[str, ChannelFit]:
        """By channel, on the identification trials."""
        return self.judgement.fit

    @property
    def validation(self) -> dict[str, ChannelFit]:
        """By channel, on the validation trials; empty where there are none."""
        return self.judgement.validation

    @property
    def changes(self) -> Changes:
        """Segments that are not what the model says."""
        return self.judgement.changes

    @property
    def total_mass(self) -> TotalMassReport:
        """The total mass from all sides."""
        return self.judgement.total_mass

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings, one sentence each."""
        return tuple(finding.text for finding in self.findings)

    def to_json(self) -> dict[str, Any]:
        """The document ``excite.identification/1``; what is infinite or not known is null."""
        blocks = {
            "schema": SCHEMA,
            "robot": self.robot,
            **self.solution.to_json(),
            **self.identified.to_json(self.statistics.uncertainty),
            **self.statistics.to_json(),
            **self.judgement.to_json(),
            "warnings": list(self.warnings),
            "findings": plain(self.findings),
        }
        return {name: finite(blocks[name]) for name in _BLOCKS}

    def summary(self) -> str:
        """The result in words and a table, for a terminal."""
        rank, mass = self.statistics.structural_rank, self.total_mass
        lines = [
            f"{self.robot}, method {self.method}: {count(len(self.base), 'base parameter')}"
            + (f" of {rank}" if rank is not None else "")
            + f" from {self.solution.n_samples} samples",
            f"total mass {mass.identified:.3f} kg (nominal {mass.nominal:.3f} kg{self._mass_held()})"
            + (", which is no weight: the torques are not N·m" if self.in_unknown_unit else ""),
        ]
        if not self.solution.solved:
            lines.insert(0, f"NO SOLUTION, the best found follows: {self.solution.status}")
        lines += self._promises()
        for title, fits in (("identification trials", self.fit), ("validation trials", self.validation)):
            if fits:
                lines += ["", *fit_table(title, fits)]
        lines += ["", *self._change_lines()]
        lines += [f"note: {text}" for text in self.warnings]
        return "\n".join(lines)

    def _mass_held(self) -> str:
        """Whether the total mass was imposed, and why not."""
        held, mass = self.solution.total_mass, self.total_mass
        if held is not None:
            return f"; held at what was {'measured' if mass.weighed is None else 'weighed'}"
        if mass.weighed is not None or mass.measured is not None:
            return "; not held"
        return "; not held: this record does not tell it"

    def _promises(self) -> list[str]:
        """What is proven of the objective, and what became of stated bounds."""
        certificate, bounds = self.solution.certificate, self.judgement.bounds
        proven = [] if certificate is None else [f"certificate: {certificate.summary()}"]
        return proven + ([] if bounds is None else [bounds.summary()])

    @property
    def impossible_changes(self) -> frozenset[str]:
        """Links named as changed whose change no body can have: something else is wrong there."""
        return frozenset(
            link
            for found in self.findings
            if found.kind in {"weightless", "overweight"}
            for link in found.places
        )

    @property
    def in_unknown_unit(self) -> bool:
        """Whether the torques of all joints are in a unit that is not known, and with them every parameter."""
        return any(
            found.kind == "torque_scale" and len(found.places) == len(self.fit) and not found.repaired
            for found in self.findings
        )

    def _change_lines(self) -> list[str]:
        if self.in_unknown_unit:
            return ["changed segments: not asked of torques in an unknown unit"]
        beside = [f"{item.name} {item.value:+.3g} ± {item.std:.2g}" for item in self.changes.beside]
        if not self.changes.segments:
            few = any(found.kind == "too_few_instants" for found in self.findings)
            said = (
                "not looked for" if few else "none found that stands out; all parameters are estimated anew"
            )
            return [f"changed segments: {said}", *_torque_lines(beside)]
        lines = ["changed segments:"]
        for item in self.changes.segments:
            ties = (*item.tied_with, *item.tied_terms)
            others = f" (or {', '.join(ties)})" if ties else ""
            doubt = "; no body can have it: no such change" if item.link in self.impossible_changes else ""
            lines.append(f"  {item.segment}: {mass_change(item)}{others}{doubt}")
        return [
            *lines,
            *_torque_lines(beside),
            "  (the fewest that explain what the nominal model leaves; sizes hold if nothing else differs)",
        ]


def _torque_lines(beside: list[str]) -> list[str]:
    """What explains the rows beside bodies."""
    return [f"  beside them, factors and zeros of torques: {list_names(beside, 5)}"] if beside else []
