"""What a diagnosis says of the next measurement: a motion where one helps, a reading or a load where none does."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.answer import NextExperiment
from excite.diagnosis.attribution import Attribution, Judgement, Scored
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.next_experiment.candidates import Offer, beyond, joined_motions, near, touching
from excite.diagnosis.next_experiment.evidence import LONGEST_S, Expectation, Information
from excite.motion.files import save_motion
from excite.motion.motion import Motion, MotionMetadata

FILE = "next_experiment.parquet"
# Expected log-likelihood ratio, in units of what ties a pair: safely told apart; worth an experiment.
_SAFELY, _WORTH = 4.0, 1.5
# Score from which a motion within the record is good enough, and what a wider one has to add.
_ENOUGH, _WIDER = 0.9, 0.1
# Motions that may follow each other, and what a further one has to add to the score.
_PARTS, _ADDS = 3, 0.03
_ATTEMPTS = 4


@dataclass(frozen=True, eq=False)
class Proposal:
    """A motion and what it is expected to tell.

    Attributes:
        motion: the motion.
        ratios: ``(n_rivals, n_rivals)`` expected log-likelihood ratios over those at which rivals are tied: row
            true, column fitted.
        caution: what a person has to look at before it is run; may be empty.
        adds: what it would add to the record.
    """

    motion: Motion
    ratios: Array
    caution: str
    adds: Information

    @property
    def score(self) -> float:
        """Share of what may be true that is safely told from what it may be taken for, half-safely in proportion.

        A little is added for more, so that of two motions that tell all apart the clearer one wins.
        """
        pairs = self._off_diagonal
        return float(np.minimum(pairs / _SAFELY, 1.0).mean() + 1e-3 * np.log1p(pairs.min()))

    @property
    def clearest(self) -> float:
        """The largest of the ratios."""
        return float(self._off_diagonal.max())

    @property
    def _off_diagonal(self) -> Array:
        return self.ratios[~np.eye(len(self.ratios), dtype=np.bool_)]

    @property
    def told_apart(self) -> tuple[bool, ...]:
        """By rival after the first, whether it is told from the first if one of the two is true."""
        either = np.maximum(self.ratios[0, 1:], self.ratios[1:, 0])
        return tuple(bool(x) for x in either > _WORTH)


def propose(baseline: Baseline, rivals: Sequence[Scored], floor: Array, seed: int) -> Proposal | None:
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
    expectation = Expectation(baseline, rivals, floor)
    samples = baseline.samples
    targets = sorted({j for r in rivals for j in _joints(r, samples)}, key=samples.joints.index)
    best = _best(expectation, near(samples, targets, seed))
    if best is None or best.score < _ENOUGH:
        other = _best(expectation, beyond(samples, targets, seed))
        if other is not None and (best is None or other.score > best.score + _WIDER):
            best = other
    return best


def _best(expectation: Expectation, offers: Iterable[Offer]) -> Proposal | None:
    """The best safe one; sketches are ranked first, and no more made safe than is needed."""
    ranked = []
    for offer in offers:
        adds = expectation.information(offer.sketch)
        ranked.append((Proposal(offer.sketch, expectation.ratios(adds), offer.caution, adds), offer))
    ranked = [pair for pair in ranked if pair[0].clearest > _WORTH / _PARTS]
    ranked.sort(key=lambda pair: -pair[0].score)
    best: Proposal | None = None
    for expected, offer in ranked[:_ATTEMPTS]:
        if best is not None and best.score >= expected.score:
            break
        found = _made_safe(expectation, expected, offer)
        if found is not None and (best is None or found.score > best.score):
            best = found
    for _ in range(_PARTS - 1):
        if best is None or best.score >= _ENOUGH:
            break
        longer = _longer(expectation, best, ranked)
        if longer is None:
            break
        best = longer
    return best if best is not None and any(best.told_apart) else None


def _made_safe(expectation: Expectation, expected: Proposal, offer: Offer) -> Proposal | None:
    motion = offer.safe()
    if motion is None:
        return None
    if offer.candidate is None:
        return expected
    adds = expectation.information(motion)
    return Proposal(motion, expectation.ratios(adds), offer.caution, adds)


def _longer(
    expectation: Expectation, first: Proposal, ranked: Sequence[tuple[Proposal, Offer]]
) -> Proposal | None:
    """A motion followed by the one, from rest to rest as well, that adds most; None where none adds enough."""
    joining = [
        (Proposal(p.motion, expectation.ratios(first.adds, p.adds), p.caution, p.adds), offer)
        for p, offer in ranked
        if _joins(first.motion, p.motion)
    ]
    joining.sort(key=lambda pair: -pair[0].score)
    for expected, offer in joining[:_ATTEMPTS]:
        if expected.score < first.score + _ADDS:
            break
        second = _made_safe(expectation, expected, offer)
        if second is None or not _joins(first.motion, second.motion):
            continue
        both = Information(first.adds.moments + second.adds.moments, first.adds.rows + second.adds.rows)
        joined = Offer(joined_motions(first.motion, second.motion), offer.robot, None, offer.caution)
        if joined.safe() is not None:
            return Proposal(joined.sketch, expectation.ratios(both), offer.caution, both)
    return None


def _joins(first: Motion, second: Motion) -> bool:
    """Whether one may follow the other: rest to rest, in the same posture."""
    still = np.abs(np.concatenate([first.v[-1], second.v[0], first.a[-1], second.a[0]])).max() < 1e-3
    return bool(still) and bool(np.abs(first.q[-1] - second.q[0]).max() < 1e-4)


def written(proposal: Proposal, out: Path) -> str:
    """Write the motion into a folder and return its file's name."""
    out.mkdir(parents=True, exist_ok=True)
    save_motion(proposal.motion.renamed(Path(FILE).stem), out / FILE)
    return FILE


