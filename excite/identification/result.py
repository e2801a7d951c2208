"""What an identification says: parameters with their precision, fit and warnings, as a document and in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Self

import numpy as np

from excite.arrays import Array
from excite.display import Row, Tabled, count
from excite.finding import Finding, list_names
from excite.identification.changed_segments import ChangedSegment, Changes
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.inertia import FILE_ORDER
from excite.identification.judgement.judgement import ChannelFit, Consistency, TotalMassReport
from excite.identification.parameter_statistics import BaseParameter, ParameterUncertainty
from excite.identification.physical.bounds import BoundsReport
from excite.identification.physical.retrieval import Certificate
from excite.identification.sessions.compare import Sessions
from excite.regressor.columns import PARAMETERS
from excite.results import (
    ADDED,
    FEW,
    HIDDEN,
    LEFT_OUT,
    FilePath,
    Name,
    Stated,
    Unbounded,
    UnboundedPositive,
    added_as,
    named,
    stated,
    stated_with,
)

# Links are no longer: a centre of mass that is known no better than this is anywhere in one [m].
_WITHIN_M = 1.0

Vector3 = tuple[Unbounded, Unbounded, Unbounded]
Vector6 = tuple[Unbounded, Unbounded, Unbounded, Unbounded, Unbounded, Unbounded]


@dataclass(frozen=True)
class Inertial(Stated):
    """Ten inertial parameters, or something said of each of them, about the joint frame's origin.

    Attributes:
        mass: [kg].
        first_moment: mass times centre of mass [kg·m].
        inertia: Ixx, Iyy, Izz, Ixy, Ixz, Iyz [kg·m²].
    """

    mass: Unbounded | None = None
    first_moment: Vector3 | None = None
    inertia: Vector6 | None = None

    @classmethod
    def of(cls, ten: Array, **more: Any) -> Self:
        """The block of ``(10,)`` values in pinocchio's order, with what else its class holds."""
        return cls(float(ten[0]), tuple(ten[1:4].tolist()), tuple(ten[4:][list(FILE_ORDER)].tolist()), **more)


@dataclass(frozen=True)
class SegmentParameters(Inertial):
    """Identified parameters of a segment, and what belongs to them.

    Attributes:
        name: readable name of the segment.
        nominal_mass: mass in the model [kg].
        nominal: parameters of the model.
        std: standard deviations, same units.
        determined: share of the model's uncertainty that the data took away, 0 to 1.
    """

    mass: Unbounded
    first_moment: Vector3
    inertia: Vector6
    name: Name | None = None
    nominal_mass: Unbounded | None = None
    nominal: Inertial | None = None
    std: Inertial | None = field(default=None, metadata=LEFT_OUT)
    determined: Inertial | None = field(default=None, metadata=LEFT_OUT)


