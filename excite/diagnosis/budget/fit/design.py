"""Gram matrices of all columns by block and joint: every fit with some of them is a small sub-problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.budget.fit.terms import Term
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.equations.samples import ArmSamples

# Fewer blocks tell no spread; more cost time and tell no more.
_FEWEST, _MOST = 8, 16


@dataclass(frozen=True, eq=False)
class Rows:
    """What all models of a record have in common.

    Attributes:
        shared: ``(n_joints, n_rows, n_shared)`` columns of the inertial parameters, weighted, of unit variance
            a priori.
        own: one ``(n_rows, n_own)`` a joint, weighted.
        y: ``(n_joints, n_rows)`` weighted.
        block: ``(n_rows,)`` of the trials that are fitted, −1 elsewhere; ``judged`` alike of those that judge.
        judged: blocks of the trials that judge; those of ``block`` where there are none.
        trial: ``(n_rows,)`` index of the trial.
        floor: ``(n_joints,)`` noise below which no joint is weighted up.
        rotor: which of a joint's own columns is its rotor's; None where that is not modelled.
        least_rotor: ``(n_joints,)`` inertia below which a rotor is none.
    """

    shared: Array
    own: tuple[Array, ...]
    y: Array
    block: NDArray[np.int64]
    judged: NDArray[np.int64]
    trial: NDArray[np.int64]
    floor: Array
    rotor: int | None
    least_rotor: Array

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.y)

    @cached_property
    def following(self) -> NDArray[np.int64]:
        """Fitted rows that have a row before them in the same trial."""
        kept: NDArray[np.int64] = np.flatnonzero(
            np.concatenate([[False], (self.block[1:] >= 0) & (self.trial[1:] == self.trial[:-1])])
        )
        return kept

    @property
    def rotors(self) -> NDArray[np.int64]:
        """Where the joints' rotors stand among the parameters of every model; empty where they are not modelled."""
        begin = self.shared.shape[2] + np.cumsum([0, *(own.shape[1] for own in self.own[:-1])])
        return np.zeros(0, dtype=np.int64) if self.rotor is None else begin + self.rotor


@dataclass(frozen=True, eq=False)
class Grams:
    """Gram matrices of a joint's columns and measurement, by block.

    Attributes:
        of: one ``(n_blocks, k_j, k_j)`` a joint, the measurement its last column.
        count: ``(n_blocks,)`` rows.
        total: one ``(k_j, k_j)`` a joint, over all blocks.
    """

    of: tuple[Array, ...]
    count: Array
    total: tuple[Array, ...]

    @property
    def sum_over_blocks(self) -> Grams:
        """All blocks as one."""
        return Grams(tuple(g[None] for g in self.total), self.count.sum(keepdims=True), self.total)


@dataclass(eq=False)
class Design:
    """All columns of a record.

    Attributes:
        rows: baseline and measurement.
        terms: all candidate terms.
        fitted: Gram matrices of the trials that are fitted.
    """

    rows: Rows
    terms: tuple[Term, ...]
    place: list[dict[int, NDArray[np.int64]]] = field(init=False)
    matrices: list[Array] = field(init=False)
    fitted: Grams = field(init=False)

    def __post_init__(self) -> None:
        self.place = [{} for _ in self.terms]
        self.matrices = []
        n_shared = self.rows.shared.shape[2]
        for j in range(self.rows.n_joints):
            parts, at = [self.rows.shared[j], self.rows.own[j]], n_shared + self.rows.own[j].shape[1]
            begin = [0, n_shared]
            for k, term in enumerate(self.terms):
                block = term.columns.get(j)
                if block is None:
                    continue
                self.place[k][j] = np.arange(at, at + block.shape[1])
                parts.append(block)
                begin.append(at)
                at += block.shape[1]
            # By columns: models take some of them.
            matrix = np.empty((self.rows.y.shape[1], at + 1), order="F")
            for first, part in zip(begin, parts, strict=True):
                matrix[:, first : first + part.shape[1]] = part
            matrix[:, at] = self.rows.y[j]
            self.matrices.append(matrix)
        self.fitted = self._compute_grams(self.rows.block)

    @cached_property
    def judging_grams(self) -> Grams:
        """Gram matrices of the trials that judge; those that are fitted where there are none."""
        return self.fitted if self.rows.judged is self.rows.block else self._compute_grams(self.rows.judged)

    def _compute_grams(self, block: NDArray[np.int64]) -> Grams:
        n = int(block.max()) + 1
        members = [np.flatnonzero(block == b) for b in range(n)]
        made = [np.stack([part.T @ part for part in (m[rows] for rows in members)]) for m in self.matrices]
        count = np.array([len(rows) for rows in members], dtype=float)
        return Grams(tuple(made), count, tuple(g.sum(axis=0) for g in made))

    def lay_out_parameters(self, chosen: Sequence[int]) -> Layout:
        """Where the parameters of a model stand in each joint's columns."""
        n_shared = self.rows.shared.shape[2]
        at = n_shared
        columns, numbers = [], []
        for own in self.rows.own:
            width = own.shape[1]
            columns.append([np.arange(n_shared + width)])
            numbers.append([np.concatenate([np.arange(n_shared), np.arange(at, at + width)])])
            at += width
        begin = []
        for k in chosen:
            width = self.terms[k].n_free
            begin.append(at)
            for j, where in self.place[k].items():
                columns[j].append(where)
                numbers[j].append(np.arange(at, at + width))
            at += width
        return Layout(
            tuple(np.concatenate(c) for c in columns), tuple(np.concatenate(n) for n in numbers), at, begin
        )


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the parameters of a model stand.

    Attributes:
        columns: by joint, which of its columns the model has.
        numbers: by joint, which parameter each of them belongs to.
        size: number of parameters.
        begin: first parameter of each chosen term.
    """

    columns: tuple[NDArray[np.int64], ...]
    numbers: tuple[NDArray[np.int64], ...]
    size: int
    begin: list[int]


def blocks_of(samples: ArmSamples, *, identification: bool) -> NDArray[np.int64]:
    """Number of each row's block, ``(n_rows,)``; −1 where the row is of the other trials.

    A trial that repeats another shares its blocks: what is left out must not be known from its repeat.

    Args:
        identification: whether to cut the trials that are fitted, or those that judge.
    """
    own = [k for k, t in enumerate(samples.trials) if t.identification is identification]
    first = {samples.trials[k].name: k for k in own}
    leader = {k: first.get(samples.trials[k].repeats or "", k) for k in own}
    lengths = {k: len(samples.trials[k].rows) for k in own if leader[k] == k}
    total = sum(lengths.values())
    size = max(total / _MOST, THRESHOLDS.block_s * samples.bands.rate_hz)
    size = min(size, total / _FEWEST) if total else 1.0
    block = np.full(len(samples.trial_of_row), -1, dtype=np.int64)
    begun: dict[int, tuple[int, int]] = {}
    count = 0
    for k, length in lengths.items():
        pieces = max(1, round(length / max(size, 1.0)))
        begun[k] = (count, pieces)
        count += pieces
    for k in own:
        start, pieces = begun[leader[k]]
        rows = np.flatnonzero(samples.trial_of_row == k)
        length = lengths[leader[k]]
        block[rows] = start + np.minimum(np.arange(len(rows)) * pieces // max(length, 1), pieces - 1)
    return block
