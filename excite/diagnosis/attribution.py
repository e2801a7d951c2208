"""Effects of known size in the equations of an arm, one after the other, and the verdict on them."""

from __future__ import annotations

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
from excite.doctor.inertial_prior import count_effective_samples


@dataclass(frozen=True, eq=False)
class Columns:
    """A shape at the rows.

    Attributes:
        extra: ``(n_joints, n_rows, n_linear)`` or None.
        offset: ``(n_joints, n_rows)`` or None.
    """

    extra: Array | None
    offset: Array | None

    def predict_torque(self, beta: Array, shape: tuple[int, ...]) -> Array:
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
    def fitted_columns(self) -> Array | None:
        """Columns of what is fitted, ``(n_joints, n_rows, n)``: of each linear parameter, or of them all together."""
        extra = self.columns.extra
        return extra if extra is None or self.direction is None else extra @ self.direction[:, None]

    @property
    def fit_context(self) -> Context:
        """Predictions that its columns were made of."""
        return self.made_at or Context(self.baseline)

    @property
    def is_physical(self) -> bool:
        """Whether its fitted parameters are physically possible: no negative rotor inertia, for instance."""
        inside = self.effect.in_bounds(self.fit.extra, self.fit.extra_std)
        return inside and self.effect.is_physical(Context(self.baseline), self.location, self.fit)

    @property
    def is_within_scope(self) -> bool:
        """Whether its fitted shape is inside the range that the effect describes."""
        return self.effect.is_within_scope(Context(self.baseline), self.location, self.theta, self.fit)

    @property
    def fit_with_trial_deviations(self) -> Fit:
        """The fit with standard deviations from the disagreement between trials."""
        return replace(
            self.fit, extra_std=self.baseline.solver.std_between_trials(self.fit, self.effect.prior_widths)
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
        stacked = samples.to_rows(
            np.concatenate([shape.columns[k].T for k in keys]).T, np.repeat(keys, m).tolist()
        )
        extra = np.zeros((len(context.joints), n_rows, m))
        for place, k in enumerate(keys):
            extra[k] = stacked[:, m * place : m * (place + 1)] * root[k][:, None]
    if shape.offset:
        keys = sorted(shape.offset)
        stacked = samples.to_rows(np.stack([shape.offset[k] for k in keys]).T, keys)
        offset = np.zeros((len(context.joints), n_rows))
        offset[keys] = stacked.T * root[keys]
    return Columns(extra, offset)


def fit_along_direction(item: Hypothesis, direction: Array) -> Hypothesis:
    """A hypothesis of whose linear parameters only the size is left to be fitted, ``direction (n_linear,)`` times."""
    whole = replace(item, direction=direction)
    one = item.baseline.solver.fit_columns(whole.fitted_columns, item.columns.offset)
    # Proportions are those of an estimate: a parameter is no surer than it is where all are free.
    std = np.maximum(one.extra_std[0] * np.abs(direction), item.fit.extra_std)
    fit = replace(one, extra=one.extra[0] * direction, extra_std=std, columns=item.columns.extra)
    return replace(whole, fit=fit)


# What the attribution found, step by step.


@dataclass(frozen=True, eq=False)
class Scored:
    """Score a hypothesis against the fit before it.

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
class Attribution:
    """Effects that explain a record, each fitted beside those before it.

    Attributes:
        baseline: what is modelled alone, fitted.
        final: the same with all accepted effects in it.
        floor: ``(n_joints,)`` noise floor after them [N·m].
        scale: ``(n_joints,)`` standard deviation of each torque in the identification trials [N·m];
            infinite where the joint stands throughout.
        ranking: candidates for the first effect, best first.
        accepted: effects in order; the baseline of each has those before it.
        stranger: what explains the rest better than any effect that has a name, and has none itself.
    """

    baseline: Baseline
    final: Baseline
    floor: Array
    scale: Array
    ranking: tuple[Scored, ...] = ()
    accepted: tuple[Scored, ...] = ()
    stranger: Scored | None = None

    def baseline_at(self, count: int) -> Baseline:
        """The baseline with the first effects in it."""
        if count in {0, len(self.accepted)}:
            return self.final if count else self.baseline
        return self.accepted[count].hypothesis.baseline

    def first_n(self, count: int) -> Attribution:
        """The first effects alone."""
        return replace(self, accepted=self.accepted[:count], final=self.baseline_at(count))


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


# Evidence for a hypothesis: a likelihood ratio over effective samples.


def effective_counts(residual: Array, use: NDArray[np.bool_], trial: NDArray[np.int64]) -> Array:
    """Effective samples of each joint's residual, ``(n_joints, 2)``: of identification and of validation rows."""
    counts = np.zeros((len(residual), 2))
    for side, rows in enumerate((use, ~use)):
        if rows.any():
            # Rows that hold no known torque leave nothing.
            known = (residual[:, rows] != 0.0).mean(axis=1)
            counts[:, side] = known * count_effective_samples(residual[:, rows].T, trial[rows])
    return counts


# The baseline with an effect in it that was found.


def extend_baseline(item: Hypothesis) -> Baseline:
    """The baseline with an effect in it, of the size that it was fitted with: its torque is taken off the rows."""
    baseline, e = item.baseline, item.baseline.solver.equations
    solver = Solver(replace(e, y=e.y - item.columns.predict_torque(item.fit.extra, e.y.shape)))
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
    return fixed.with_fit(solver.fit_columns())


def torque_of(item: Hypothesis) -> Array:
    """What a fitted effect adds to the torques at full rate, ``(n_samples, n_joints)`` [N·m]."""
    shape = item.effect.shape(item.fit_context, item.location, item.theta)
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

    def noise_floor(self, fit: Fit) -> Array:
        """Of repeated trials; of the spectrum where there are none."""
        repeat = repeat_floor(self.baseline.samples, self.baseline.judging_residual(fit.residual))
        if repeat is None:
            return self.spectral
        return other_postures(np.maximum(repeat, 0.5 * self.spectral), self.unrepeated)

    def score_fit(self, before: Fit, item: Hypothesis, nats: float | None = None) -> Scored:
        """Score a hypothesis against the fit before it.

        Args:
            before: the fit without it.
            item: the hypothesis.
            nats: its evidence, where that is known from a fit of all effects.
        """
        samples = self.baseline.samples
        first = self.baseline.judging_residual(before.residual)
        last = self.baseline.judging_residual(item.fit.residual)
        # Of what this hypothesis leaves: what another has left to explain would count for correlated noise.
        counts = effective_counts(last, samples.identification_rows, samples.trial_of_row)
        power, before_it = (_mean_squares(rows, samples.identification_rows) for rows in (last, first))
        # Repeated trials may show less noise than the spectrum above the band makes one expect.
        least = np.zeros_like(power)
        least[:, 0] = np.minimum(self.spectral, self.noise_floor(item.fit)) ** 2
        ratio = 0.5 * counts * np.log(np.maximum(before_it, least) / np.maximum(power, least))
        cost = 0.5 * item.n_parameters * np.log(max(counts.sum(), 2.0)) + np.log(200.0)
        own = item.effect.own_joint and item.location in samples.joints
        place = samples.joints.index(item.location) if own else int(np.argmax(ratio.sum(axis=1)))
        evidence = float(ratio.sum() - cost) if nats is None else nats
        return Scored(item, evidence, place, power, counts)


def _mean_squares(residual: Array, use: NDArray[np.bool_]) -> Array:
    """``(n_joints, 2)`` of identification and validation rows; of the former alone where there are no others."""
    sides = (use, ~use) if (~use).any() else (use, use)
    return np.column_stack([(residual[:, rows] ** 2).mean(axis=1) for rows in sides])


# Where what is left after all effects is more than noise.

# Power over the floor's, nats, and share of a torque's deviation, from which a rest is a gap.
STRUCTURED, _STRUCTURED_NATS, _MATTERS = 2.0, 20.0, 0.02
# The same of what stands far above the noise. Filters and differences are no more exact than this share: exact inverse
# dynamics of a seven-joint arm, written at 50 Hz with six decimals, are met to 1.4e-4; torque sensors of arms are
# known to 1e-2.
_FAR, _EXACT = 8.0, 1e-3


def structured_joints(attribution: Attribution, spectral: Array) -> tuple[str, ...]:
    """Joints whose residual after all accepted effects is significantly more than noise, most of the torque first."""
    samples, scale = attribution.final.samples, attribution.scale
    residual = attribution.final.judging_residual(attribution.final.fit.residual)
    counts = effective_counts(residual, samples.identification_rows, samples.trial_of_row).sum(axis=1)
    power, own = (residual**2).mean(axis=1), np.maximum(attribution.floor, spectral)

    def is_gap(floor: Array, times: float, share: float) -> NDArray[np.bool_]:
        ratio = power / floor**2
        nats = 0.5 * counts * (ratio - 1.0 - np.log(np.maximum(ratio, 1.0)))
        excess = np.sqrt(np.maximum(power - floor**2, 0.0))
        return (ratio > times) & (nats > _STRUCTURED_NATS) & (excess > share * scale)

    # What is different in every trial raises the floor of repeated ones: that is noise where all joints have it. How
    # friction sets in is nobody's model to the last percent: a small rest of that size is no gap.
    common = spectral * float(np.median(own / spectral))
    found = np.flatnonzero(is_gap(common, STRUCTURED, _MATTERS) | is_gap(own, _FAR, _EXACT))
    # A small rest of a quiet joint may stand furthest above its noise: what is much of the torque comes first.
    stands = (power / spectral**2) * np.sqrt(power) / scale
    return tuple(samples.joints[j] for j in sorted(found, key=lambda j: -stands[j]))
