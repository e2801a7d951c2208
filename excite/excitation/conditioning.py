"""How well motions excite a robot's parameters: R factors and condition numbers of their regressors.

Columns are left in SI units, unscaled, as in the tables of Jovic et al. (2015): kg, kg·m and kg·m² count
alike. Condition numbers come from R factors and never from a Gram matrix, which would square them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from excite.arrays import Array, Indices
from excite.errors import InputError, MotionError, UnknownNameError
from excite.motion.motion import Motion, closed_contacts
from excite.regressor.base_parameters import (
    BaseParameters,
    base_parameters,
    r_factor,
    structural_base_parameters,
)
from excite.regressor.columns import Columns, measured_columns, regressor_rows
from excite.results import ADDED, HIDDEN, Name, Stated, Unbounded, UnboundedPositive
from excite.robot.robot import Robot

# Sub-regressors: the columns of one segment, and their condition number (Jovic et al. 2015, II.B).

# Singular values below this share of the largest are rounding: the regressor lacks rank there.
RANK_TOLERANCE = 1e-10


@dataclass(frozen=True)
class SegmentCondition(Stated):
    """Condition number of a segment's sub-regressor.

    Attributes:
        segment: name of the segment.
        condition: condition number of the segment's columns [no unit]; null where it is infinite, for lack of rank.
        smallest: smallest singular value, by which motions of equal condition number are told apart.
        n_columns: number of the segment's structurally independent columns, ten at most.
    """

    segment: Name
    condition: UnboundedPositive
    smallest: float = field(default=0.0, metadata=HIDDEN)
    n_columns: int = field(default=0, metadata=HIDDEN)


def segment_columns(robot: Robot, columns: Columns, base: BaseParameters) -> dict[str, Indices]:
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


def segment_conditions(matrix: Array, columns: Mapping[str, Indices]) -> tuple[SegmentCondition, ...]:
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


# Factors that are stacked before they are made one.
_STACKED = 40
# Rows that become part of a factor at a time: a few megabytes stay in the processor's cache.
_BLOCK_BYTES = 4e6


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


@dataclass(frozen=True, eq=False)
class ConditionNumbers(Stated):
    """How well motions excite the base parameters.

    Attributes:
        full: condition number of the base columns [no unit]; null where it is infinite, for lack of rank.
        log_det: log-determinant of the information matrix YᵀY on the base columns, 2 Σ log σ; null likewise.
        n_base_parameters: number of structural base parameters.
        rank: number of base parameters that are excited, to rounding.
        segments: by segment that the sensors see and that has a parameter of its own.
    """

    full: UnboundedPositive
    log_det: Unbounded
    n_base_parameters: int
    rank: int = field(metadata=ADDED)
    segments: tuple[SegmentCondition, ...]

    def summary(self) -> str:
        """One line for a person."""
        worst = max(self.segments, key=lambda s: s.condition)
        return (
            f"rank {self.rank} of {self.n_base_parameters}, condition number {self.full:.3g}, "
            f"log-determinant {self.log_det:.4g}; worst segment {worst.segment} ({worst.condition:.3g})"
        )


@dataclass(frozen=True, eq=False)
class Conditioning(ConditionNumbers):
    """The same with what it was computed from.

    Attributes:
        factor: stacked factor of the motions.
        base: the structural base parameters.
    """

    factor: MotionFactor = field(metadata=HIDDEN)
    base: BaseParameters = field(metadata=HIDDEN)


def motion_factor(
    robot: Robot,
    motion: Motion,
    rate_hz: float = 50.0,
    *,
    row_std: Array | None = None,
    base: BaseParameters | None = None,
) -> MotionFactor:
    """R factor of a motion's regressor.

    Rows of a robot on wrench sensors are its base's wrench, without the columns of segments beyond its ankle sensors;
    any other's are its joint torques, with a viscous and a Coulomb column a joint.

    Args:
        robot: the robot.
        motion: a motion of it.
        rate_hz: the motion is sampled anew at this rate.
        row_std: ``(r,)`` standard deviation of each of a sample's rows; the rows are divided by it. SI if
            None.
        base: structural base parameters, for a robot that has them at hand: the same factor to rounding, in half the
            time.

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
    closed = closed_contacts(robot, sampled)
    # Base parameters hold along motions with one foot in the air at most, with which they were found.
    held = bool((closed.sum(axis=1) >= closed.shape[1] - 1).all())
    reduced = base if base is not None and held and base.names == columns.names else None
    used = columns if reduced is None else columns.only(reduced.independent)
    std = None if row_std is None else _checked_std(row_std, robot.n_equations)
    block = max(1, int(_BLOCK_BYTES / (8 * robot.n_equations * len(used.names))))
    matrix = np.zeros((0, len(used.names)))
    for start in range(0, sampled.n_samples, block):
        part = slice(start, start + block)
        rows = regressor_rows(robot, used, sampled.q[part], sampled.v[part], sampled.a[part], closed[part])
        if std is not None:
            rows /= std[:, None]
        matrix = r_factor(np.vstack([matrix, rows.reshape(-1, rows.shape[2])]))
    if reduced is not None:
        matrix = matrix @ reduced.matrix
    n_rows = sampled.n_samples * robot.n_equations
    return MotionFactor((motion.name,), columns, matrix, n_rows, rate_hz, std)


def _checked_std(row_std: Array, count: int) -> Array:
    std = np.asarray(row_std, dtype=float)
    if std.shape != (count,) or not (np.isfinite(std) & (std > 0.0)).all():
        raise InputError(f"standard deviations {row_std}", field="row_std", remedy=f"{count} positive ones")
    return std


