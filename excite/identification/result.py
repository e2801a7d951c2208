"""What an identification says: parameters with their precision, fit and warnings, as a document and in words."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.finding import Finding
from excite.identification.inertia import FILE_ORDER
from excite.identification.judgement.changes import Changes
from excite.identification.judgement.consistency import Consistency
from excite.identification.judgement.uncertainty import ParameterUncertainty
from excite.identification.judgement.validation import ChannelFit
from excite.identification.physical.certificate import Certificate
from excite.identification.physical.known_bounds import BoundsReport
from excite.identification.result_text import fit_table, mass_change

SCHEMA = "excite.identification/1"


@dataclass(frozen=True)
class BaseParameter:
    """A base parameter and how well it is known.

    Attributes:
        name: the parameter that stands for it, such as ``Izz(torso)``.
        expression: the whole combination in words.
        link: link of that parameter, None for a drive's.
        value: [SI].
        std: standard deviation [SI], valid for filtered and correlated noise.
        rsd_percent: ``100·std/|value|``.
        half_width_95: half the width of the interval that holds the truth in 95 of 100 cases [SI], None where
            it was not asked for.
    """

    name: str
    expression: str
    link: str | None
    value: float
    std: float
    rsd_percent: float
    half_width_95: float | None = None


@dataclass(frozen=True)
class TotalMassReport:
    """Total mass as it was known from several sides [kg]; None where a side says nothing.

    Attributes:
        identified: sum of the identified masses.
        nominal: sum of the model's masses.
        measured: what the measured forces say.
        measured_std: its standard deviation.
        weighed: what the scale said.
    """

    identified: float
    nominal: float
    measured: float | None
    measured_std: float | None
    weighed: float | None


@dataclass(frozen=True, eq=False)
class Identification:
    """Identified parameters, their quality, and how well they predict.

    Attributes:
        robot: name of the robot.
        method: registry name of the estimator.
        status: advice on how the solve ended.
        n_samples: instants that were used.
        links: links of the segments, in model order.
        segments: readable names of the segments.
        unmeasured: links that the sensors do not see; their parameters are nominal.
        parameters: ``(10·n_segments,)`` identified, pinocchio's order, joint frames [SI].
        nominal: ``(10·n_segments,)`` of the model.
        drive_names: names of the drives' parameters.
        drives: ``(n_drives,)`` identified [SI].
        base: base parameters.
        structural_rank: number of base parameters that free motion would determine; None if not known.
        essential: base parameters that are left after the negligible ones were removed, re-estimated.
        consistency: physical consistency of ``parameters``.
        fit: by channel, on the identification trials.
        validation: by channel, on the validation trials; empty where there are none.
        changes: segments that are not what the model says.
        total_mass: the total mass from all sides.
        findings: what a careful reader should know, with figures.
        uncertainty: of all parameters from data and nominal model together; None where it was not computed.
        solved: whether the estimator's answer passed its recomputation; what did not is no result.
        violations: largest violation of each kind of constraint, recomputed; in the estimator's units.
        certificate: what is proven of the method's objective, None where it is convex.
        bounds: stated bounds against the parameters, None where none were stated.
    """

    robot: str
    method: str
    status: str
    n_samples: int
    links: tuple[str, ...]
    segments: tuple[str, ...]
    unmeasured: tuple[str, ...]
    parameters: Array
    nominal: Array
    drive_names: tuple[str, ...]
    drives: Array
    base: tuple[BaseParameter, ...]
    structural_rank: int | None
    essential: tuple[BaseParameter, ...]
    consistency: Consistency
    fit: dict[str, ChannelFit]
    validation: dict[str, ChannelFit]
    changes: Changes
    total_mass: TotalMassReport
    findings: tuple[Finding, ...]
    uncertainty: ParameterUncertainty | None = None
    solved: bool = True
    violations: dict[str, float] = field(default_factory=dict)
    certificate: Certificate | None = None
    bounds: BoundsReport | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings, one sentence each."""
        return tuple(finding.text for finding in self.findings)

    @property
    def all_parameters(self) -> Array:
        """Inertial and drives' parameters, ``(n_params,)``, in the order of the problem's columns."""
        return np.concatenate([self.parameters, self.drives])

    @property
    def masses(self) -> Array:
        """Identified masses of the segments, ``(n_segments,)`` [kg]."""
        return self.parameters[::10].copy()

    def to_json(self) -> dict[str, Any]:
        """The document ``excite.identification/1``; what is infinite or not known is null."""
        return _finite(
            {
                "schema": SCHEMA,
                "robot": self.robot,
                "method": self.method,
                "status": self.status,
                "solved": self.solved,
                "violations": self.violations,
                "certificate": None if self.certificate is None else self.certificate.to_json(),
                "bounds": None if self.bounds is None else self.bounds.to_json(),
                "n_samples": self.n_samples,
                "standard_parameters": self._standard_parameters(),
                "drive_parameters": dict(zip(self.drive_names, self.drives.tolist(), strict=True)),
                "base_parameters": [asdict(item) for item in self.base],
                "n_structural_base_parameters": self.structural_rank,
                "essential": [asdict(item) for item in self.essential],
                "consistency": {
                    **asdict(self.consistency),
                    "inconsistent": list(self.consistency.inconsistent),
                },
                "fit": {name: asdict(item) for name, item in self.fit.items()},
                "validation": {name: asdict(item) for name, item in self.validation.items()},
                "changed_segments": [
                    {**asdict(item), "tied_with": list(item.tied_with)} for item in self.changes.segments
                ],
                "changes": {"explained": self.changes.explained, "dispersion": self.changes.dispersion},
                "total_mass": asdict(self.total_mass),
                "unmeasured": list(self.unmeasured),
                "warnings": list(self.warnings),
                "findings": [finding.to_json() for finding in self.findings],
            }
        )

    def _standard_parameters(self) -> dict:
        columns = {"": self.parameters, "nominal": self.nominal}
        if self.uncertainty is not None:
            n = len(self.parameters)
            columns |= {"std": self.uncertainty.std[:n], "determined": self.uncertainty.determined[:n]}
        ten = {key: values.reshape(-1, 10) for key, values in columns.items()}
        found = {}
        for k, (link, name) in enumerate(zip(self.links, self.segments, strict=True)):
            blocks = {key: _parameter_block(rows[k]) for key, rows in ten.items()}
            found[link] = {
                **blocks.pop(""),
                "nominal_mass": blocks["nominal"]["mass"],
                "name": name,
                **blocks,
            }
        return found

    def summary(self) -> str:
        """The result in words and a table, for a terminal."""
        lines = [
            f"{self.robot}, method {self.method}: {len(self.base)} base parameters"
            + (f" of {self.structural_rank}" if self.structural_rank is not None else "")
            + f" from {self.n_samples} samples",
            f"total mass {self.total_mass.identified:.3f} kg (nominal {self.total_mass.nominal:.3f} kg)",
        ]
        if not self.solved:
            lines.insert(0, f"NO SOLUTION, the best found follows: {self.status}")
        lines += self._promises()
        for title, fits in (("identification trials", self.fit), ("validation trials", self.validation)):
            if fits:
                lines += ["", *fit_table(title, fits)]
        lines += ["", *self._change_lines()]
        lines += [f"note: {text}" for text in self.warnings]
        return "\n".join(lines)

    def _promises(self) -> list[str]:
        """What is proven of the objective, and what became of stated bounds."""
        proven = [] if self.certificate is None else [f"certificate: {self.certificate.summary()}"]
        return proven + ([] if self.bounds is None else [self.bounds.summary()])

    def _change_lines(self) -> list[str]:
        if not self.changes.segments:
            return ["changed segments: none found"]
        return ["changed segments:"] + [
            f"  {item.segment}: {mass_change(item)}"
            + (f" (or {', '.join(item.tied_with)})" if item.tied_with else "")
            for item in self.changes.segments
        ]


def _parameter_block(row: Array) -> dict[str, Any]:
    return {
        "mass": float(row[0]),
        "first_moment": row[1:4].tolist(),
        "inertia": row[4:][list(FILE_ORDER)].tolist(),
    }


def _finite(value: Any) -> Any:
    """A copy in which numbers that JSON cannot hold are None."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
