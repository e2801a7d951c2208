"""What to measure next: of a few safe motions the one on which rivals' predictions differ most."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.attribution import Scored
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.next_experiment.candidates import Offer, beyond, joined_motions, near
from excite.diagnosis.next_experiment.evidence import Expectation, Information
from excite.motion.files import save_motion
from excite.motion.motion import Motion

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
