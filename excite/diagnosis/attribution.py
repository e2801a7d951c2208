"""Effects that were found, in the equations of an arm one after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.answer.answer import Verdict
from excite.diagnosis.effects.effect import Effect, Shape, Theta
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.joint_torque import Fit, Solver
from excite.diagnosis.equations.noise_floor import other_postures, repeat_floor

# An effect at a place, fitted alone: a grid of non-linear parameters first, then a local search.


@dataclass(frozen=True, eq=False)
class Columns:
    """A shape at the rows.

    Attributes:
        extra: ``(n_joints, n_rows, n_linear)`` or None.
        offset: ``(n_joints, n_rows)`` or None.
    """

    extra: Array | None
    offset: Array | None

    def torque(self, beta: Array, shape: tuple[int, ...]) -> Array:
        """At linear parameters ``(n_linear,)``, ``shape``: ``(n_joints, n_rows)``."""
        made = np.zeros(shape) if self.offset is None else self.offset
        return made if self.extra is None else made + self.extra @ beta


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


# Search without derivatives: the simplex method of Nelder and Mead.


class _Spent(Exception):
    """All evaluations have been made."""


def nelder_mead(
    loss: Callable[[Array], float], simplex: Array, evaluations: int, near: float, flat: float
) -> None:
    """Make a loss small (Nelder, Mead 1965); whoever asks keeps the best point that ``loss`` has been asked for.

    A loss costs a fit or more, and a search a few dozen of them; ``scipy.optimize`` takes longer to load than many
    a search runs.

    Args:
        loss: of a point ``(n,)``.
        simplex: ``(n + 1, n)`` points to begin with.
        evaluations: losses asked for at most.
        near: done when all points are within this distance of the best, in every coordinate,
        flat: and all losses within this of its own.
    """
    points, left = np.array(simplex, dtype=float), evaluations

    def asked(point: Array) -> float:
        nonlocal left
        if left <= 0:
            raise _Spent
        left -= 1
        return loss(point)

    try:
        values = np.array([asked(point) for point in points])
        while left > 0:
            order = np.argsort(values)
            points, values = points[order], values[order]
            if np.abs(points[1:] - points[0]).max() <= near and np.abs(values[1:] - values[0]).max() <= flat:
                break
            _moved(asked, points, values)
    except _Spent:
        return


def _moved(asked: Callable[[Array], float], points: Array, values: Array) -> None:
    """Replace the worst point, the last, by a better one on the line through the others' middle; else shrink."""
    middle = points[:-1].sum(axis=0) / (len(points) - 1)
    worst = points[-1].copy()
    reflected = 2.0 * middle - worst
    value = asked(reflected)
    if value < values[0]:
        further = 3.0 * middle - 2.0 * worst
        again = asked(further)
        points[-1], values[-1] = (further, again) if again < value else (reflected, value)
    elif value < values[-2]:
        points[-1], values[-1] = reflected, value
    else:
        outside = value < values[-1]
        closer = 1.5 * middle - 0.5 * worst if outside else 0.5 * middle + 0.5 * worst
        again = asked(closer)
        if again <= value if outside else again < values[-1]:
            points[-1], values[-1] = closer, again
            return
        for k in range(1, len(points)):
            points[k] = points[0] + 0.5 * (points[k] - points[0])
            values[k] = asked(points[k])


# What the attribution found, step by step.


@dataclass(frozen=True, eq=False)
class Scored:
    """A hypothesis against the fit before it.

    Attributes:
        hypothesis: the hypothesis.
        evidence: nats less the price of its parameters and of the candidates tried.
        place: index of the joint that it acts on; of what acts on several, of the one that it changes most.
        power: ``(n_joints, 2)`` mean squares that it leaves, identification and validation [(N·m)²].
        count: ``(n_joints, 2)`` effective samples of what it leaves.
    """

    hypothesis: Hypothesis
    evidence: float
    place: int
    power: Array
    count: Array

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.hypothesis.effect.name

    @property
    def location(self) -> str:
        """Its place."""
        return self.hypothesis.location


