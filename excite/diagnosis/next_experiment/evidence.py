"""Expected evidence: how well a motion, added to a record, would tell fitted rivals apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.attribution import Columns, Hypothesis, Scored, at_rows
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import model_phi, prior_spread, standstill_weights
from excite.diagnosis.equations.own_columns import own_signals, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.next_experiment.candidates import LONGEST_S
from excite.logs.signals.butterworth import settling_samples
from excite.motion.motion import Motion
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor

# Rate at which a motion is judged [Hz]; twice what its 10 Hz rows need, and a fraction of most records'.
_RATE_HZ = 100.0


@dataclass(frozen=True, eq=False)
class Expectation:
    """Judges motions by what two fits of one rival's prediction would differ in.

    A rival's noiseless prediction, on the record and on the motion, is fitted with the baseline and another
    rival. What that leaves, against the noise, is the expected log-likelihood ratio of the two were the first
    one true. Inertial parameters that the record hardly shows have their prior; friction is each joint's own.

    Attributes:
        baseline: the baseline before the first effect.
        rivals: hypotheses that the record cannot tell apart, the accepted one first.
        floor: ``(n_joints,)`` noise in the rows' band [N·m].
    """

    baseline: Baseline
    rivals: Sequence[Scored]
    floor: Array

    def with_motion(self, motion: Motion) -> Array:
        """Expected log-likelihood ratio over the one at which rivals are tied ``(n_rivals, n_rivals)``.

        Row a, column b: a is true, b is fitted. Above 1 the two are told apart; the diagonal is infinite.

        Args:
            motion: that is added to the record.
        """
        fresh = as_trial(self.baseline.samples, motion)
        moments = self._without_own(self._record + self._moments(*self._new_rows(fresh)))
        count = int(self.baseline.solver.equations.use.sum()) + len(fresh.rows)
        n = len(self.rivals)
        ratios = np.full((n, n), np.inf)
        alone = [self._nats(moments, count, a, None) for a in range(n)]
        for a, b in permutations(range(n), 2):
            tied = max(THRESHOLDS.rival, THRESHOLDS.alike * alone[a])
            ratios[a, b] = self._nats(moments, count, a, b) / tied
        return ratios

    @cached_property
    def _sigma(self) -> Array:
        """Noise and what the best rival leaves, ``(n_joints,)`` [N·m]."""
        left = np.min([item.power[:, 0] for item in self.rivals], axis=0)
        return np.maximum(self.floor, np.sqrt(left))

    @cached_property
    def _independent(self) -> Array:
        """Effective samples a row, by joint, as the record's residual has them ``(n_joints,)``."""
        use = self.baseline.samples.identification
        return np.minimum(self.rivals[0].count[:, 0] / max(int(use.sum()), 1), 1.0)

    @cached_property
    def _columns(self) -> list[slice]:
        """Where the columns of each rival are behind those of the bodies; the last two are prediction and offset."""
        n, begin, found = self._n_bodies, 0, []
        for item in self.rivals:
            width = len(item.hypothesis.fit.extra) + 2
            found.append(slice(n + begin, n + begin + width))
            begin += width
        return found

    @cached_property
    def _n_bodies(self) -> int:
        return len(self.baseline.phi) if self.baseline.free else 0

    @cached_property
    def _record(self) -> Array:
        """Moments of the record's identification rows."""
        e = self.baseline.solver.equations
        spread = np.where(self._spread > 0.0, self._spread, 1.0)[:, None]
        bodies = (
            e.shared @ (self.baseline.basis / spread).T
            if self.baseline.free
            else np.zeros((e.n_joints, len(e.use), 0))
        )
        parts = [bodies]
        for item in self.rivals:
            parts += _shown(item.hypothesis, item.hypothesis.columns, bodies.shape[:2])
        # Judged as hypotheses are: standstill counts for next to nothing.
        weight = (self.baseline.strict / self.baseline.root_weight)[:, e.use, None]
        rows = np.concatenate(parts, axis=2)[:, e.use] * weight
        own = [o[e.use] * w for o, w in zip(e.own, weight, strict=True)]
        return self._moments(rows, own)

    @cached_property
    def _spread(self) -> Array:
        return prior_spread(model_phi(self.baseline.samples))

    def _new_rows(self, trial: ArmTrial) -> tuple[Array, list[Array]]:
        """Rows ``(n_joints, n_rows, n)`` of a new trial, and each joint's own."""
        baseline = on_trial(self.baseline, trial)
        samples, root = baseline.samples, baseline.root_weight
        bodies = np.zeros((len(samples.joints), len(trial.rows), 0))
        if baseline.free:
            regressor = joint_torque_regressor(samples.robot.model, trial.q, trial.v, trial.a)
            per = np.repeat(range(len(samples.index)), regressor.shape[2]).tolist()
            flat = samples.rows([regressor[:, list(samples.index)].reshape(len(trial.time), -1)], per)
            bodies = flat.reshape(len(trial.rows), len(samples.joints), -1).transpose(1, 0, 2)
            bodies = bodies * self._spread * root[:, :, None]
        context, parts = Context(baseline), [bodies]
        for item in self.rivals:
            h = item.hypothesis
            columns = at_rows(context, h.effect.shape(context, h.location, h.theta))
            parts += _shown(h, columns, bodies.shape[:2])
        terms = own_terms(baseline.modelled)
        own = [baseline.own_rows(terms, j, baseline.signs[j]) for j in range(baseline.n_joints)]
        return np.concatenate(parts, axis=2), own

    def _moments(self, rows: Array, own: Sequence[Array]) -> Array:
        """Second moments of the joints' own columns and of all others, ``(n_joints, n, n)``, weighted.

        Joints have as many own columns as the one with most, of those that they lack nothing.
        """
        most = max(o.shape[1] for o in own)
        filled = [np.pad(o, ((0, 0), (most - o.shape[1], 0))) for o in own]
        joined = [np.hstack([o, r]) / s for o, r, s in zip(filled, rows, self._sigma, strict=True)]
        return np.array([x.T @ x for x in joined])

    def _without_own(self, moments: Array) -> Array:
        """Moments of all other columns with each joint's own projected out."""
        k = moments.shape[1] - self._columns[-1].stop
        own, cross, rest = moments[:, :k, :k], moments[:, :k, k:], moments[:, k:, k:]
        if not k:
            return rest
        ridge = 1e-9 * np.trace(own, axis1=1, axis2=2)[:, None, None] + 1e-12
        return rest - cross.transpose(0, 2, 1) @ np.linalg.solve(own + ridge * np.eye(k), cross)

    def _nats(self, moments: Array, count: int, truth: int, fitted: int | None) -> float:
        """Expected log-likelihood ratio of a rival that is true against a fitted one, or against none."""
        n = self._n_bodies
        target = np.zeros(moments.shape[1])
        target[self._columns[truth].stop - 2] = 1.0
        free = list(range(n))
        if fitted is not None:
            at = self._columns[fitted]
            target[at.stop - 1] -= 1.0
            free += range(at.start, at.stop - 2)
        total = moments.sum(axis=0)
        left = target.copy()
        if free:
            scale = np.sqrt(np.maximum(np.diag(total)[free], 1e-12))
            prior = np.where(np.arange(len(free)) < n, 1.0 / scale**2, 1e-9)
            normal = total[np.ix_(free, free)] / np.outer(scale, scale) + np.diag(prior)
            left[free] -= np.linalg.solve(normal, (total @ target)[free] / scale) / scale
        power = np.maximum((moments @ left) @ left, 0.0)
        return float(0.5 * count * (self._independent * np.log1p(power / count)).sum())