def stack_factors(factors: Sequence[MotionFactor]) -> MotionFactor:
    """Factor of all rows of several factors: the QR of their stack.

    Each factor is looked at once, so that a sequence which reads them from disk need not hold them all.

    Raises:
        InputError: no factor, or factors of different robots, rates or weights.
    """
    if not factors:
        raise InputError("no motion to judge", remedy="hand over at least one")
    first, names, n_rows = factors[0], list[str](), 0
    parts: list[Array] = []
    for factor in factors:
        same = factor.columns.names == first.columns.names and factor.rate_hz == first.rate_hz
        if not same or not np.array_equal(_row_weights(factor), _row_weights(first)):
            raise InputError(
                "factors of different robots, rates or weights", source=", ".join(factor.motions)
            )
        names += factor.motions
        n_rows += factor.n_rows
        parts.append(factor.matrix)
        if len(parts) > _STACKED:
            parts = [r_factor(np.vstack(parts))]
    matrix = parts[0] if len(parts) == 1 else r_factor(np.vstack(parts))
    return MotionFactor(tuple(names), first.columns, matrix, n_rows, first.rate_hz, first.row_std)


def compute_conditioning(
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
    base = base or structural_base_parameters(robot)
    factor = stack_factors(factors)
    values = base_singular_values(factor, base)
    rank = int((values > RANK_TOLERANCE * values[0]).sum())
    complete = rank == base.rank
    return Conditioning(
        full=float(values[0] / values[-1]) if complete else np.inf,
        log_det=float(2.0 * np.log(values).sum()) if complete else -np.inf,
        n_base_parameters=base.rank,
        rank=rank,
        segments=segment_conditions(factor.matrix, segment_columns(robot, factor.columns, base)),
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


def _row_weights(factor: MotionFactor) -> Array:
    return np.ones(1) if factor.row_std is None else factor.row_std


# What motions do not excite.


@dataclass(frozen=True)
class UnexcitedParameter:
    """A base parameter that motions leave undetermined.

    Attributes:
        index: among the base parameters.
        label: name of its own column.
        expression: the whole combination.
        share: how much of it lies in undetermined directions, up to 1.
    """

    index: int
    label: str
    expression: str
    share: float


def unexcited_parameters(
    conditioning: Conditioning, tol: float = 1e-6, share: float = 0.25
) -> tuple[UnexcitedParameter, ...]:
    """Base parameters that the motions do not determine.

    Args:
        conditioning: of the motions.
        tol: directions with a singular value below this share of the largest count as undetermined. Motions
            that keep the feet on the ground do so only to the tolerance of a solver, so that exact zeros are
            rare.
        share: a parameter is reported when more than this share of its unit vector's square lies in them.
    """
    base = conditioning.base
    values = base_singular_values(conditioning.factor, base)
    vectors = np.linalg.svd(conditioning.factor.matrix[:, base.independent], full_matrices=True)[2]
    shares = (vectors[values < tol * values[0]] ** 2).sum(axis=0)
    return tuple(
        UnexcitedParameter(int(i), base.labels[i], base.expressions[i], float(shares[i]))
        for i in np.flatnonzero(shares > share)
    )


# Motions ranked by how well each of them alone excites each segment.


@dataclass(frozen=True, eq=False)
class Ranking:
    """Condition number of every segment's sub-regressor in every motion.

    Attributes:
        motions: names of the motions.
        segments: names of the segments that the sensors see.
        condition: ``(n_motions, n_segments)``, infinite where a motion lacks rank.
        smallest: ``(n_motions, n_segments)`` smallest singular values [SI].
    """

    motions: tuple[str, ...]
    segments: tuple[str, ...]
    condition: Array
    smallest: Array

    def best(self, segment: str) -> tuple[int, ...]:
        """Indices of the motions that excite a segment, best first; those that lack rank are left out.

        Of equal condition numbers (to nine digits) the larger smallest singular value wins, then the name,
        then the earlier place: the order does not depend on anything else.

        Raises:
            UnknownNameError: no such segment.
        """
        if segment not in self.segments:
            raise UnknownNameError("segment", segment, list(self.segments))
        s = self.segments.index(segment)
        able = [m for m in range(len(self.motions)) if np.isfinite(self.condition[m, s])]

        return tuple(
            sorted(
                able,
                key=lambda m: (
                    _round_to_nine_digits(self.condition[m, s]),
                    -_round_to_nine_digits(self.smallest[m, s]),
                    self.motions[m],
                    m,
                ),
            )
        )


def rank(robot: Robot, factors: Sequence[MotionFactor], base: BaseParameters | None = None) -> Ranking:
    """Rank motions by the condition numbers of the segments' sub-regressors (Jovic et al. 2015, II.B).

    Args:
        robot: the robot.
        factors: one a motion.
        base: structural base parameters; computed if None.

    Raises:
        InputError: no factor, or base parameters of other columns.
    """
    if not factors:
        raise InputError("no motion to rank", remedy="hand over at least one")
    base = base or structural_base_parameters(robot)
    columns = segment_columns(robot, factors[0].columns, base)
    if any(factor.columns.names != base.names for factor in factors):
        raise InputError("factors of different robots", remedy="rank motions of one robot")
    table = [segment_conditions(factor.matrix, columns) for factor in factors]
    return Ranking(
        motions=tuple(" + ".join(factor.motions) for factor in factors),
        segments=tuple(cell.segment for cell in table[0]),
        condition=np.array([[cell.condition for cell in row] for row in table]),
        smallest=np.array([[cell.smallest for cell in row] for row in table]),
    )


def _round_to_nine_digits(value: float) -> float:
    """The number to nine digits, so that rounding does not decide between equals."""
    return float(f"{value:.8e}")
