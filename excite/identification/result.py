"""What an identification says: parameters with their precision, fit and warnings, as a document and in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Self

import numpy as np
from scipy.linalg import eigh

from excite.arrays import Array
from excite.display import Row, Tabled, count
from excite.finding import Finding, list_names
from excite.identification.changed_segments import ChangedSegment, Changes
from excite.identification.estimators.estimator import Estimate
from excite.identification.estimators.registry import DEFAULT_METHOD
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.inertia import FILE_ORDER
from excite.identification.judgement import POOR_RSD, ChannelFit, Consistency, TotalMassReport
from excite.identification.parameter_statistics import BaseParameter, ParameterUncertainty
from excite.identification.physical.bounds import BoundsReport
from excite.identification.physical.retrieval import Certificate
from excite.identification.regression import prior_std
from excite.identification.sessions import Sessions
from excite.identification.statistics import BaseStatistics
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
    robot_file: FilePath | None = field(default=None, metadata=LEFT_OUT)
    log_file: FilePath | None = field(default=None, metadata=LEFT_OUT)

    tables = ("parameters", "base", "essential", "drives", "fit", "validation")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`.

        Inertial parameters of all links beside the model's (about joint frames, SI), base or essential parameters,
        parameters of drives, or how well channels are predicted on trials of either kind.
        """
        if table == "parameters":
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
        if table == "drives":
            return [{"parameter": name, "value": v} for name, v in self.drive_parameters.items()]
        if table in ("base", "essential"):
            return [one.row() for one in (self.base if table == "base" else self.essential)]
        fits = self.fit if table == "fit" else self.validation
        return [one.row(channel=name) for name, one in fits.items()]

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

    def _findings_of(self, *kinds: str) -> list[Finding]:
        return [found for found in self.findings if found.kind in kinds]

    @property
    def impossible_changes(self) -> frozenset[str]:
        """Links named as changed whose change no body can have: something else is wrong there."""
        return frozenset(
            link for found in self._findings_of("weightless", "overweight") for link in found.places
        )

    @property
    def in_unknown_unit(self) -> bool:
        """Whether the torques of all joints are in a unit that is not known, and with them every parameter."""
        return any(
            len(found.places) == len(self.fit) and not found.repaired
            for found in self._findings_of("torque_scale")
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
        torques = [f"  beside them, torques and drives: {list_names(beside, 5)}"] if beside else []
        if not self.changes.segments:
            said = "none found that stands out; all parameters are estimated anew"
            return [
                f"changed segments: {'not looked for' if self._findings_of('too_few_instants') else said}",
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


# What a careful reader should know: of data, solution and validation, and doubts of the estimate.

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
        statistics: least-squares base parameters of the same rows and weights.
        spread: expected spread of each segment's mass about nominal, as share of it, ``(n_segments,)``.
    """
    return (
        *_unexcited_directions(estimate, statistics, spread),
        *_find_conflict(estimate, statistics),
        *_constraints_reached(estimate.active),
    )


def _unexcited_directions(estimate: Estimate, statistics: BaseStatistics, spread: Array) -> Iterator[Finding]:
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


def _find_conflict(estimate: Estimate, statistics: BaseStatistics) -> Iterator[Finding]:
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
    yield from _impossible_changes(result)
    dispersion = result.changes.dispersion
    if result.changes.segments and dispersion > _LARGE_DISPERSION:
        text = (
            "the changed segments do not explain everything: what is left is "
            f"{dispersion:.0f} times the noise per base parameter"
        )
        yield Finding("unexplained", text, {"dispersion": dispersion})


def _impossible_changes(result: Identification) -> Iterator[Finding]:
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
