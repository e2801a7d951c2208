"""A term of the model of the gap: an effect at a place with its columns at the rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.effect import Effect, Theta
from excite.diagnosis.effects.form import Context
from excite.logs.signals.butterworth import SIDE_BY_SIDE

_Form = tuple[Effect, str, Theta]


@dataclass(frozen=True, eq=False)
class Term:
    """An effect at a place, at given non-linear parameters.

    Attributes:
        effect: the effect, in the form that is tried.
        location: its place.
        theta: non-linear parameters.
        context: predictions at which its columns were made.
        columns: by index of the joint's row, ``(n_rows, n_linear)`` weighted, each parameter in units of ``scale``.
        scale: ``(n_linear,)`` what a column was multiplied by.
        known: whether its size is known, one, as that of a gear whose stiffness is given.
        kept: which of the effect's linear parameters it has, the others are zero.
        own: index of the row that it has to improve; None where any will do.
        started: whether the model begins with it.
        direction: the effect's linear parameters for a size of one, where they stand in fixed proportions.
    """

    effect: Effect
    location: str
    theta: Theta
    context: Context
    columns: dict[int, Array]
    scale: Array
    known: bool = False
    kept: tuple[int, ...] = ()
    own: int | None = None
    started: bool = False
    direction: Array | None = None

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @cached_property
    def key(self) -> tuple[str, str]:
        """Name and place."""
        return self.name, self.location

    def is_possible(self, context: Context, x: Array) -> bool:
        """Whether fitted parameters ``(size,)`` are of something that can be, as its name says it."""
        if self.known:
            return self.is_admissible(context, x)
        beta = self.to_beta(x)
        if not self.effect.is_possible(context, self.location, beta):
            return False
        if self.started:
            return self.effect.in_bounds(beta, np.zeros(len(beta)))
        return self.is_admissible(context, x)

    def is_admissible(self, context: Context, x: Array) -> bool:
        """Whether its name says fitted parameters ``(size,)`` best."""
        beta = np.zeros(0) if self.known else self.to_beta(x)
        return self.effect.is_admissible(context, self.location, self.theta, beta)

    @property
    def n_free(self) -> int:
        """Number of linear parameters."""
        return len(self.scale)

    @property
    def n_parameters(self) -> int:
        """Linear and searched parameters."""
        return (0 if self.known else len(self.kept)) + len(self.theta)

    @property
    def prior_precision(self) -> Array:
        """Inverse variances of its parameters a priori, ``(size,)``."""
        if self.direction is not None:
            return np.array([float(((self.scale[0] * self.direction / self.effect.prior_widths) ** 2).sum())])
        return np.asarray((self.scale / self.effect.prior_widths[list(self.kept)]) ** 2)

    def to_beta(self, x: Array) -> Array:
        """The effect's linear parameters from fitted ones ``(size,)``; none of what it does not have."""
        if self.known:
            return np.zeros(0)
        if self.direction is not None:
            return np.asarray(self.direction * (x * self.scale))
        beta = np.zeros(len(self.effect.linear))
        beta[list(self.kept)] = x * self.scale
        return beta


@dataclass(frozen=True, eq=False)
class ShapeStep(Term):
    """The change of a term's torque with a shape parameter's logarithm, as a column whose size is fitted freely."""

    @property
    def prior_precision(self) -> Array:
        """None a priori, ``(1,)``."""
        return np.zeros(1)

    @classmethod
    def from_change(cls, term: Term, change: Mapping[int, Array]) -> ShapeStep:
        """The step of a term's shape parameter.

        Args:
            change: by joint, ``(n_rows,)``.
        """
        columns = {j: values[:, None] for j, values in change.items()}
        return cls(term.effect, term.location, term.theta, term.context, columns, np.ones(1), own=term.own)