@dataclass(frozen=True)
class TorqueDelay(Stated):
    """How late torques were logged.

    Attributes:
        value_s: delay against the positions [s].
        std_s: its standard deviation [s].
    """

    value_s: Unbounded
    std_s: UnboundedPositive | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Tabled, Stated):
    """Identified parameters, their quality, and how well they predict.

    Attributes:
        robot: name of the robot.
        method: registry name of the estimator.
        n_samples: number of instants that were used.
        identified: parameters of bodies and drives, beside the nominal ones.
        base: base parameters with their standard deviations.
        structural_rank: number that free motion would determine; null where it is not known.
        essential: base parameters left after the negligible ones were removed, re-estimated.
        uncertainty: of all parameters, from data and nominal model together; None where it was not computed.
        consistency: physical consistency of the parameters.
        fit: by channel, on the trials that were identified from.
        validation: by channel, on the trials that were not; empty where there are none.
        changes: segments that are not what the model says, and what else explains the rows.
        total_mass: the total mass from all sides.
        status: advice on how the solve ended.
        solved: whether the estimator's answer passed its recomputation; what did not is no result.
        violations: largest violation of each kind of constraint, recomputed; in the estimator's units.
        certificate: what is proven of the method's objective, null where it is convex.
        held_mass: that was imposed on the sum of all masses [kg], None where it was free.
        bounds: stated bounds against the parameters, null where none were stated.
        findings: what a careful reader should know, with figures.
        sessions: null where no sessions were pooled.
        torque_delay: null where it was not looked for.
        robot_file: robot.yaml or model of a robot of one's own, relative to this document's folder.
        log_file: the log, or the first of several, relative to this document's folder.
    """

    SCHEMA = "excite.identification/1"

    robot: Name
    method: Name
    n_samples: int
    identified: IdentifiedParameters = field(metadata=HIDDEN)
    base: tuple[BaseParameter, ...] = field(metadata=named("base_parameters"))
    structural_rank: int | None = field(metadata=named("n_structural_base_parameters") | ADDED)
    essential: tuple[BaseParameter, ...] = field(metadata=HIDDEN)
    uncertainty: ParameterUncertainty | None = field(metadata=HIDDEN)
    consistency: Consistency
    fit: Mapping[Name, ChannelFit]
    validation: Mapping[Name, ChannelFit]
    changes: Changes = field(metadata=added_as(None))
    total_mass: TotalMassReport = field(metadata=ADDED)
    status: str = field(metadata=ADDED)
    solved: bool = True
    violations: Mapping[Name, UnboundedPositive] = field(default_factory=dict)
    certificate: Certificate | None = None
    held_mass: float | None = field(default=None, metadata=HIDDEN)
    bounds: BoundsReport | None = None
    findings: tuple[Finding, ...] = ()
    sessions: Sessions | None = field(default=None, metadata=LEFT_OUT)
    torque_delay: TorqueDelay | None = field(default=None, metadata=LEFT_OUT)
    robot_file: FilePath | None = field(default=None, metadata=LEFT_OUT)
    log_file: FilePath | None = field(default=None, metadata=LEFT_OUT)

    tables = ("parameters", "base", "essential", "drives", "fit", "validation")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`.

        Inertial parameters of all links beside the model's (about joint frames, SI), base or essential parameters,
        parameters of drives, or how well channels are predicted on trials of either kind.
        """
        if table == "parameters":
            return self._parameter_rows()
        if table == "drives":
            return [{"parameter": name, "value": v} for name, v in self.drive_parameters.items()]
        if table in ("base", "essential"):
            return [one.row() for one in (self.base if table == "base" else self.essential)]
        fits = self.fit if table == "fit" else self.validation
        return [one.row(channel=name) for name, one in fits.items()]

    def _parameter_rows(self) -> list[Row]:
        """A row for each parameter of each link; ``std`` is None where not known."""
        known = self.uncertainty
        return [
            {
                "link": self.links[k // 10],
                "parameter": PARAMETERS[k % 10],
                "nominal": float(self.nominal[k]),
                "value": float(value),
                "std": None if known is None else float(known.std[k]),
                "determined": None if known is None else float(known.determined[k]),
            }
            for k, value in enumerate(self.parameters)
        ]

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
    @stated
    def standard_parameters(self) -> Annotated[Mapping[Name, SegmentParameters], FEW]:
        """By link."""
        columns = {"nominal": self.nominal}
        if self.uncertainty is not None:
            n = len(self.nominal)
            columns |= {"std": self.uncertainty.std[:n], "determined": self.uncertainty.determined[:n]}
        ten = {key: values.reshape(-1, 10) for key, values in columns.items()}
        return {
            link: SegmentParameters.of(
                self.parameters[10 * k : 10 * k + 10],
                name=self.identified.segments[k],
                nominal_mass=float(self.nominal[10 * k]),
                **{key: Inertial.of(rows[k]) for key, rows in ten.items()},
            )
            for k, link in enumerate(self.links)
        }

    @property
    @stated_with(stated="essential")
    def _essential_or_names(self) -> tuple[BaseParameter | str, ...]:
        """Base parameters left after the negligible ones were removed, or their names."""
        return self.essential

    @property
    @stated_with(added={})
    def drive_parameters(self) -> Mapping[Name, Unbounded]:
        """Parameters of the drives by name [SI]."""
        return self.identified.by_drive()

    @property
    @stated_with(added=())
    def changed_segments(self) -> tuple[ChangedSegment, ...]:
        """Segments that are not what the model says."""
        return self.changes.segments

    @property
    @stated_with(added=())
    def unmeasured(self) -> tuple[Name, ...]:
        """Links that the sensors do not see."""
        return self.identified.unmeasured

    @property
    @stated
    def warnings(self) -> tuple[str, ...]:
        """What a careful reader should know, one sentence each."""
        return tuple(finding.text for finding in self.findings)

    def _has(self, *kinds: str) -> list[Finding]:
        return [found for found in self.findings if found.kind in kinds]

    @property
    def impossible_changes(self) -> frozenset[str]:
        """Links named as changed whose change no body can have: something else is wrong there."""
        return frozenset(link for found in self._has("weightless", "overweight") for link in found.places)

    @property
    def in_unknown_unit(self) -> bool:
        """Whether the torques of all joints are in a unit that is not known, and with them every parameter."""
        return any(
            len(found.places) == len(self.fit) and not found.repaired for found in self._has("torque_scale")
        )

    def summary(self) -> str:
        """The result in words and a table, for a terminal."""
        of_rank = "" if self.structural_rank is None else f" of {self.structural_rank}"
        mass, weightless = self.total_mass, self.in_unknown_unit
        lines = [] if self.solved else [f"NO SOLUTION, the best found follows: {self.status}"]
        lines += [
            f"{self.robot}, method {self.method}: {count(len(self.base), 'base parameter')}{of_rank} "
            f"from {self.n_samples} samples",
            f"total mass {mass.identified:.3f} kg (nominal {mass.nominal:.3f} kg{self._mass_held()})"
            + (", which is no weight: the torques are not N·m" if weightless else ""),
        ]
        lines += [] if self.certificate is None else [f"certificate: {self.certificate.summary()}"]
        lines += [] if self.bounds is None else [self.bounds.summary()]
        for title, fits in (("identification trials", self.fit), ("validation trials", self.validation)):
            lines += ["", *fit_table(title, fits)] if fits else []
        changes = "changed segments: not asked of torques in an unknown unit"
        lines += ["", *([changes] if weightless else self._change_lines())]
        return "\n".join([*lines, *(f"note: {text}" for text in self.warnings)])

    def _mass_held(self) -> str:
        """Whether the total mass was imposed, and why not."""
        mass = self.total_mass
        if self.held_mass is not None:
            return f"; held at what was {'measured' if mass.weighed is None else 'weighed'}"
        told = mass.weighed is not None or mass.measured is not None
        return "; not held" if told else "; not held: this record does not tell it"

    def _change_lines(self) -> list[str]:
        beside = [f"{item.name} {item.value:+.3g} ± {item.std:.2g}" for item in self.changes.beside]
        torques = [f"  beside them, factors and zeros of torques: {list_names(beside, 5)}"] if beside else []
        if not self.changes.segments:
            said = "none found that stands out; all parameters are estimated anew"
            return [
                f"changed segments: {'not looked for' if self._has('too_few_instants') else said}",
                *torques,
            ]
        lines = ["changed segments:"]
        for item in self.changes.segments:
            ties = (*item.tied_with, *item.tied_terms)
            others = f" (or {', '.join(ties)})" if ties else ""
            doubt = "; no body can have it: no such change" if item.link in self.impossible_changes else ""
            lines.append(f"  {item.segment}: {mass_change(item)}{others}{doubt}")
        last = "  (the fewest that explain what the nominal model leaves; sizes hold if nothing else differs)"
        return [*lines, *torques, last]


def mass_change(item: ChangedSegment) -> str:
    """The change of mass, or that the rows say nothing of it: an arm's masses show only in combinations."""
    if item.std_kg > max(abs(item.mass_change_kg), 1.0):
        return "first moments or inertia; its mass alone is not determined"
    mass = f"{item.mass_change_kg:+.3f} ± {item.std_kg:.2g} kg"
    if item.centre_m is None or item.centre_std_m is None:
        return mass
    # Along axes that are all parallel nothing is felt of a centre of mass.
    stds = np.array(item.centre_std_m)
    shown = stds < _WITHIN_M
    if not shown.any():
        return f"{mass}; where is not determined"
    centre = ", ".join(f"{x:.3f}" if s else "–" for x, s in zip(item.centre_m, shown, strict=True))
    hidden = "" if shown.all() else " (– is not determined)"
    return f"{mass} at ({centre}) ± {stds[shown].max():.2g} m from its joint{hidden}"


def fit_table(title: str, fits: Mapping[str, ChannelFit]) -> list[str]:
    """Lines with how well each channel is explained, by the identified model and by the nominal one."""
    width = max(len(name) for name in [*fits, "channel"])
    lines = [f"{title}, RMSE (correlation):", f"  {'channel':{width}}  {'identified':>20}  {'nominal':>20}"]
    for name, fit in fits.items():
        pairs = ((fit.rmse, fit.cc), (fit.reference_rmse, fit.reference_cc))
        said = [f"{rmse:.3f} {fit.unit} ({'–' if cc is None else f'{cc:.3f}'})" for rmse, cc in pairs]
        lines.append(f"  {name:{width}}" + "".join(f"  {one:>20}" for one in said))
    return lines
