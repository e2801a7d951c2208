"""Normal matrices of a model by joint and block, from which those of one with a further term take little work."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.design import Design, Grams, Layout


@dataclass(frozen=True, eq=False)
class Stacked:
    """Gram matrices of a model's parameters, as sums of squares are made of them.

    Attributes:
        of: ``(n_joints, n_blocks, p, p)``.
        right: ``(n_joints, n_blocks, p)`` with the measurement.
        square: ``(n_joints, n_blocks)`` of the measurement.
        total: ``(n_joints, p, p)`` over all blocks.
    """

    of: Array
    right: Array
    square: Array
    total: Array

    @classmethod
    def of_model(cls, grams: Grams, layout: Layout) -> Stacked:
        """Those of a model whose parameters stand as the layout says."""
        n_joints, n_blocks, p = len(grams.of), len(grams.count), layout.size
        of, right = np.zeros((n_joints, n_blocks, p, p)), np.zeros((n_joints, n_blocks, p))
        square = np.empty((n_joints, n_blocks))
        for j, (g, c, at) in enumerate(zip(grams.of, layout.columns, layout.numbers, strict=True)):
            of[j][:, at[:, None], at] = g.take(c, axis=1).take(c, axis=2)
            right[j][:, at] = g[:, c, -1]
            square[j] = g[:, -1, -1]
        return cls(of, right, square, of.sum(axis=1))


@dataclass(frozen=True, eq=False)
class Extended:
    """The same with the columns of one further term, or of none.

    Attributes:
        stacked: without it.
        strips: by joint that it acts on, ``(n_blocks, p + m, m)`` products of all columns and its own.
        right: the same with the measurement, ``(n_blocks, m)``.
        more: m.
    """

    stacked: Stacked
    strips: Mapping[int, Array]
    right: Mapping[int, Array]
    more: int

    @classmethod
    def by(cls, stacked: Stacked, layout: Layout, design: Design, k: int) -> Extended:
        """With the design's term ``k`` beside a model whose parameters stand as the layout says."""
        m, p = design.terms[k].size, layout.size
        strips, right = {}, {}
        for j, where in design.place[k].items():
            g = design.fitted.of[j]
            strip = np.zeros((len(g), p + m, m))
            strip[:, layout.numbers[j]] = g[:, layout.columns[j][:, None], where]
            strip[:, p:] = g[:, where[:, None], where]
            strips[j], right[j] = strip, g[:, where, -1]
        return cls(stacked, strips, right, m)

    def normal(self, weight: Array, *, by_block: bool) -> tuple[Array, Array]:
        """Normal matrices and right sides at joints' weights, ``(n, p + m, p + m)`` and ``(n, p + m)``.

        Args:
            weight: ``(n_joints,)``.
            by_block: whether one a block, or a single one over all.
        """
        base, m = self.stacked, self.more
        of = base.of if by_block else base.total[:, None]
        right = base.right if by_block else base.right.sum(axis=1, keepdims=True)
        n, p = of.shape[1], of.shape[2]
        inner = (weight @ of.reshape(len(of), -1)).reshape(n, p, p)
        side = (weight @ right.reshape(len(right), -1)).reshape(n, p)
        if not m:
            return inner, side
        normal, sides = np.empty((n, p + m, p + m)), np.empty((n, p + m))
        normal[:, :p, :p], sides[:, :p] = inner, side
        strip, more = np.zeros((n, p + m, m)), np.zeros((n, m))
        for j, block in self.strips.items():
            strip += weight[j] * (block if by_block else block.sum(axis=0))
            more += weight[j] * (self.right[j] if by_block else self.right[j].sum(axis=0))
        normal[:, :, p:], normal[:, p:, :p] = strip, strip[:, :p].transpose(0, 2, 1)
        sides[:, p:] = more
        return normal, sides

    def left(self, x: Array) -> Array:
        """Sums of squares that parameters ``(n_blocks, p + m)`` leave of each block, ``(n_blocks, n_joints)``."""
        base, p = self.stacked, self.stacked.of.shape[2]
        z = x[:, :p]
        inner = (base.of @ z[None, :, :, None])[..., 0] - 2.0 * base.right
        out = base.square + (inner * z).sum(axis=-1)
        for j, strip in self.strips.items():
            own = x[:, p:]
            along = (strip * own[:, None, :]).sum(axis=-1)
            out[j] += 2.0 * (along[:, :p] * z).sum(axis=-1) + (along[:, p:] * own).sum(axis=-1)
            out[j] -= 2.0 * (self.right[j] * own).sum(axis=-1)
        return np.maximum(out.T, 1e-300)

    def left_of_all(self, x: Array) -> Array:
        """The same of parameters ``(p + m,)`` over all blocks, ``(n_joints,)``."""
        base, p = self.stacked, self.stacked.of.shape[2]
        z, own = x[:p], x[p:]
        out = base.square.sum(axis=1) + ((base.total @ z) @ z - 2.0 * base.right.sum(axis=1) @ z)
        for j, strip in self.strips.items():
            along = strip.sum(axis=0) @ own
            out[j] += 2.0 * along[:p] @ z + along[p:] @ own - 2.0 * self.right[j].sum(axis=0) @ own
        return np.maximum(out, 1e-300)