@dataclass(frozen=True, eq=False)
class Stage:
    """One step of the attribution.

    Attributes:
        context: what the effects were tried against.
        ranking: candidates, best first.
        accepted: the one that was accepted, None at the end.
    """

    context: Context
    ranking: tuple[Scored, ...]
    accepted: Scored | None


@dataclass(frozen=True, eq=False)
class Attribution:
    """All steps.

    Attributes:
        stages: in order; the last accepts nothing.
        before: fit of the baseline.
        after: fit with all accepted effects.
        final: the baseline with them.
        floor: ``(n_joints,)`` noise floor after them [N·m].
        scale: ``(n_joints,)`` standard deviation of each torque in the identification trials [N·m];
            infinite where the joint stands throughout.
        stranger: what explains the rest better than any effect that has a name, and has none itself.
    """

    stages: tuple[Stage, ...]
    before: Fit
    after: Fit
    final: Baseline
    floor: Array
    scale: Array
    stranger: Scored | None = None

    @property
    def accepted(self) -> tuple[Scored, ...]:
        """Accepted effects in order."""
        return tuple(s.accepted for s in self.stages if s.accepted is not None)


# A verdict and what it rests on.


@dataclass(frozen=True, eq=False)
class Judgement:
    """A verdict and what it rests on.

    Attributes:
        verdict: effect, none, ambiguous or unknown.
        rivals: other effects that explain as much as the first accepted one.
        tied: by position in the accepted effects, places that cannot be told from the effect's.
        renamed: by position, a second name that means the same in the data (bias and asymmetry).
        structured: joints whose residual stands above the noise, most first.
        twins: by position in ``rivals``, a second name that means the same in the data.
        probability: of the first accepted effect, at whichever of its places.
        chances: by position in ``rivals``, their probabilities.
    """

    verdict: Verdict
    rivals: tuple[Scored, ...]
    tied: tuple[tuple[str, ...], ...]
    renamed: tuple[str | None, ...]
    structured: tuple[str, ...]
    twins: tuple[str | None, ...] = ()
    probability: float | None = None
    chances: tuple[float, ...] = ()


def withdrawn(attribution: Attribution, baseline: Baseline) -> Attribution:
    """The attribution with nothing accepted, its first ranking kept.

    Args:
        attribution: all its steps.
        baseline: the baseline that they began with.
    """
    first = replace(attribution.stages[0], accepted=None)
    return replace(attribution, stages=(first,), after=attribution.before, final=baseline)


# Evidence for a hypothesis: a likelihood ratio over effective samples, and the power it takes away.

_LAGS = 200


@dataclass(frozen=True, eq=False)
class Power:
    """Mean squares of residuals by joint.

    Attributes:
        identification: ``(n_joints,)`` [(N·m)²].
        validation: ``(n_joints,)``; the identification trials' where there are no others.
    """

    identification: Array
    validation: Array


@dataclass(frozen=True, eq=False)
class Judge:
    """Compares fits of the same rows.

    Attributes:
        use: identification rows.
        count: ``(n_joints, 2)`` effective samples in identification and validation rows.
        floor: ``(n_joints,)`` noise in the band [N·m].
    """

    use: NDArray[np.bool_]
    count: Array
    floor: Array

    def power(self, residual: Array) -> Power:
        """Mean squares of residuals ``(n_joints, n_rows)``."""
        squares = residual**2
        inside = squares[:, self.use].mean(axis=1)
        outside = squares[:, ~self.use].mean(axis=1) if (~self.use).any() else inside
        return Power(inside, outside)

    def ratio(self, before: Array, after: Array) -> Array:
        """Log-likelihood ratio by joint ``(n_joints, 2)`` [nats] from residuals: identification, validation."""
        least = self.floor**2
        p, r = self.power(before), self.power(after)
        logs = np.column_stack(
            [
                np.log(np.maximum(p.identification, least) / np.maximum(r.identification, least)),
                np.log(p.validation / r.validation),
            ]
        )
        return 0.5 * self.count * logs


