"""An effect at a place, fitted alone: a grid of non-linear parameters first, then a local search."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.attribution.simplex import nelder_mead
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Shape, Theta
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.joint_torque import Fit, Solver


@dataclass(frozen=True, eq=False)
class Columns:
    """A shape at the rows.

    Attributes:
        extra: ``(n_joints, n_rows, n_linear)`` or None.
        offset: ``(n_joints, n_rows)`` or None.
    """

    extra: Array | None
    offset: Array | None


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """An effect at a place at its best parameters.

    Attributes:
        effect: the effect.
        location: the place.
        theta: non-linear parameters.
        columns: at the rows.
        fit: the fit with it.
        baseline: what it was fitted on; its sign changes may differ from those that the search began with.
        made_at: predictions that its columns were made of, where these are not the baseline's own.
        direction: ``(n_linear,)`` that its linear parameters are a multiple of; None where each is free.
    """

    effect: Effect
    location: str
    theta: Theta
    columns: Columns
    fit: Fit
    baseline: Baseline
    made_at: Context | None = None
    direction: Array | None = None

    @property
    def fitted(self) -> Array | None:
        """Columns of what is fitted, ``(n_joints, n_rows, n)``: of each linear parameter, or of them all together."""
        extra = self.columns.extra
        return extra if extra is None or self.direction is None else extra @ self.direction[:, None]

    @property
    def context(self) -> Context:
        """Predictions that its columns were made of."""
        return self.made_at or Context(self.baseline)

    @property
    def loss(self) -> float:
        """``Σ_j log σ_j``: what the search makes small."""
        return float(np.log(self.fit.sigma).sum())

    @property
    def physical(self) -> bool:
        """Whether its fit says something that can be: no rotor weighs less than nothing."""
        inside = self.effect.in_bounds(self.fit.extra, self.fit.extra_std)
        return inside and self.effect.physical(Context(self.baseline), self.location, self.fit)

    @property
    def settled(self) -> bool:
        """Whether its search ended within what its name stands for."""
        return self.effect.settled(Context(self.baseline), self.location, self.theta, self.fit)

    @property
    def told(self) -> Fit:
        """The fit with the deviations that are told: those by which trials disagree."""
        return replace(
            self.fit, extra_std=self.baseline.solver.std_between_trials(self.fit, self.effect.widths)
        )

    @property
    def n_parameters(self) -> int:
        """Linear and non-linear parameters."""
        return len(self.effect.linear) + len(self.effect.searched)


def at_rows(context: Context, shape: Shape) -> Columns:
    """Filter a shape and keep it at the rows, weighted as they are."""
    samples = context.baseline.samples
    n_rows = sum(len(t.rows) for t in samples.trials)
    extra = offset = None
    root = context.baseline.root_weight
    if shape.columns:
        keys = sorted(shape.columns)
        m = shape.columns[keys[0]].shape[1]
        stacked = samples.rows(
            np.concatenate([shape.columns[k].T for k in keys]).T, np.repeat(keys, m).tolist()
        )
        extra = np.zeros((len(context.joints), n_rows, m))
        for place, k in enumerate(keys):
            extra[k] = stacked[:, m * place : m * (place + 1)] * root[k][:, None]
    if shape.offset:
        keys = sorted(shape.offset)
        stacked = samples.rows(np.stack([shape.offset[k] for k in keys]).T, keys)
        offset = np.zeros((len(context.joints), n_rows))
        offset[keys] = stacked.T * root[keys]
    return Columns(extra, offset)


def along(item: Hypothesis, direction: Array) -> Hypothesis:
    """A hypothesis of whose linear parameters only the size is left to be fitted, ``direction (n_linear,)`` times."""
    whole = replace(item, direction=direction)
    one = item.baseline.solver.fit(whole.fitted, item.columns.offset)
    # Proportions are those of an estimate: a parameter is no surer than it is where all are free.
    std = np.maximum(one.extra_std[0] * np.abs(direction), item.fit.extra_std)
    fit = replace(one, extra=one.extra[0] * direction, extra_std=std, columns=item.columns.extra)
    return replace(whole, fit=fit)


@dataclass(frozen=True, eq=False)
class Search:
    """Fits effects against one baseline.

    Attributes:
        context: the context.
        solver: the equations.
    """

    context: Context
    solver: Solver

    def try_at(self, effect: Effect, location: str, theta: Theta, iterations: int = 6) -> Hypothesis | None:
        """One fit; None where its linear parameters are not physical, or no joint feels it, or it is not finite."""
        columns = at_rows(self.context, effect.shape(self.context, location, theta))
        if effect.linear and columns.extra is None:
            return None
        for values in (columns.extra, columns.offset):
            if values is not None and not np.isfinite(values).all():
                return None
        fit = self.solver.fit(columns.extra, columns.offset, iterations, effect.widths)
        if not effect.admissible(self.context, location, theta, fit.extra):
            return None
        return Hypothesis(effect, location, theta, columns, fit, self.context.baseline)

    def coarse(self, effect: Effect, location: str) -> Hypothesis | None:
        """The best of the grids of the effect and its other forms."""
        tried = (
            self.try_at(form, location, theta, 3)
            for form in (effect, *effect.forms)
            for theta in form.grid(self.context, location)
        )
        found = [item for item in tried if item is not None]
        return min(found, key=lambda item: item.loss, default=None)

    def refine(self, start: Hypothesis, evaluations: int = 14, step: float = 0.25) -> Hypothesis:
        """Local search of the non-linear parameters on a logarithmic scale (Nelder, Mead 1965).

        Args:
            start: where from.
            evaluations: fits at most, for each parameter.
            step: size of the first simplex, relative.

        Returns:
            The best found, ``start`` itself where nothing is better.
        """
        best = self.try_at(start.effect, start.location, start.theta) or start
        searched, n = start.effect.searched, len(start.theta)
        if n == 0:
            return best
        origin = np.log(best.theta)

        def loss(point: Array) -> float:
            nonlocal best
            low, high = (np.log([getattr(p, side) for p in searched]) for side in ("low", "high"))
            inside = np.clip(point, low, high)
            item = self.try_at(start.effect, start.location, tuple(np.exp(inside).tolist()))
            if item is None:
                return best.loss + 1.0
            if item.loss < best.loss:
                best = item
            return item.loss + float(np.abs(point - inside).sum())

        simplex = origin + np.vstack([np.zeros(n), step * np.eye(n)])
        nelder_mead(loss, simplex, evaluations * n, near=0.01, flat=1e-4)
        return best
