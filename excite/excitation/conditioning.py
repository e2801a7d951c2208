"""How well motions excite a robot's parameters: R factors and condition numbers of their regressors.

Columns are left in SI units, unscaled, as in the tables of Jovic et al. (2015): kg, kg·m and kg·m² count
alike. Condition numbers come from R factors and never from a Gram matrix, which would square them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.errors import InputError, MotionError
from excite.motion.motion import Motion
from excite.regressor.base_parameters import BaseParameters, base_parameters, structural_base_parameters
from excite.regressor.columns import Columns, measured_columns, regressor_rows
from excite.regressor.factor import r_factor
from excite.robot.robot import Array, Robot

# Singular values below this share of the largest are rounding: the regressor lacks rank there.
RANK_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class MotionFactor:
    """One R factor that stands for all regressor rows of one motion, or of several.

    Attributes:
        motions: names of the motions.
        columns: the regressor's columns.
        matrix: ``(k, n_columns)``, upper triangular, ``matrixᵀ matrix = Yᵀ Y``; k is at most n_columns [SI].
        n_rows: number of regressor rows.
        rate_hz: samples per second of motion.
        row_std: ``(r,)`` standard deviations that each sample's rows were divided by, None if by nothing.
    """

    motions: tuple[str, ...]
    columns: Columns
    matrix: Array
    n_rows: int
    rate_hz: float
    row_std: Array | None = None


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


@dataclass(frozen=True, eq=False)
class Conditioning:
    """How well a set of motions excites the base parameters.

    Attributes:
        full: condition number on the base columns, infinite where rank is lacking.
        log_det: log-determinant of the information matrix YᵀY on the base columns, 2 Σ log σ; -inf likewise.
        n_base_parameters: number of structural base parameters.
        rank: how many of them the motions excite, to rounding.
        segments: by segment that the sensors see and that has a parameter of its own.
        factor: stacked factor of the motions.
        base: the structural base parameters.
    """

    full: float
    log_det: float
    n_base_parameters: int
    rank: int
    segments: tuple[SegmentCondition, ...]
    factor: MotionFactor
    base: BaseParameters

    def to_json(self) -> Mapping[str, Any]:
        """The ``conditioning`` object of ``excite.plan/1``; infinite numbers become null."""
        return {
            "full": _finite(self.full),
            "log_det": _finite(self.log_det),
            "n_base_parameters": self.n_base_parameters,
            "rank": self.rank,
            "segments": [{"segment": s.segment, "condition": _finite(s.condition)} for s in self.segments],
        }

    def summary(self) -> str:
        """One line for a person."""
        worst = max(self.segments, key=lambda s: s.condition)
        return (
            f"rank {self.rank} of {self.n_base_parameters}, condition number {self.full:.3g}, "
            f"log-determinant {self.log_det:.4g}; worst segment {worst.segment} ({worst.condition:.3g})"
        )


def motion_factor(
    robot: Robot, motion: Motion, rate_hz: float = 50.0, *, row_std: Array | None = None
) -> MotionFactor:
    """R factor of a motion's regressor.

    A floating robot's rows are its base's wrench, without the columns of segments beyond its ankle sensors;
    an arm's rows are its joint torques, with a viscous and a Coulomb column a joint.

    Args:
        robot: the robot.
        motion: a motion of it.
        rate_hz: the motion is sampled anew at this rate.
        row_std: ``(r,)`` standard deviation of each of a sample's rows; the rows are divided by it. SI if
            None.

    Raises:
        MotionError: the motion's joints are not the robot's, or it holds NaN.
        InputError: bad rate or standard deviations.
    """
    if motion.joint_names != robot.joint_names or motion.floating != robot.floating:
        raise MotionError(
            "joints differ from the robot's", source=motion.name, remedy=f"is it for {robot.name!r}?"
        )
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(f"rate of {rate_hz} Hz", field="rate_hz", remedy="use a positive rate")
    if not all(np.isfinite(values).all() for values in (motion.q, motion.v, motion.a)):
        raise MotionError("holds NaN or infinity", source=motion.name)
    columns = measured_columns(robot)
    sampled = motion.resampled(robot, rate_hz)
    rows = regressor_rows(robot, columns, sampled.q, sampled.v, sampled.a)
    if row_std is not None:
        row_std = np.asarray(row_std, dtype=float)
        if row_std.shape != rows.shape[1:2] or not (np.isfinite(row_std) & (row_std > 0.0)).all():
            raise InputError(
                f"standard deviations {row_std}", field="row_std", remedy=f"{rows.shape[1]} positive ones"
            )
        rows /= row_std[:, None]
    rows = rows.reshape(-1, rows.shape[2])
    matrix = r_factor(rows)
    return MotionFactor((motion.name,), columns, matrix, len(rows), rate_hz, row_std)


def stack_factors(factors: Sequence[MotionFactor]) -> MotionFactor:
    """Factor of all rows of several factors: the QR of their stack.

    Raises:
        InputError: no factor, or factors of different robots, rates or weights.
    """
    if not factors:
        raise InputError("no motion to judge", remedy="hand over at least one")
    first = factors[0]
    for other in factors[1:]:
        same = other.columns.names == first.columns.names and other.rate_hz == first.rate_hz
        if not same or not np.array_equal(_weights(other), _weights(first)):
            raise InputError("factors of different robots, rates or weights", source=", ".join(other.motions))
    if len(factors) == 1:
        return first
    return MotionFactor(
        motions=tuple(name for factor in factors for name in factor.motions),
        columns=first.columns,
        matrix=r_factor(np.vstack([factor.matrix for factor in factors])),
        n_rows=sum(factor.n_rows for factor in factors),
        rate_hz=first.rate_hz,
        row_std=first.row_std,
    )


def conditioning(
    robot: Robot, factors: Sequence[MotionFactor], base: BaseParameters | None = None
) -> Conditioning:
    """Condition numbers of a set of motions, whole and by segment (Jovic et al. 2015, II.B, Table I).

    A segment's sub-regressor has the segment's ten columns, as in the paper; of columns that no motion of
    this robot could tell apart within the segment (an arm's first link has but a few that matter) the first
    independent ones, so that the number says what the motion lacks and not what the mechanism lacks.

    Args:
        robot: the robot.
        factors: of the motions.
        base: structural base parameters; computed if None.

    Raises:
        InputError: no factor, factors that do not fit together, or base parameters of other columns.
    """
    base = base if base is not None else structural_base_parameters(robot)
    factor = stack_factors(factors)
    values = base_singular_values(factor, base)
    rank = int((values > RANK_TOLERANCE * values[0]).sum())
    complete = rank == base.rank
    return Conditioning(
        full=float(values[0] / values[-1]) if complete else np.inf,
        log_det=float(2.0 * np.log(values).sum()) if complete else -np.inf,
        n_base_parameters=base.rank,
        rank=rank,
        segments=segment_conditions(factor, segment_columns(robot, factor.columns, base)),
        factor=factor,
        base=base,
    )


def base_singular_values(factor: MotionFactor, base: BaseParameters) -> Array:
    """Singular values of the base columns, ``(n_base,)``, falling, zeros where there are fewer rows.

    Raises:
        InputError: the base parameters are of other columns.
    """
    if base.names != factor.columns.names:
        raise InputError(
            "base parameters of other columns than the motion's", source=", ".join(factor.motions)
        )
    found = np.linalg.svd(factor.matrix[:, base.independent], compute_uv=False)
    return np.concatenate([found, np.zeros(base.rank - len(found))])


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
    factor: MotionFactor, columns: Mapping[str, NDArray[np.int64]]
) -> tuple[SegmentCondition, ...]:
    """Condition number of each segment's sub-regressor; ``columns`` are from :func:`segment_columns`."""
    conditions = []
    for name, used in columns.items():
        # The factor is triangular: below the segment's last column there is nothing.
        values = np.linalg.svd(r_factor(factor.matrix[: used[-1] + 1, used]), compute_uv=False)
        full_rank = len(values) == len(used) and values[-1] > RANK_TOLERANCE * values[0]
        condition = float(values[0] / values[-1]) if full_rank else np.inf
        conditions.append(SegmentCondition(name, condition, float(values[-1]), len(used)))
    return tuple(conditions)


def _weights(factor: MotionFactor) -> Array:
    return np.ones(1) if factor.row_std is None else factor.row_std


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