def effective_counts(residual: Array, use: NDArray[np.bool_], trial: NDArray[np.int64]) -> Array:
    """Effective samples of each joint's residual, ``(n_joints, 2)``: n / (1 + 2 Σ ρ_k) by initial positive sums.

    (Geyer 1992, section 3.3: pairs of neighbouring autocorrelations are added while their sum is positive.)
    """
    counts = np.zeros((len(residual), 2))
    for side, rows in enumerate((use, ~use)):
        if not rows.any():
            continue
        totals = np.zeros((len(residual), _LAGS))
        for k in np.unique(trial[rows]):
            r = np.ascontiguousarray(residual[:, trial == k])
            r = r - r.mean(axis=1, keepdims=True)
            f = np.fft.rfft(r, 2 * r.shape[1], axis=1)
            acf = np.fft.irfft(np.abs(f) ** 2, axis=1)[:, :_LAGS]
            totals[:, : acf.shape[1]] += acf
        for j, total in enumerate(totals):
            rho = total / max(total[0], 1e-300)
            pairs = rho[0:-1:2] + rho[1::2]
            stop = np.flatnonzero(pairs <= 0.0)
            pairs = pairs[: stop[0]] if len(stop) else pairs
            tau = max(1.0, 2.0 * pairs.sum() - 1.0)
            # Rows that hold no known torque leave nothing.
            counts[j, side] = np.count_nonzero(residual[j, rows]) / tau
    return counts


# The baseline with an effect in it that was found.


def extended(item: Hypothesis) -> Baseline:
    """The baseline with an effect in it, of the size that it was fitted with: its torque is taken off the rows."""
    baseline, e = item.baseline, item.baseline.solver.equations
    solver = Solver(replace(e, y=e.y - item.columns.torque(item.fit.extra, e.y.shape)))
    torque = torque_of(item)
    added, drive = baseline.added, baseline.added_drive
    added, drive = (added + torque, drive) if item.effect.moves else (added, drive + torque)
    fixed = replace(
        baseline,
        solver=solver,
        fit=replace(baseline.fit, held=None),
        rigid=baseline.rigid + added - baseline.added,
        added=added,
        added_drive=drive,
    )
    return fixed.updated(solver.fit())


def torque_of(item: Hypothesis) -> Array:
    """What a fitted effect adds to the torques at full rate, ``(n_samples, n_joints)`` [N·m]."""
    shape = item.effect.shape(item.context, item.location, item.theta)
    torque = np.zeros_like(item.baseline.rigid)
    for j, columns in shape.columns.items():
        torque[:, j] += columns @ item.fit.extra
    for j, values in shape.offset.items():
        torque[:, j] += values
    return torque


# How likely a hypothesis is beside what is modelled, and where it acts.


@dataclass(frozen=True, eq=False)
class Scorer:
    """What every hypothesis on a record is judged by.

    Attributes:
        baseline: the baseline without any effect.
        spectral: ``(n_joints,)`` spectral noise floor [N·m].
        unrepeated: ``(n_joints,)`` power of noise in all trials less that in repeated ones [(N·m)²].
        scale: ``(n_joints,)`` standard deviation of each torque in the identification trials [N·m];
            infinite where the joint stands throughout.
    """

    baseline: Baseline
    spectral: Array
    unrepeated: Array | float
    scale: Array

    def floor(self, fit: Fit) -> Array:
        """Of repeated trials; of the spectrum where there are none."""
        repeat = repeat_floor(self.baseline.samples, self.baseline.judged(fit.residual))
        if repeat is None:
            return self.spectral
        return other_postures(np.maximum(repeat, 0.5 * self.spectral), self.unrepeated)

    def scored(self, before: Fit, item: Hypothesis, nats: float | None = None) -> Scored:
        """A hypothesis against the fit before it.

        Args:
            before: the fit without it.
            item: the hypothesis.
            nats: its evidence, where that is known from a fit of all effects.
        """
        samples = self.baseline.samples
        first, last = self.baseline.judged(before.residual), self.baseline.judged(item.fit.residual)
        # Of what this hypothesis leaves: what another has left to explain would count for correlated noise.
        counts = effective_counts(last, samples.identification, samples.trial_of_row)
        # Repeated trials may show less noise than the spectrum above the band makes one expect.
        judge = Judge(samples.identification, counts, np.minimum(self.spectral, self.floor(item.fit)))
        ratio = judge.ratio(first, last)
        cost = 0.5 * item.n_parameters * np.log(max(judge.count.sum(), 2.0)) + np.log(200.0)
        own = item.effect.own_joint and item.location in samples.joints
        place = samples.joints.index(item.location) if own else int(np.argmax(ratio.sum(axis=1)))
        left = judge.power(last)
        power = np.column_stack([left.identification, left.validation])
        evidence = float(ratio.sum() - cost) if nats is None else nats
        return Scored(item, evidence, place, power, counts)


