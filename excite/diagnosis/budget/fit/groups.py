"""Terms of one size together: what is asked of each of them is then one product of matrices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.budget.fit.terms import Term


@dataclass(frozen=True, eq=False)
class Candidates:
    """A design's terms of one size, together.

    Attributes:
        index: ``(n,)`` of the terms.
        columns: ``(n, m)`` where their columns stand among all terms' columns.
        inner: ``(n_joints, n, m, m)`` products of a term's own columns, by joint.
        parameters: ``(n,)`` linear and searched parameters of each.
        own: ``(n,)`` row that each has to improve; −1 where any will do.
        known: ``(n,)`` whether its size is known.
    """

    index: NDArray[np.int64]
    columns: NDArray[np.int64]
    inner: Array
    parameters: Array
    own: NDArray[np.int64]
    known: NDArray[np.bool_]


def grouped(
    terms: Sequence[Term], place: Sequence[Mapping[int, NDArray[np.int64]]], totals: Sequence[Array]
) -> tuple[Candidates, ...]:
    """Terms by their sizes.

    Args:
        terms: all terms.
        place: by term and joint, which of the joint's columns it has.
        totals: Gram matrices, one ``(k_j, k_j)`` a joint.
    """
    sizes = np.array([term.size for term in terms], dtype=np.int64)
    first = np.cumsum(sizes) - sizes
    made = []
    for m in np.unique(sizes):
        index = np.flatnonzero(sizes == m)
        inner = np.zeros((len(totals), len(index), m, m))
        for i, k in enumerate(index):
            for j, where in place[k].items():
                inner[j, i] = totals[j][where[0] : where[-1] + 1, where[0] : where[-1] + 1]
        chosen = [terms[k] for k in index]
        made.append(
            Candidates(
                index,
                first[index][:, None] + np.arange(m),
                inner,
                np.array([float(t.n_parameters) for t in chosen]),
                np.array([-1 if t.own is None else t.own for t in chosen]),
                np.array([t.known for t in chosen]),
            )
        )
    return tuple(made)
