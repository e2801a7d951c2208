"""What each candidate would gain beside a model, by its Schur complement: one step, weights as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.design import Design
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
    gradients = []
    for g, c, p, w in zip(grams.total, layout.columns, layout.numbers, model.weight, strict=True):
        gradients.append(w * (g[:-1, -1] - g[:-1][:, c] @ model.x[p]))
    found = []
    for k in candidates:
        term = design.terms[k]
        m = term.size
        cross, inner, slope = np.zeros((layout.size, m)), np.zeros((m, m)), np.zeros(m)
        for j, where in design.place[k].items():
            g, w = grams.total[j], model.weight[j]
            cross[layout.numbers[j]] += w * g[np.ix_(layout.columns[j], where)]
            inner += w * g[np.ix_(where, where)]
            slope += gradients[j][where]
        left = inner - cross.T @ (inverse @ cross)
        size = np.diag(inner)
        # The trials that are fitted may not show it at all.
        if (size <= 0.0).any() or (np.diag(left) < _NOTHING * size).all():
            continue
        left = left + 1e-8 * np.diag(size)
        x: Array = np.ones(1) if term.known else np.asarray(np.linalg.solve(left, slope))
        gain = float(2.0 * slope @ x - x @ left @ x)
        if not np.isfinite(gain) or gain <= 0.0:
            continue
        joint = term.own
        if joint is None:
            joint = max(design.place[k], key=lambda j: float(np.abs(gradients[j][design.place[k][j]] @ x)))
        share = float(model.share[joint])
        nats = -0.5 * count * share * float(np.log(max(1.0 - gain / count, 1e-6)))
        found.append(Screened(k, joint, nats - 0.5 * term.n_parameters, x))
    return sorted(found, key=lambda item: -item.nats)


def one_each(design: Design, ranking: Sequence[Screened]) -> list[Screened]:
    """The best form of each effect at each place."""
    found: dict[tuple[str, str], Screened] = {}
    for item in ranking:
        found.setdefault(design.terms[item.index].key, item)
    return list(found.values())
