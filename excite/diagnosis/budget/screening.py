"""What each candidate would gain beside a model, by its Schur complement: one step, weights as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.budget.design import Design
from excite.diagnosis.budget.groups import Candidates
from excite.diagnosis.budget.joint_fit import Model

# What is left of a column beside a model's own, as a share of its power, below which it is none.
_NOTHING = 1e-6


@dataclass(frozen=True, eq=False)
class Screened:
    """A candidate beside a model.

    Attributes:
        index: of the term.
        joint: that it acts on most.
        nats: about what it would gain.
        x: its parameters.
    """

    index: int
    joint: int
    nats: float
    x: Array


def screened(model: Model, candidates: Sequence[int]) -> list[Screened]:
    """Candidates by what they would gain, most first."""
    inverse = np.linalg.inv(model.normal)
    design, grams, layout = model.design, model.design.fitted, model.layout
    count = float(grams.count.sum())
    n_columns = int(sum(term.size for term in design.terms))
    cross, slopes = np.zeros((layout.size, n_columns)), np.zeros((design.rows.n_joints, n_columns))
    parts = zip(grams.total, layout.columns, layout.numbers, model.weight, design.columns, strict=True)
    for j, (g, c, p, w, at) in enumerate(parts):
        first = g.shape[0] - 1 - len(at)
        products = g[c, first:-1]
        cross[p[:, None], at] += w * products
        slopes[j, at] = w * (g[first:-1, -1] - model.x[p] @ products)
    told = inverse @ cross
    gradient = slopes.sum(axis=0)
    allowed = np.zeros(len(design.terms), dtype=np.bool_)
    allowed[list(candidates)] = True
    found = []
    for group in design.groups:
        use = np.flatnonzero(allowed[group.index])
        if len(use):
            found += _screened(model, group, use, cross, told, gradient, slopes, count)
    return sorted(found, key=lambda item: (-item.nats, item.index))


def _screened(
    model: Model,
    group: Candidates,
    use: NDArray[np.int64],
    cross: Array,
    told: Array,
    gradient: Array,
    slopes: Array,
    count: float,
) -> list[Screened]:
    """Those of one size that gain anything."""
    columns = group.columns[use]
    inner = np.tensordot(model.weight, group.inner[:, use], axes=1)
    left = inner - cross.T[columns] @ np.moveaxis(told.T[columns], 1, 2)
    size = np.diagonal(inner, axis1=1, axis2=2)
    there = np.diagonal(left, axis1=1, axis2=2)
    # The trials that are fitted may not show it at all.
    seen = (size > 0.0).all(axis=1) & ~(there < _NOTHING * size).all(axis=1)
    use, columns, size = use[seen], columns[seen], size[seen]
    left = left[seen] + 1e-8 * size[:, :, None] * np.eye(size.shape[1])
    slope = gradient[columns]
    x = np.linalg.solve(left, slope[..., None])[..., 0]
    x[group.known[use]] = 1.0
    gain = (2.0 * slope * x - x * (left @ x[..., None])[..., 0]).sum(axis=1)
    own = group.own[use]
    felt = np.abs((slopes[:, columns] * x).sum(axis=-1))
    joint = np.where(own >= 0, own, np.argmax(felt, axis=0))
    nats = -0.5 * count * model.share[joint] * np.log(np.maximum(1.0 - gain / count, 1e-6))
    nats -= 0.5 * group.parameters[use]
    good = np.flatnonzero(np.isfinite(gain) & (gain > 0.0))
    return [Screened(int(group.index[use[i]]), int(joint[i]), float(nats[i]), x[i]) for i in good]


def one_each(design: Design, ranking: Sequence[Screened]) -> list[Screened]:
    """The best form of each effect at each place."""
    found: dict[tuple[str, str], Screened] = {}
    for item in ranking:
        found.setdefault(design.terms[item.index].key, item)
    return list(found.values())