@dataclass(frozen=True, eq=False)
class TermMaker:
    """Makes terms at one fit of the model.

    Attributes:
        context: predictions at that fit.
        weight: ``(n_joints, n_rows)`` square roots of the rows' weights.
    """

    context: Context
    weight: Array
    _loaded: dict = field(default_factory=dict)

    def make_term(
        self, effect: Effect, location: str, theta: Theta, kept: tuple[int, ...] | None = None
    ) -> Term | None:
        """The term; None where no joint feels it or it is not finite."""
        form = effect, location, theta
        return self._as_term(
            *(
                self._find_cached_rows(form)
                or self._filter_signals([self._compute_signals(form)], keep=not theta)[0]
            ),
            kept,
        )

    def make_all(self, forms: Iterable[_Form]) -> list[Term]:
        """The terms of effects at places and non-linear parameters, without those that :meth:`make_term` makes none of.

        Their columns go through the filter side by side; those of the motion alone are kept with it.
        """
        made: dict[int, Term | None] = {}
        waiting: dict[int, _Signals] = {}

        def filter_waiting() -> None:
            rows = self._filter_signals(list(waiting.values()), keep=True)
            made.update((k, self._as_term(*one)) for k, one in zip(waiting, rows, strict=True))
            waiting.clear()

        for k, form in enumerate(forms):
            known = self._find_cached_rows(form)
            if known is not None:
                made[k] = self._as_term(*known)
                continue
            signals = self._compute_signals(form)
            if sum(other.n_cols for other in (*waiting.values(), signals)) > SIDE_BY_SIDE:
                filter_waiting()
            waiting[k] = signals
        filter_waiting()
        return [term for _, term in sorted(made.items()) if term is not None]

    def remake_term(self, term: Term) -> Term | None:
        """A term made anew at these predictions."""
        whole = len(term.kept) == len(term.effect.linear)
        return self.make_term(term.effect, term.location, term.theta, None if whole else term.kept)

    def shape_at_size(self, term: Term, x: Array) -> Term:
        """A term at the shape that goes with its fitted parameters ``(size,)``; itself where that is its shape."""
        theta = term.theta if term.known else term.effect.shape_at(term.theta, term.to_beta(x))
        return term if theta == term.theta else self.make_term(term.effect, term.location, theta) or term

    def _context_for(self, effect: Effect) -> Context:
        """Effects of the load are told from the rigid bodies' torque: friction would explain itself."""
        if not effect.by_load:
            return self.context
        if "load" not in self._loaded:
            base = self.context.baseline
            self._loaded["load"] = Context(replace(base, total=base.rigid))
        return self._loaded["load"]

    def _compute_signals(self, form: _Form) -> _Signals:
        effect, location, theta = form
        context = self._context_for(effect)
        shape = effect.shape(context, location, theta)
        blocks = shape.columns or {j: values[:, None] for j, values in shape.offset.items()}
        felt = [j for j in sorted(blocks) if blocks[j].any()]
        return _Signals(effect, location, theta, context, bool(shape.offset), felt, [blocks[j] for j in felt])

    def _find_cached_rows(self, form: _Form) -> tuple[_Signals, Array] | None:
        """Signals and rows of the motion alone that were made before, whatever else has been found since."""
        known = self.context.baseline.derived.rows.get((type(form[0]), *form[1:]))
        return None if known is None else (replace(known[0], context=self.context), known[1])

    def _filter_signals(self, several: Sequence[_Signals], *, keep: bool) -> list[tuple[_Signals, Array]]:
        """Signals with what the filter makes of them, ``(n_rows, n)`` each; ``keep`` those of the motion alone."""
        blocks = [block for signals in several for block in signals.blocks]
        if not blocks:
            return [(signals, np.zeros((0, 0))) for signals in several]
        # Each column in one piece, as most come.
        joints = [j for s in several for j, block in zip(s.felt, s.blocks, strict=True) for _ in block.T]
        together = self.context.baseline.samples.to_rows(
            np.concatenate([block.T for block in blocks]).T, joints
        )
        ends = np.cumsum([signals.n_cols for signals in several])
        made = list(zip(several, np.split(together, ends[:-1], axis=1), strict=True))
        for signals, rows in made if keep else ():
            if signals.effect.by_motion:
                key = type(signals.effect), signals.location, signals.theta
                bare = replace(signals, blocks=[])
                self.context.baseline.derived.rows[key] = bare, rows.copy(order="K")
        return made

    def _as_term(self, signals: _Signals, rows: Array, kept: tuple[int, ...] | None = None) -> Term | None:
        effect, location, theta, context = signals.effect, signals.location, signals.theta, signals.context
        joints, known = self.context.joints, signals.known
        anywhere = location not in joints or effect.timing or effect.reaches_others
        own = None if anywhere else joints.index(location)
        blocks = np.split(rows, len(signals.felt), axis=1) if signals.felt else []
        columns = {j: block * self.weight[j][:, None] for j, block in zip(signals.felt, blocks, strict=True)}
        if kept is not None and not known:
            columns = {j: block[:, list(kept)] for j, block in columns.items()}
        if not columns or not all(np.isfinite(block).all() for block in columns.values()):
            return None
        power = sum((block**2).sum(axis=0) for block in columns.values())
        size = np.sqrt(power / self.weight.shape[1])
        if known:
            return Term(effect, location, theta, context, columns, np.ones(1), known=True, own=own)
        index = np.arange(len(effect.linear)) if kept is None else np.array(kept)
        felt = size > 1e-7 * max(float(size.max()), 1e-300)
        if not felt.any() or float(size.max()) < 1e-12:
            return None
        scaled = {j: block[:, felt] / size[felt] for j, block in columns.items()}
        return Term(
            effect,
            location,
            theta,
            context,
            scaled,
            1.0 / size[felt],
            kept=tuple(index[felt].tolist()),
            own=own,
        )


@dataclass(frozen=True, eq=False)
class _Signals:
    """What an effect adds to the torques, on its way to the rows.

    Attributes:
        effect: the effect.
        location: its place.
        theta: non-linear parameters.
        context: predictions at which it was made.
        known: whether its size is.
        felt: indices of the joints' rows that feel it.
        blocks: ``(n_samples, n_linear)`` of each joint that feels it, at full rate.
    """

    effect: Effect
    location: str
    theta: Theta
    context: Context
    known: bool
    felt: list[int]
    blocks: list[Array]

    @property
    def n_cols(self) -> int:
        """Number of columns."""
        return sum(block.shape[1] for block in self.blocks)
