"""Sub-regressors: the columns of one segment, and their condition number (Jovic et al. 2015, II.B)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError
from excite.regressor.base_parameters import BaseParameters, base_parameters
from excite.regressor.columns import Columns
from excite.regressor.factor import r_factor
from excite.robot.robot import Robot

# Singular values below this share of the largest are rounding: the regressor lacks rank there.
RANK_TOLERANCE = 1e-10


@dataclass(frozen=True)
class SegmentCondition:
    """Condition number of a segment's sub-regressor.

    Attributes:
        segment: name of the segment.
        condition: condition number, infinite where the motions lack rank.
        smallest: smallest singular value, by which motions of equal condition number are told apart.
        n_columns: number of the segment's structurally independent columns, ten at most.
    """

    segment: str
    condition: float
    smallest: float
    n_columns: int


def segment_columns(robot: Robot, columns: Columns, base: BaseParameters) -> dict[str, NDArray[np.int64]]:
    """Structurally independent columns of each segment, by name, for segments that have any.

    Raises:
        InputError: the base parameters are of other columns.
    """
    if base.names != columns.names:
        raise InputError("base parameters of other columns than the regressor's", source=robot.name)
    found = {}
    for index, segment in enumerate(robot.segments):
        own = columns.of_segment(index)
        if base.matrix[:, own].any():
            # Y = Y_base · matrix with Y_base of full rank: the matrix's columns depend as the regressor's do.
            within = base_parameters(base.matrix[:, own], [base.names[c] for c in own])
            found[segment.name] = own[within.independent]
    return found


def segment_conditions(
    matrix: Array, columns: Mapping[str, NDArray[np.int64]]
) -> tuple[SegmentCondition, ...]:
    """Condition number of each segment's sub-regressor.

    Args:
        matrix: ``(k, n_columns)`` triangular factor of the regressor [SI].
        columns: of each segment, from :func:`segment_columns`.
    """
    conditions = []
    for name, used in columns.items():
        # The factor is triangular: below the segment's last column there is nothing.
        values = np.linalg.svd(r_factor(matrix[: used[-1] + 1, used]), compute_uv=False)
        full_rank = len(values) == len(used) and values[-1] > RANK_TOLERANCE * values[0]
        condition = float(values[0] / values[-1]) if full_rank else np.inf
        conditions.append(SegmentCondition(name, condition, float(values[-1]), len(used)))
    return tuple(conditions)
