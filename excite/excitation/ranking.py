"""Motions ranked by how well each of them alone excites each segment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.errors import InputError, UnknownNameError
from excite.excitation.conditioning import MotionFactor
from excite.excitation.sub_regressors import segment_columns, segment_conditions
from excite.regressor.base_parameters import BaseParameters, structural_base_parameters
from excite.robot.robot import Robot


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

        def key(m: int) -> tuple[float, float, str, int]:
            return (
                _round_to_nine_digits(self.condition[m, s]),
                -_round_to_nine_digits(self.smallest[m, s]),
                self.motions[m],
                m,
            )

        return tuple(sorted(able, key=key))


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
    base = base if base is not None else structural_base_parameters(robot)
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
