"""What the parameters are worth: bodies that can exist, predictions, total mass."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from excite.arrays import Array
from excite.display import percent, span
from excite.identification.constraints.linear import measured_total_mass
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.inertia import (
    ROUNDING,
    are_no_bodies,
    central_inertia_matrices,
    inertia_matrices,
    pseudo_inertia_matrices,
)
from excite.identification.noise import NoiseModel
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression
from excite.logs.columns import WRENCH_AXES
from excite.results import ADDED, Name, Positive, Seconds, Stated, Unbounded, UnboundedPositive, named, stated

# Whether identified parameters are those of bodies that can exist.


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
    return Consistency(
        mass_positive=bool((masses > 0.0).all()),
        inertia_positive_definite=bool((inertia[:, 0] > 0.0).all()),
        triangle_inequality=bool(known.all() and (slack >= -ROUNDING * principal[:, 2]).all()),
        pseudo_inertia_min_eigenvalue=float(pseudo[:, 0].min()),
        inconsistent=tuple(name for name, flag in zip(names, are_no_bodies(parameters), strict=True) if flag),
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
        rmse=float(np.sqrt(np.mean((measured - predicted) ** 2))),
        cc=correlate_signals(measured, predicted),
        reference_rmse=float(np.sqrt(np.mean((measured - nominal) ** 2))),
        reference_cc=correlate_signals(measured, nominal),
        std=float(measured.std()),
    )


def correlate_signals(a: Array, b: Array) -> float | None:
    """Pearson's correlation coefficient of two signals ``(n,)``, None where one of them does not vary."""
    da, db = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((da @ da) * (db @ db)))
    floor = 1e-12 * len(a) * max(float(np.abs(a).max()), 1e-30) * max(float(np.abs(b).max()), 1e-30)
    return None if scale <= floor else float(np.clip(da @ db / scale, -1.0, 1.0))


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


def mass_report(
    rows: Regression, noise: NoiseModel, settings: EstimatorSettings, identified: IdentifiedParameters
) -> TotalMassReport:
    """The total mass from all sides.

    Args:
        rows: condensed and weighted rows, of which those of the forces tell the mass.
        settings: hold what the scale said.
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


@dataclass(frozen=True)
class Forecast(Stated):
    """What is to be expected of a target before anything is measured.

    Standard deviations fall with the square root of the amount of motion, so that ``(rsd / target)²`` times the
    motion at hand is needed where it is more of the same kind. Motion that aims at single joints takes less.

    Attributes:
        target_rsd: relative standard deviation to reach [percent].
        seconds: motion at hand [s].
        needed_s: motion with which each essential parameter reaches the target, by its name [s].
    """

    target_rsd: Positive = field(metadata=named("target_rsd_percent"))
    seconds: Seconds
    needed_s: Mapping[str, Positive]

    @classmethod
    def of(cls, rsd_percent: Mapping[str, float], target_rsd: float, seconds: float) -> Forecast:
        """The forecast of predicted relative standard deviations [percent], by essential parameter."""
        needed = {name: seconds * (rsd / target_rsd) ** 2 for name, rsd in rsd_percent.items()}
        return cls(target_rsd, seconds, needed)

    @property
    @stated
    def within(self) -> int:
        """Number of parameters that are expected to reach the target with the motion at hand."""
        return sum(needed <= self.seconds for needed in self.needed_s.values())

    @property
    @stated
    def essential(self) -> int:
        """Number of parameters expected to be essential."""
        return len(self.needed_s)

    def summary(self) -> str:
        """One line for a person."""
        within = f"{self.within} of {self.essential} essential parameters within {self.target_rsd:g} %"
        return f"to be expected of {self.seconds:.0f} s: {within}{self.longer()}"

    def longer(self) -> str:
        """How much motion the others take, to follow a sentence; as far as anybody would have the patience for it."""
        later = [needed for needed in self.needed_s.values() if needed > self.seconds]
        near = [needed for needed in later if needed <= PATIENCE * self.seconds]
        said = ""
        if near:
            least, most = f"{min(near):.0f} s", f"{max(near):.0f} s"
            said += f"; {len(near)} more would take motion like this for {span(least, most, ' to ')} in all"
        if len(later) > len(near):
            said += f"; {len(later) - len(near)} would take more than {PATIENCE:g} times as much"
        return said


@dataclass(frozen=True)
class ParameterOutlook(Stated):
    """What is to be expected of one base parameter.

    Attributes:
        name: of its own column.
        expression: the whole combination.
        excitable: whether any motion can show it, within joint limits and with a foot on the ground.
        excited: whether the motions at hand do.
        value: in the model [SI].
        rsd_percent: predicted relative standard deviation; None where it is not excited, or is zero.
        essential: whether identification is expected to keep it.
    """

    name: str
    expression: str
    excitable: bool
    excited: bool
    value: Unbounded
    rsd_percent: Positive | None = field(metadata=named("predicted_rsd_percent"))
    essential: bool
