"""How well parameters are known: base parameters, the essential ones of them, and all standard parameters."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import eigh, solve_triangular, svd

from excite.arrays import Array, Indices
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import prior_std
from excite.identification.statistics import BaseEstimate, BaseStatistics, relative_percent
from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.columns import DRIVE_TERMS
from excite.results import ADDED, Name, Stated, Unbounded, UnboundedPositive


@dataclass(frozen=True)
class BaseParameter(Stated):
    """A base parameter and how well it is known.

    Attributes:
        name: the parameter that stands for it, such as ``Izz(torso)``.
        expression: the whole combination in words.
        link: link of that parameter, None for a drive's.
        value: [SI].
        std: standard deviation [SI], valid for filtered and correlated noise.
        rsd_percent: ``100·std/|value|`` [percent]; null where the value is zero.
        half_width_95: half the width of the interval that holds the truth in 95 of 100 cases [SI], None where
            it was not asked for.
    """

    name: str = field(metadata=ADDED)
    expression: str
    link: Name | None = field(metadata=ADDED)
    value: Unbounded
    std: UnboundedPositive
    rsd_percent: UnboundedPositive
    half_width_95: UnboundedPositive | None = None


def base_parameter_table(
    problem: IdentificationProblem, statistics: BaseStatistics, parameters: Array
) -> tuple[BaseParameter, ...]:
    """Base parameters of an estimator's answer ``(n_params,)``.

    Args:
        statistics: least-squares base parameters of these rows, with the estimator's weights.
    """
    values, half = statistics.base.values(parameters), statistics.half_width()
    return _describe_parameters(
        problem, statistics, range(len(values)), values, statistics.std, half.tolist()
    )


def essential_parameter_table(
    problem: IdentificationProblem, statistics: BaseStatistics
) -> tuple[BaseParameter, ...]:
    """What :func:`essential_parameters` leaves of them."""
    found = essential_parameters(statistics)
    return _describe_parameters(
        problem, statistics, found.kept, found.values, found.std, [None] * len(found.kept)
    )


def _describe_parameters(
    problem: IdentificationProblem,
    statistics: BaseStatistics,
    places: Iterable[int],
    values: Array,
    std: Array,
    half_widths: list[float | None],
) -> tuple[BaseParameter, ...]:
    base, segments = statistics.base, problem.robot.segments
    figures = zip(values.tolist(), std.tolist(), relative_percent(std, values).tolist(), strict=True)
    return tuple(
        BaseParameter(
            base.names[column],
            base.expressions[place],
            segments[column // 10].link if column < problem.n_inertial else None,
            *row,
            half,
        )
        for place, column, row, half in zip(
            places, (int(base.independent[place]) for place in places), figures, half_widths, strict=True
        )
    )


def structural_rank(problem: IdentificationProblem, of_rows: int) -> int | None:
    """Base parameters that free motion would determine; None where rows and robot do not correspond.

    No fewer than the rows have, which take right angles as the model has typed them.
    """
    robot = problem.robot
    drives = tuple(
        dict.fromkeys(name.split(".")[0] for name in problem.parameter_names[problem.n_inertial :])
    )
    wrenches = robot.measures_contacts
    if (
        wrenches != (problem.channel_names[0] == "fx")
        or not set(drives) <= set(DRIVE_TERMS)
        or (not wrenches and len(problem.channel_names) < robot.n_joints)
    ):
        return None
    return max(of_rows, structural_base_parameters(robot, drives).rank)


# Essential parameters: base parameters without those that say nothing (Xu et al. 2020, end of II.A).

SHARE_BELOW = 0.01
"""Part of the measured channels below which a parameter may go: the figure of Xu et al. 2020, who mean SI values.