def _joints(item: Scored, samples: ArmSamples) -> list[str]:
    """Joints that a hypothesis is about: its own, else the one that it changes most."""
    return [item.location] if item.location in samples.joints else [samples.joints[item.place]]


# Rivals that a motion is chosen for, the likeliest.
_MOST = 5


def advice(
    baseline: Baseline, attribution: Attribution, judgement: Judgement, out: Path | None
) -> NextExperiment | None:
    """What would tell apart the names, or the places, that the record leaves open.

    Args:
        baseline: the baseline before the first effect.
        attribution: all its steps.
        judgement: the verdict on it.
        out: folder for the motion; none is planned without it.

    Returns:
        The advice; None where nothing is open.
    """
    if judgement.verdict not in {"effect", "ambiguous"}:
        return None
    best, others = attribution.accepted[0], _others(attribution, judgement)
    second = judgement.renamed[0]
    if not others and second is None:
        return None
    separates = [f"{best.name}@{best.location}", *([f"{second}@{best.location}"] if second else [])]
    separates += [f"{item.name}@{item.location}" for item in others]
    said = []
    file = None
    if others:
        floor = np.maximum(attribution.floor, baseline.solver.equations.floor)
        alike = alike_in_any(baseline, [best, *others], floor)
        twins = [item for item, same in zip(others, alike, strict=True) if same]
        others = [item for item, same in zip(others, alike, strict=True) if not same]
        if twins:
            said.append(_of_no_motion(best, twins))
    if others:
        proposal = None
        untold = ""
        if out is not None:
            proposal = propose(baseline, [best, *others], floor, seed=0)
            file = None if proposal is None else written(proposal, out)
            untold = _no_motion(touching(baseline.samples)) if proposal is None else ""
        said.append(_of_motion(best, others, proposal, file, untold))
    if second is not None:
        said.append(
            f"{_words(best.name)} and {_words(second)} at {best.location} are one and the same in any motion; "
            f"what tells them apart: {EFFECTS[best.name].separating_motion}"
        )
    return NextExperiment("; ".join(said), tuple(separates), file)


def _others(attribution: Attribution, judgement: Judgement) -> list[Scored]:
    """Rivals of another name, then other places of the same."""
    tied = judgement.tied[0][1:]
    best = attribution.accepted[0]
    places = [s for s in attribution.stages[0].ranking if s.name == best.name and s.location in tied]
    return [*judgement.rivals, *places][:_MOST]


def _no_motion(touching: tuple[str, ...]) -> str:
    """Why no motion is proposed."""
    if not touching:
        return "no safe motion of those tried does"
    pairs = ", ".join(touching[:_MOST]) + (", …" if len(touching) > _MOST else "")
    return (
        f"no motion can be judged safe, for the model's shapes of {pairs} touch where this record has been: name "
        "pairs that cannot touch in collision.ignored_pairs of its robot.yaml, as `excite init-robot` does, and "
        "diagnose again"
    )