# Where what is left after all effects is more than noise.

# Power over the floor's, and nats, from which a rest is structured.
STRUCTURED, _STRUCTURED_NATS = 2.0, 20.0
# Share of a torque's deviation, or power in multiples of the floor's, from which a structured rest is a gap.
_MATTERS, _FAR = 0.02, 8.0
# Filters and differences are no more exact than this share of a torque's deviation: exact inverse dynamics of a
# seven-joint arm, written at 50 Hz with six decimals, are met to 1.4e-4; torque sensors of arms are known to 1e-2.
_EXACT = 1e-3
# The same against the white floor alone, for gaps that do not repeat.
_WILD, _WILD_SHARE = 10.0, 0.1
# A joint whose own repeats differ by so many times its noise, and of what the middle one's of all joints do, has
# something that does not repeat; where that is this share of the torque's deviation, fewer times will do.
_UNREPEATED, _UNREPEATED_LARGE, _LARGE = 3.0, 1.5, 0.05


def structured_joints(attribution: Attribution, spectral: Array) -> tuple[str, ...]:
    """Joints whose residual after all accepted effects is significantly more than noise."""
    samples = attribution.final.samples
    residual, use = attribution.final.judged(attribution.after.residual), samples.identification
    counts = effective_counts(residual, use, samples.trial_of_row).sum(axis=1)
    power = (residual**2).mean(axis=1)
    floor = np.maximum(attribution.floor, spectral) ** 2
    ratio = power / floor
    nats = 0.5 * counts * (ratio - 1.0 - np.log(np.maximum(ratio, 1.0)))
    # How friction sets in is nobody's model to the last percent: a small rest of that size is no gap.
    excess = np.sqrt(np.maximum(power - floor, 0.0)) / attribution.scale
    matters = (excess > _MATTERS) | ((ratio > _FAR) & (excess > _EXACT))
    likely = (ratio > STRUCTURED) & (nats > _STRUCTURED_NATS)
    # What is different in every trial raises the floor of repeated ones; the white floor does not know it.
    wild = (power > _WILD * spectral**2) & (np.sqrt(power) > _WILD_SHARE * attribution.scale)
    # Nor does its repeat, where only this joint has it.
    differs = attribution.floor / spectral / max(float(np.median(attribution.floor / spectral)), 1.0)
    alone = (differs > _UNREPEATED) & (power > _WILD * spectral**2)
    alone &= np.sqrt(power) > _MATTERS * attribution.scale
    much = np.sqrt(np.maximum(attribution.floor**2 - spectral**2, 0.0)) > _LARGE * attribution.scale
    alone |= (differs > _UNREPEATED_LARGE) & much
    found = np.flatnonzero((likely & matters) | wild | alone)
    # A small rest of a quiet joint may stand furthest above its noise: what is much of the torque comes first.
    stands = power / np.minimum(floor, spectral**2) * np.sqrt(power) / attribution.scale
    return tuple(samples.joints[j] for j in sorted(found, key=lambda j: -stands[j]))
