"""What a diagnosis says of the next measurement: a motion where one helps, a reading or a load where none does."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.answer import NextExperiment
from excite.diagnosis.answer.candidate import in_words
from excite.diagnosis.attribution import Attribution, Columns, Hypothesis, Judgement, Scored, at_rows
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.form import Context
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import model_phi, prior_spread, standstill_weights
from excite.diagnosis.equations.own_columns import own_signals, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.next_experiment.candidates import LONGEST_S, Offer, draw_motions, full_range_sines
from excite.logs.signals.butterworth import settling_samples
from excite.motion.files import save_motion
from excite.motion.motion import Motion

FILE = "next_experiment.parquet"
# Expected log-likelihood ratio, in units of what ties a pair: safely told apart; worth an experiment; none, in any
# motion. A body on a SCARA's second axis and a rotor on its first have 0.03, by the little that the body takes up
# elsewhere; a spring and an eccentric of a Panda's first joint, which other motions tell apart, have 1.3.
_SAFELY, _WORTH, _NOTHING = 4.0, 1.5, 0.1
# Score from which a motion within the record is good enough, and what a wider one has to add.
_ENOUGH, _WIDER = 0.9, 0.1
_ATTEMPTS = 4
# Rivals that a motion is chosen for, the likeliest.
_MOST = 5


@dataclass(frozen=True, eq=False)
class Proposal:
    """A motion and what it is expected to tell.

    Attributes:
        motion: the motion.
        ratios: ``(n_rivals, n_rivals)`` expected log-likelihood ratios over those at which rivals are tied: row
            true, column fitted.
        caution: what a person has to look at before it is run; may be empty.
    """

    motion: Motion
    ratios: Array
    caution: str

    @property
    def separation_score(self) -> float:
        """Share of what may be true that is safely told from what it may be taken for, half-safely in proportion.

        A little is added for more, so that of two motions that tell all apart the clearer one wins.
        """
        pairs = self.ratios[~np.eye(len(self.ratios), dtype=np.bool_)]
        return float(np.minimum(pairs / _SAFELY, 1.0).mean() + 1e-3 * np.log1p(pairs.min()))

    @property
    def from_first(self) -> Array:
        """By rival after the first, the ratio at which it is told from the first if one of the two is true."""
        return np.maximum(self.ratios[0, 1:], self.ratios[1:, 0])


def propose_motion(baseline: Baseline, rivals: Sequence[Scored], floor: Array, seed: int) -> Proposal | None:
    """The safe motion that is expected to tell most rivals apart.

    Within what the log has shown there are the record's own paths at other speeds and, where the model has
    shapes, motions of the generators aimed at the rivals' joints, made safe by the filter. Where these do not tell
    all rivals apart, there are motions over the model's whole range; without shapes, through new postures
    within the record's. The independent check has the last word; without shapes, all of it but collisions.

    Args:
        baseline: the baseline before the first effect.
        rivals: hypotheses that the record cannot tell apart, two or more, the accepted one first.
        floor: ``(n_joints,)`` noise in the rows' band [N·m].
        seed: of the generators.

    Returns:
        The proposal; None where no motion tells the first from any of the others, or none is safe.
    """
    expectation, samples = Expectation(baseline, rivals, floor), baseline.samples
    targets = sorted({_affected_joint(item, samples) for item in rivals}, key=samples.joints.index)
    best = _best_proposal(expectation, draw_motions(samples, targets, seed, wide=False))
    if best is None or best.separation_score < _ENOUGH:
        other = _best_proposal(expectation, draw_motions(samples, targets, seed, wide=True))
        if other is not None and (best is None or other.separation_score > best.separation_score + _WIDER):
            best = other
    return best


def _best_proposal(expectation: Expectation, offers: Iterable[Offer]) -> Proposal | None:
    """The best safe one; sketches are ranked first, and no more made safe than is needed."""

    def propose_offer(motion: Motion, offer: Offer) -> Proposal:
        return Proposal(motion, expectation.with_motion(motion), offer.caution)

    ranked = [(propose_offer(offer.sketch, offer), offer) for offer in offers]
    ranked = [pair for pair in ranked if pair[0].from_first.max() > _WORTH]
    best: Proposal | None = None
    for sketched, offer in sorted(ranked, key=lambda pair: -pair[0].separation_score)[:_ATTEMPTS]:
        if best is not None and best.separation_score >= sketched.separation_score:
            break
        motion = offer.make_safe()
        if motion is not None:
            found = sketched if motion is offer.sketch else propose_offer(motion, offer)
            if found.from_first.max() > _WORTH and (
                best is None or found.separation_score > best.separation_score
            ):
                best = found
    return best


def _affected_joint(item: Scored, samples: ArmSamples) -> str:
    """The joint that a hypothesis is about: its own, else the one that it changes most."""
    return item.location if item.location in samples.joints else samples.joints[item.place]


def give_advice(attribution: Attribution, judgement: Judgement, out: Path | None) -> NextExperiment | None:
    """What would tell apart the names, or the places, that the record leaves open.

    Args:
        attribution: the effects.
        judgement: the verdict on it.
        out: folder for the motion; none is planned without it.

    Returns:
        The advice; None where nothing is open.
    """
    if judgement.verdict not in {"effect", "ambiguous"}:
        return None
    baseline, best, second = attribution.baseline, attribution.accepted[0], judgement.renamed[0]
    # Rivals of another name, then other places of the same.
    places = judgement.tied[0][1:]
    same = (s for s in attribution.ranking if s.name == best.name and s.location in places)
    others = [*judgement.rivals, *same][:_MOST]
    if not others and second is None:
        return None
    twin = [f"{second}@{best.location}"] if second else []
    separates = (f"{best.name}@{best.location}", *twin, *(f"{o.name}@{o.location}" for o in others))
    said, file = [], None
    # Motions are planned joint by joint, and loops would not be closed in them.
    looped = baseline.samples.robot.mechanism is not None
    out = None if looped else out
    if others and not looped:
        floor = np.maximum(attribution.floor, baseline.solver.equations.floor)
        ratios = Expectation(baseline, [best, *others], floor).with_motion(full_range_sines(baseline.samples))
        twins = np.maximum(ratios[0, 1:], ratios[1:, 0]) < _NOTHING
        alike = [item for item, is_twin in zip(others, twins, strict=True) if is_twin]
        others = [item for item, is_twin in zip(others, twins, strict=True) if not is_twin]
        if alike:
            told = _join_hints([e.without_motion for e in _rival_effects(best, alike)])
            said.append(f"{_look_alike(best, alike)} in any motion of these joints{told}")
    if others:
        told = _join_hints([e.separating_motion for e in _rival_effects(best, others)])
        found = None if out is None else propose_motion(baseline, [best, *others], floor, seed=0)
        if out is None:
            said.append(f"{_look_alike(best, others)} in this record{told}")
        elif found is None:
            said.append(
                f"{_look_alike(best, others)} in this record; no motion of those tried is safe and does: where the "
                "model's shapes touch though the links do not, name these under collision.ignored_pairs of its "
                f"robot.yaml, as `excite init-robot` does{told}"
            )
        else:
            file = FILE
            out.mkdir(parents=True, exist_ok=True)
            save_motion(found.motion.renamed(Path(FILE).stem), out / FILE)
            clear = zip(others, found.from_first > _WORTH, strict=True)
            apart = ", ".join(_place_words(item) for item, yes in clear if yes)
            caution = f"; {found.caution}" if found.caution else ""
            said.append(
                f"{_look_alike(best, others)} in this record; {FILE} is expected to tell {_place_words(best)} "
                f"from {apart} when it is run twice, as an identification and as a validation trial{caution}{told}"
            )
    if second is not None:
        said.append(
            f"{in_words(best.name, None)} and {in_words(second, best.location)} are one and the same in any motion"
            + _join_hints([EFFECTS[best.name].separating_motion])
        )
    return NextExperiment("; ".join(said), separates, file)


def _rival_effects(best: Scored, others: Sequence[Scored]) -> list[Effect]:
    return [item.hypothesis.effect for item in (best, *others)]


def _join_hints(hints: Sequence[str]) -> str:
    """What tells apart, each hint once."""
    known = "; ".join(dict.fromkeys(hint for hint in hints if hint))
    return f"; what tells them apart: {known}" if known else ""


def _look_alike(best: Scored, others: Sequence[Scored]) -> str:
    *names, last = (_place_words(item) for item in (best, *others))
    return f"{', '.join(names)} and {last} look alike"


def _place_words(item: Scored) -> str:
    return in_words(item.name, item.location)


# Expected evidence: how well a motion, added to a record, would tell fitted rivals apart.

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
        fresh = motion_to_trial(self.baseline.samples, motion)
        moments = self._without_own(self._record_moments + self._second_moments(*self._new_rows(fresh)))
        count = int(self.baseline.solver.equations.use.sum()) + len(fresh.rows)
        n = len(self.rivals)
        ratios = np.full((n, n), np.inf)
        alone = [self._expected_nats(moments, count, a, None) for a in range(n)]
        for a, b in permutations(range(n), 2):
            tied = max(THRESHOLDS.rival, THRESHOLDS.alike * alone[a])
            ratios[a, b] = self._expected_nats(moments, count, a, b) / tied
        return ratios

    @cached_property
    def _noise_level(self) -> Array:
        """Noise and what the best rival leaves, ``(n_joints,)`` [N·m]."""
        left = np.min([item.power[:, 0] for item in self.rivals], axis=0)
        return np.maximum(self.floor, np.sqrt(left))

    @cached_property
    def _effective_share(self) -> Array:
        """Effective samples a row, by joint, as the record's residual has them ``(n_joints,)``."""
        use = self.baseline.samples.identification_rows
        return np.minimum(self.rivals[0].count[:, 0] / max(int(use.sum()), 1), 1.0)

    @cached_property
    def _rival_columns(self) -> list[slice]:
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
    def _record_moments(self) -> Array:
        """Moments of the record's identification rows."""
        e = self.baseline.solver.equations
        spread = np.where(self._prior_spread > 0.0, self._prior_spread, 1.0)[:, None]
        bodies = (
            e.shared @ (self.baseline.basis / spread).T
            if self.baseline.free
            else np.zeros((e.n_joints, len(e.use), 0))
        )
        parts = [bodies]
        for item in self.rivals:
            parts += _hypothesis_columns(item.hypothesis, item.hypothesis.columns, bodies.shape[:2])
        # Judged as hypotheses are: standstill counts for next to nothing.
        weight = (self.baseline.strict / self.baseline.root_weight)[:, e.use, None]
        rows = np.concatenate(parts, axis=2)[:, e.use] * weight
        own = [o[e.use] * w for o, w in zip(e.own, weight, strict=True)]
        return self._second_moments(rows, own)

    @cached_property
    def _prior_spread(self) -> Array:
        return prior_spread(model_phi(self.baseline.samples))

    def _new_rows(self, trial: ArmTrial) -> tuple[Array, list[Array]]:
        """Rows ``(n_joints, n_rows, n)`` of a new trial, and each joint's own."""
        baseline = predict_trial(self.baseline, trial)
        samples, root = baseline.samples, baseline.root_weight
        bodies = np.zeros((len(samples.joints), len(trial.rows), 0))
        if baseline.free:
            bodies = samples.body_rows() * self._prior_spread * root[:, :, None]
        context, parts = Context(baseline), [bodies]
        for item in self.rivals:
            h = item.hypothesis
            columns = at_rows(context, h.effect.shape(context, h.location, h.theta))
            parts += _hypothesis_columns(h, columns, bodies.shape[:2])
        terms = own_terms(baseline.modelled)
        own = [baseline.own_rows(terms, j, baseline.signs[j]) for j in range(baseline.n_joints)]
        return np.concatenate(parts, axis=2), own

    def _second_moments(self, rows: Array, own: Sequence[Array]) -> Array:
        """Second moments of the joints' own columns and of all others, ``(n_joints, n, n)``, weighted.

        Joints have as many own columns as the one with most, of those that they lack nothing.
        """
        most = max(o.shape[1] for o in own)
        filled = [np.pad(o, ((0, 0), (most - o.shape[1], 0))) for o in own]
        joined = [np.hstack([o, r]) / s for o, r, s in zip(filled, rows, self._noise_level, strict=True)]
        return np.array([x.T @ x for x in joined])

    def _without_own(self, moments: Array) -> Array:
        """Moments of all other columns with each joint's own projected out."""
        k = moments.shape[1] - self._rival_columns[-1].stop
        own, cross, rest = moments[:, :k, :k], moments[:, :k, k:], moments[:, k:, k:]
        if not k:
            return rest
        ridge = 1e-9 * np.trace(own, axis1=1, axis2=2)[:, None, None] + 1e-12
        return rest - cross.transpose(0, 2, 1) @ np.linalg.solve(own + ridge * np.eye(k), cross)

    def _expected_nats(self, moments: Array, count: int, truth: int, fitted: int | None) -> float:
        """Expected log-likelihood ratio of a rival that is true against a fitted one, or against none."""
        n = self._n_bodies
        target = np.zeros(moments.shape[1])
        target[self._rival_columns[truth].stop - 2] = 1.0
        free = list(range(n))
        if fitted is not None:
            at = self._rival_columns[fitted]
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
        return float(0.5 * count * (self._effective_share * np.log1p(power / count)).sum())


def _hypothesis_columns(item: Hypothesis, columns: Columns, shape: tuple[int, ...]) -> list[Array]:
    """Columns of a hypothesis, then its prediction and its offset, each ``(n_joints, n_rows, …)``."""
    extra = np.zeros((*shape, 0)) if columns.extra is None else columns.extra
    offset = np.zeros(shape) if columns.offset is None else columns.offset
    made = extra @ item.fit.extra + offset
    return [extra, made[:, :, None], offset[:, :, None]]


def predict_trial(baseline: Baseline, trial: ArmTrial) -> Baseline:
    """The fitted baseline's predictions on another trial; its equations stay those of the record."""
    rate = 1.0 / float(trial.time[1] - trial.time[0])
    samples = replace(baseline.samples, trials=(trial,), rate_hz=rate)
    terms, rigid = own_terms(baseline.modelled), samples.rigid_torques(baseline.phi)
    own = [
        own_signals(samples, terms, j, baseline.signs[j]) @ o for j, o in enumerate(baseline.fit.own_coefs)
    ]
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


def motion_to_trial(samples: ArmSamples, motion: Motion, rate_hz: float = _RATE_HZ) -> ArmTrial:
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
