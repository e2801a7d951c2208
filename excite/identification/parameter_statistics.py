"""How well parameters are known: base parameters with their standard deviations, and all others."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.identification.judgement.essential import essential_parameters
from excite.identification.judgement.uncertainty import ParameterUncertainty, parameter_uncertainty
from excite.identification.problem import IdentificationProblem
from excite.identification.statistics import BaseStatistics
from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.columns import DRIVE_TERMS
from excite.results import ADDED, Name, Stated, Unbounded, UnboundedPositive, plain


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


@dataclass(frozen=True, eq=False)
class ParameterStatistics:
    """How well the parameters are known.

    Attributes:
        base: base parameters.
        structural_rank: number of base parameters that free motion would determine; None if not known.
        essential: base parameters that are left after the negligible ones were removed, re-estimated.
        uncertainty: of all parameters from data and nominal model together; None where it was not computed.
    """

    base: tuple[BaseParameter, ...]
    structural_rank: int | None
    essential: tuple[BaseParameter, ...]
    uncertainty: ParameterUncertainty | None

    def to_json(self) -> dict[str, Any]:
        """Its blocks of the document; the uncertainty stands beside the parameters there."""
        return {
            "base_parameters": plain(self.base),
            "n_structural_base_parameters": self.structural_rank,
            "essential": plain(self.essential),
        }


def parameter_statistics(
    problem: IdentificationProblem, parameters: Array, statistics: BaseStatistics, spreads: Array
) -> ParameterStatistics:
    """Statistics of an estimator's answer.

    Args:
        problem: the rows.
        parameters: the answer, ``(n_params,)``.
        statistics: least-squares base parameters of these rows, with the estimator's weights.
        spreads: expected spread of each segment's mass about nominal, as share of it, ``(n_segments,)``.
    """
    values = statistics.base.values(parameters)
    essential = essential_parameters(statistics)
    return ParameterStatistics(
        base=_base_parameters(problem, statistics, values, statistics.std, range(len(values))),
        structural_rank=_structural_rank(problem, statistics.base.rank),
        essential=_base_parameters(problem, statistics, essential.values, essential.std, essential.kept),
        uncertainty=parameter_uncertainty(problem, statistics, spreads),
    )


def _base_parameters(
    problem: IdentificationProblem,
    statistics: BaseStatistics,
    values: Array,
    std: Array,
    indices: Iterable[int],
) -> tuple[BaseParameter, ...]:
    whole = len(values) == len(statistics.std)
    rsd = statistics.rsd_percent(values) if whole else None
    half = statistics.half_width() if whole else None
    found = []
    for place, index in enumerate(indices):
        column = int(statistics.base.independent[index])
        inertial = column < problem.n_inertial
        size = abs(float(values[place]))
        percent = rsd[place] if rsd is not None else (100.0 * std[place] / size if size > 0.0 else np.inf)
        found.append(
            BaseParameter(
                name=statistics.base.names[column],
                expression=statistics.base.expressions[index],
                link=problem.robot.segments[column // 10].link if inertial else None,
                value=float(values[place]),
                std=float(std[place]),
                rsd_percent=float(percent),
                half_width_95=None if half is None else float(half[place]),
            )
        )
    return tuple(found)


def _structural_rank(problem: IdentificationProblem, of_rows: int) -> int | None:
    """Base parameters that free motion would determine; None where rows and robot do not correspond.

    No fewer than the rows have, which take right angles as the model has typed them.
    """
    drives = dict.fromkeys(name.split(".")[0] for name in problem.parameter_names[problem.n_inertial :])
    if problem.robot.measures_contacts != (problem.channel_names[0] == "fx") or not drives.keys() <= set(
        DRIVE_TERMS
    ):
        return None
    if not problem.robot.measures_contacts and len(problem.channel_names) < problem.robot.n_joints:
        return None
    return max(of_rows, structural_base_parameters(problem.robot, tuple(drives)).rank)