def _of_motion(
    best: Scored, others: list[Scored], proposal: Proposal | None, file: str | None, untold: str
) -> str:
    names = [_place(best), *(_place(item) for item in others)]
    alike = f"{', '.join(names[:-1])} and {names[-1]} look alike in this record"
    hints = dict.fromkeys(item.hypothesis.effect.separating_motion for item in (best, *others))
    told = f"what tells them apart: {'; '.join(hint for hint in hints if hint)}"
    if proposal is None:
        return f"{alike}; {untold}; {told}" if untold else f"{alike}; {told}"
    apart = [_place(item) for item, yes in zip(others, proposal.told_apart, strict=True) if yes]
    text = f"{alike}; {file} is expected to tell {_place(best)} from {', '.join(apart)}"
    text += " when it is run twice, as an identification and as a validation trial"
    if proposal.caution:
        text += f"; {proposal.caution}"
    return f"{text} (also: {told})"


def _of_no_motion(best: Scored, others: list[Scored]) -> str:
    names = [_place(best), *(_place(item) for item in others)]
    hints = dict.fromkeys(item.hypothesis.effect.without_motion for item in (best, *others))
    told = "; ".join(hint for hint in hints if hint)
    alike = f"{', '.join(names[:-1])} and {names[-1]} look alike in any motion of these joints"
    return f"{alike}; what tells them apart: {told}" if told else alike


def _place(item: Scored) -> str:
    return f"{_words(item.name)} at {item.location}"


def _words(name: str) -> str:
    return name.replace("_", " ")


# Whether any motion at all would tell rivals apart: one through the whole range, whether or not it is safe.

# Sines of each joint [Hz], all others' a little faster: the rows' filter passes them.
_TURNS_HZ, _APART = (0.11, 0.27, 0.61, 1.3), 0.13
_RATE_HZ = 100.0
# Expected log-likelihood ratio, in units of what ties a pair, that is none. A body on a SCARA's second axis and a rotor
# on its first have 0.03, by the little that the body takes up elsewhere; a spring and an eccentric of a Panda's first
# joint, which other motions tell apart, have 1.3.
_NOTHING = 0.1


def alike_in_any(baseline: Baseline, rivals: Sequence[Scored], floor: Array) -> tuple[bool, ...]:
    """By rival after the first, whether no motion would tell it from the first.

    Args:
        baseline: the baseline before the first effect.
        rivals: hypotheses that the record cannot tell apart, the accepted one first.
        floor: ``(n_joints,)`` noise in the rows' band [N·m].
    """
    expectation = Expectation(baseline, rivals, floor)
    ratios = expectation.ratios(expectation.information(through_everything(baseline.samples)))
    either = np.maximum(ratios[0, 1:], ratios[1:, 0])
    return tuple(bool(ratio < _NOTHING) for ratio in either)


def through_everything(samples: ArmSamples) -> Motion:
    """Sines of all joints over their whole range, as fast as their limits of speed allow."""
    robot = samples.robot
    limits, n = robot.limits, robot.n_joints
    low, high = np.maximum(limits.position_lower, -np.pi), np.minimum(limits.position_upper, np.pi)
    t = np.arange(round(LONGEST_S * _RATE_HZ)) / _RATE_HZ
    q, v, a = (np.zeros((len(t), n)) for _ in range(3))
    for j in range(n):
        turning = 2.0 * np.pi * np.array(_TURNS_HZ) * (1.0 + _APART * j)
        size = np.minimum(0.5 * (high[j] - low[j]), limits.velocity[j] / turning) / len(turning)
        # Golden angles: no two joints swing together.
        phase = np.outer(t, turning) + 2.4 * np.arange(len(turning)) + 2.4 * j
        q[:, j] = 0.5 * (low[j] + high[j]) + np.sin(phase) @ size
        v[:, j] = np.cos(phase) @ (size * turning)
        a[:, j] = -np.sin(phase) @ (size * turning**2)
    metadata = MotionMetadata(generator="everything", targets=samples.joints, robot_hash=robot.hash)
    return Motion("everything", robot.name, robot.joint_names, t, q, v, a, metadata=metadata)