A value in SI units would keep other parameters of a robot of ten times the mass, or of another unit of length.
"""
RSD_ABOVE = 40.0


@dataclass(frozen=True, eq=False)
class EssentialParameters:
    """What is left of the base parameters after elimination.

    Attributes:
        kept: ``(n_essential,)`` indices of base parameters.
        removed: indices in the order of their removal.
        values: ``(n_essential,)`` re-estimated values [SI].
        std: ``(n_essential,)`` their standard deviations.
        factor: ``R`` of the rows on those kept, ``(n_essential, n_essential)``.
        rotated: ``(n_essential,)`` ``Qᵀ`` of the measurement.
        squares: sum of squares that they leave.
    """

    kept: Indices
    removed: tuple[int, ...]
    values: Array
    std: Array
    factor: Array
    rotated: Array
    squares: float


def essential_parameters(statistics: BaseEstimate) -> EssentialParameters:
    """Base parameters without those that add little to the channels and are poorly known.

    Little is ``‖column‖·|value|`` below :data:`SHARE_BELOW` of what all add to the weighted channels together (Xu et
    al. 2020: a value below 0.01).

    Args:
        statistics: least squares on base parameters.
    """
    # The value with which a parameter alone would make all of the signal.
    lengths = np.maximum(np.linalg.norm(statistics.factor, axis=0), np.finfo(float).tiny)
    least = SHARE_BELOW * np.linalg.norm(statistics.rotated) / lengths
    return eliminate_parameters(statistics.factor, statistics.rotated, least, statistics.meat)


def eliminate_parameters(
    factor: Array, rotated: Array, least: Array, meat: Array, squares: float = 0.0, n_rows: int = 0
) -> EssentialParameters:
    """Remove, one at a time and re-estimating, the worst of the small and poorly determined parameters.

    A parameter is a candidate while its value is small and its RSD above 40 percent (Xu et al. 2020, end of II.A); of
    the candidates the one of greatest RSD goes.

    Args:
        factor: ``R`` of the rows, ``(n_base, n_base)``.
        rotated: ``Qᵀ`` of the measurement, ``(n_base,)``.
        least: ``(n_base,)`` below which each value is small.
        meat: middle of the sandwich covariance, ``(n_base, n_base)``; of white noise the identity (eq. 7).
        squares: sum of squares that all parameters leave.
        n_rows: number of rows with white noise, whose variance follows from ``squares``; 0 where ``meat`` has it.
    """
    kept = np.arange(len(rotated))
    removed: list[int] = []
    while True:
        values = solve_triangular(factor, rotated)
        inverse = solve_triangular(factor, np.eye(len(kept)))
        variance = squares / max(n_rows - len(kept), 1) if n_rows else 1.0
        std = np.sqrt(variance * np.einsum("ij,jk,ik->i", inverse, meat, inverse, optimize=True))
        rsd = relative_percent(std, values)
        candidates = (np.abs(values) < least[kept]) & (rsd > RSD_ABOVE)
        if not candidates.any() or len(kept) == 1:
            return EssentialParameters(kept, tuple(removed), values, std, factor, rotated, squares)
        worst = int(np.argmax(np.where(candidates, rsd, -1.0)))
        removed.append(int(kept[worst]))
        kept = np.delete(kept, worst)
        rotation, factor = np.linalg.qr(np.delete(factor, worst, axis=1), mode="complete")
        rotated, factor = rotation.T @ rotated, factor[:-1]
        squares, rotated = squares + float(rotated[-1]) ** 2, rotated[:-1]
        meat = (rotation.T @ meat @ rotation)[:-1, :-1]


# How well each standard parameter is known from the data and the nominal model together.


@dataclass(frozen=True, eq=False)
class ParameterUncertainty:
    """How well the standard parameters are known.

    Attributes:
        std: of each parameter, given the data and the spread that the nominal model is granted [SI].
        determined: share of that spread's variance that the data have taken away, 0 to 1: near 0 the value is
            the nominal model's and the constraints' choice, near 1 it was measured.
        covariance: ``(n_params, n_params)`` whose diagonal is ``std`` squared; None where only that is known.
    """

    std: Array
    determined: Array
    covariance: Array | None = None


def parameter_uncertainty(
    problem: IdentificationProblem, statistics: BaseStatistics, spread: Array
) -> ParameterUncertainty:
    """Posterior of the standard parameters of a Gaussian prior about the nominal model.

    With ``P`` the prior's covariance, ``K`` the base parameters as combinations of the standard ones and
    ``R⁻¹ M R⁻ᵀ`` their covariance, ``P − P Kᵀ (K P Kᵀ + R⁻¹ M R⁻ᵀ)⁻¹ K P``. It is computed as
    ``P − P Kᵀ Rᵀ (R K P Kᵀ Rᵀ + M)⁻¹ R K P``: the inverse of ``R`` has no digits left of directions that the motions
    hardly show. Directions outside ``K`` no motion shows: there the prior stays. Inequalities (positive masses,
    physical consistency) are not used and could only narrow it.

    Args:
        statistics: base parameters and their covariance.
        spread: spread of each segment's mass about nominal as share of it, ``(n_segments,)``, as
            :func:`~excite.identification.regression.prior_std` takes it.

    Returns:
        Standard deviations, shares and covariance.
    """
    prior = prior_std(problem, spread)
    power, axes = eigh(statistics.meat)
    # What noise has rounded away is as small as the rounding of the largest.
    power = np.maximum(power, max(np.finfo(float).eps * power[-1], np.finfo(float).tiny))
    shown = axes.T @ (statistics.factor @ (statistics.base.matrix * prior)) / np.sqrt(power)[:, None]
    _, sizes, directions = svd(shown, full_matrices=False)
    share = sizes**2 / (1.0 + sizes**2)
    determined = np.clip(share @ directions**2, 0.0, 1.0)
    left = np.eye(len(prior)) - (directions.T * share) @ directions
    covariance = left * np.outer(prior, prior)
    return ParameterUncertainty(prior * np.sqrt(1.0 - determined), determined, covariance)
