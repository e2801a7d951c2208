"""What a diagnosis says of the next measurement: a motion where one helps, a reading or a load where none does."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.answer import NextExperiment
from excite.diagnosis.answer.candidate import in_words
from excite.diagnosis.attribution import Attribution, Judgement, Scored
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.next_experiment.candidates import Offer, draw_motions, through_everything
from excite.diagnosis.next_experiment.evidence import Expectation
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
    def score(self) -> float:
        """Share of what may be true that is safely told from what it may be taken for, half-safely in proportion.

        A little is added for more, so that of two motions that tell all apart the clearer one wins.
        """
        pairs = self.ratios[~np.eye(len(self.ratios), dtype=np.bool_)]
        return float(np.minimum(pairs / _SAFELY, 1.0).mean() + 1e-3 * np.log1p(pairs.min()))

    @property
    def from_first(self) -> Array:
        """By rival after the first, the ratio at which it is told from the first if one of the two is true."""
        return np.maximum(self.ratios[0, 1:], self.ratios[1:, 0])


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
    expectation, samples = Expectation(baseline, rivals, floor), baseline.samples
    targets = sorted({_joint(item, samples) for item in rivals}, key=samples.joints.index)
    best = _best(expectation, draw_motions(samples, targets, seed, wide=False))
    if best is None or best.score < _ENOUGH:
        other = _best(expectation, draw_motions(samples, targets, seed, wide=True))
        if other is not None and (best is None or other.score > best.score + _WIDER):
            best = other
    return best


def _best(expectation: Expectation, offers: Iterable[Offer]) -> Proposal | None:
    """The best safe one; sketches are ranked first, and no more made safe than is needed."""

    def expected(motion: Motion, offer: Offer) -> Proposal:
        return Proposal(motion, expectation.with_motion(motion), offer.caution)

    ranked = [(expected(offer.sketch, offer), offer) for offer in offers]
    ranked = [pair for pair in ranked if pair[0].from_first.max() > _WORTH]
    best: Proposal | None = None
    for sketched, offer in sorted(ranked, key=lambda pair: -pair[0].score)[:_ATTEMPTS]:
        if best is not None and best.score >= sketched.score:
            break
        motion = offer.safe()
        if motion is not None:
            found = sketched if motion is offer.sketch else expected(motion, offer)
            if found.from_first.max() > _WORTH and (best is None or found.score > best.score):
                best = found
    return best


def _joint(item: Scored, samples: ArmSamples) -> str:
    """The joint that a hypothesis is about: its own, else the one that it changes most."""
    return item.location if item.location in samples.joints else samples.joints[item.place]


def advice(attribution: Attribution, judgement: Judgement, out: Path | None) -> NextExperiment | None:
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
    if others:
        floor = np.maximum(attribution.floor, baseline.solver.equations.floor)
        ratios = Expectation(baseline, [best, *others], floor).with_motion(
            through_everything(baseline.samples)
        )
        twins = np.maximum(ratios[0, 1:], ratios[1:, 0]) < _NOTHING
        alike = [item for item, is_twin in zip(others, twins, strict=True) if is_twin]
        others = [item for item, is_twin in zip(others, twins, strict=True) if not is_twin]
        if alike:
            told = _hints([e.without_motion for e in _effects(best, alike)])
            said.append(f"{_look_alike(best, alike)} in any motion of these joints{told}")
    if others:
        told = _hints([e.separating_motion for e in _effects(best, others)])
        found = None if out is None else propose(baseline, [best, *others], floor, seed=0)
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
            apart = ", ".join(_place(item) for item, yes in clear if yes)
            caution = f"; {found.caution}" if found.caution else ""
            said.append(
                f"{_look_alike(best, others)} in this record; {FILE} is expected to tell {_place(best)} from {apart} "
                f"when it is run twice, as an identification and as a validation trial{caution}{told}"
            )
    if second is not None:
        said.append(
            f"{in_words(best.name, None)} and {in_words(second, best.location)} are one and the same in any motion"
            + _hints([EFFECTS[best.name].separating_motion])
        )
    return NextExperiment("; ".join(said), separates, file)


def _effects(best: Scored, others: Sequence[Scored]) -> list[Effect]:
    return [item.hypothesis.effect for item in (best, *others)]


def _hints(hints: Sequence[str]) -> str:
    """What tells apart, each hint once."""
    known = "; ".join(dict.fromkeys(hint for hint in hints if hint))
    return f"; what tells them apart: {known}" if known else ""


def _look_alike(best: Scored, others: Sequence[Scored]) -> str:
    *names, last = (_place(item) for item in (best, *others))
    return f"{', '.join(names)} and {last} look alike"


def _place(item: Scored) -> str:
    return in_words(item.name, item.location)