def _shown(item: Hypothesis, columns: Columns, shape: tuple[int, ...]) -> list[Array]:
    """Columns of a hypothesis, then its prediction and its offset, each ``(n_joints, n_rows, …)``."""
    extra = np.zeros((*shape, 0)) if columns.extra is None else columns.extra
    offset = np.zeros(shape) if columns.offset is None else columns.offset
    made = extra @ item.fit.extra + offset
    return [extra, made[:, :, None], offset[:, :, None]]


def on_trial(baseline: Baseline, trial: ArmTrial) -> Baseline:
    """The fitted baseline's predictions on another trial; its equations stay those of the record."""
    rate = 1.0 / float(trial.time[1] - trial.time[0])
    samples = replace(baseline.samples, trials=(trial,), rate_hz=rate)
    terms, index = own_terms(baseline.modelled), list(samples.index)
    rigid = inverse_dynamics(samples.robot.model, trial.q, trial.v, trial.a, baseline.phi)[:, index]
    own = [own_signals(samples, terms, j, baseline.signs[j]) @ o for j, o in enumerate(baseline.fit.own)]
    root = standstill_weights(samples, 3.0, 0.02)
    nothing = np.zeros_like(rigid)
    return replace(
        baseline,
        samples=samples,
        rigid=rigid,
        total=rigid + np.column_stack(own),
        root_weight=root,
        strict=root,
        added=nothing,
        added_drive=nothing,
    )


def as_trial(samples: ArmSamples, motion: Motion, rate_hz: float = _RATE_HZ) -> ArmTrial:
    """A motion as the trial that comes after the record's last, without torques."""
    rate = min(rate_hz, samples.rate_hz)
    short = motion.resampled(samples.robot, rate)
    n = int(np.searchsorted(short.time, motion.time[0] + LONGEST_S, side="right"))
    edge = max(3, settling_samples(rate, samples.bands.rows_hz))
    time = short.time[:n] - short.time[0]
    start = max(float(t.session_s[-1]) for t in samples.trials)
    return ArmTrial(
        name=motion.name,
        identification=True,
        repeats=None,
        time=time,
        session_s=start + time,
        q=short.q[:n],
        v=short.v[:n],
        a=short.a[:n],
        tau=np.full((n, len(samples.joints)), np.nan),
        rows=np.arange(edge, n - edge, max(1, round(rate / samples.bands.rate_hz))),
    )
