"""What each candidate would gain beside a model, by its Schur complement: one step, weights as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.budget.evidence import Merit
from excite.diagnosis.budget.fit.design import Candidates, Design
from excite.diagnosis.budget.fit.joint_fit import Model

# What is left of a column beside a model's own, as a share of its power, below which it is none.
_NOTHING = 1e-6


@dataclass(frozen=True, eq=False)
class Tried:
    """A term with the model that has it.

    Attributes:
        index: of the term in the design.
        model: with it.
        merit: what it gains.
        behind: of a rival, how far it is behind, in units of what counts as alike.
        trifles: small effects at other joints that come with it.
    """

    index: int
    model: Model
    merit: Merit
    behind: float = 0.0
    trifles: tuple[Tried, ...] = ()


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


@dataclass(frozen=True, eq=False)
class _Joint:
    """What is asked of all terms at one joint, nothing weighted.

    Attributes:
        numbers: which of the model's parameters it has, ``(c,)``.
        inner: ``(c, c)`` products of the model's columns.
        cross: ``(n_columns, c)`` of all terms' columns and the model's.
        slope: ``(c,)`` of the model's columns and what is left.
    """

    numbers: NDArray[np.int64]
    inner: Array
    cross: Array
    slope: Array


@dataclass(frozen=True, eq=False)
class _Beside:
    """What is asked of all terms beside a model.

    Attributes:
        model: the model.
        joints: by joint.
        slopes: ``(n_joints, n_columns)`` products of the terms' columns and what is left, nothing weighted.
        cross: ``(n_columns, n_parameters)`` weighted products of the terms' columns and the model's.
        told: ``(n_columns, n_parameters)`` by how much the model's parameters take a column up.
    """

    model: Model
    joints: list[_Joint]
    slopes: Array
    cross: Array
    told: Array

    @classmethod
    def of(cls, model: Model) -> _Beside:
        """Beside a model."""
        design, grams, layout = model.design, model.design.fitted, model.layout
        n_columns = int(sum(term.size for term in design.terms))
        cross, slopes = np.zeros((n_columns, layout.size)), np.zeros((design.rows.n_joints, n_columns))
        joints = []
        for j, (g, c, p, at) in enumerate(
            zip(grams.total, layout.columns, layout.numbers, design.columns, strict=True)
        ):
            first, x = g.shape[0] - 1 - len(at), model.x[p]
            products, inner = g[first:-1][:, c], g[c][:, c]
            slopes[j, at] = g[first:-1, -1] - products @ x
            here = np.zeros((n_columns, len(c)))
            here[at] = products
            cross[at[:, None], p] += model.weight[j] * products
            joints.append(_Joint(p, inner, here, g[c, -1] - inner @ x))
        return cls(model, joints, slopes, cross, cross @ np.linalg.inv(model.normal))


def screened(model: Model, candidates: Sequence[int]) -> list[Screened]:
    """Candidates by what they would gain, most first."""
    allowed = np.zeros(len(model.design.terms), dtype=np.bool_)
    allowed[list(candidates)] = True
    beside, found = _Beside.of(model), list[Screened]()
    for group in model.design.groups:
        use = np.flatnonzero(allowed[group.index])
        if len(use):
            found += _screened(beside, group, use)
    return sorted(found, key=lambda item: (-item.nats, item.index))


def _screened(beside: _Beside, group: Candidates, use: NDArray[np.int64]) -> list[Screened]:
    """Those of one size that gain anything."""
    model, columns = beside.model, group.columns[use]
    inner = np.tensordot(model.weight, group.inner[:, use], axes=1)
    left = inner - beside.cross[columns] @ np.moveaxis(beside.told[columns], 1, 2)
    size = np.diagonal(inner, axis1=1, axis2=2)
    there = np.diagonal(left, axis1=1, axis2=2)
    # The trials that are fitted may not show it at all.
    seen = (size > 0.0).all(axis=1) & ~(there < _NOTHING * size).all(axis=1)
    use, columns, size = use[seen], columns[seen], size[seen]
    left = left[seen] + 1e-8 * size[:, :, None] * np.eye(size.shape[1])
    slope = np.tensordot(model.weight, beside.slopes[:, columns], axes=1)
    x = np.linalg.solve(left, slope[..., None])[..., 0]
    x[group.known[use]] = 1.0
    gain = (2.0 * slope * x - x * (left @ x[..., None])[..., 0]).sum(axis=1)
    own = group.own[use]
    felt = np.abs((model.weight[:, None, None] * beside.slopes[:, columns] * x).sum(axis=-1))
    joint = np.where(own >= 0, own, np.argmax(felt, axis=0))
    nats = _nats(beside, group.inner[:, use], columns, x) - 0.5 * group.parameters[use]
    good = np.flatnonzero(np.isfinite(gain) & (gain > 0.0))
    return [Screened(int(group.index[use[i]]), int(joint[i]), float(nats[i]), x[i]) for i in good]


def _nats(beside: _Beside, inner: Array, columns: NDArray[np.int64], x: Array) -> Array:
    """By what all joints together are told better, each by what is left of it, ``(n,)``.

    Args:
        beside: the model.
        inner: ``(n_joints, n, m, m)`` products of the candidates' own columns.
        columns: ``(n, m)`` where they stand.
        x: ``(n, m)`` the candidates' parameters.
    """
    model = beside.model
    count = float(model.design.fitted.count.sum())
    shift = -(beside.told[columns] * x[..., None]).sum(axis=1)
    nats = np.zeros(len(x))
    for j, at in enumerate(beside.joints):
        moved = shift[:, at.numbers]
        along = moved @ at.inner + 2.0 * (at.cross[columns] * x[..., None]).sum(axis=1) - 2.0 * at.slope
        own = (inner[j] @ x[..., None])[..., 0] - 2.0 * beside.slopes[j, columns]
        more = (along * moved).sum(axis=1) + (own * x).sum(axis=1)
        nats -= 0.5 * count * model.share[j] * np.log(np.maximum(1.0 + model.weight[j] * more / count, 1e-6))
    return nats


def one_each(design: Design, ranking: Sequence[Screened]) -> list[Screened]:
    """The best form of each effect at each place."""
    found: dict[tuple[str, str], Screened] = {}
    for item in ranking:
        found.setdefault(design.terms[item.index].key, item)
    return list(found.values())
