"""What a diagnosis says of the next measurement: a motion where one helps, a reading or a load where none does."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from excite.diagnosis.answer.result import NextExperiment
from excite.diagnosis.attribution.attribution import Attribution, Scored
from excite.diagnosis.attribution.judgement import Judgement
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.next_experiment.any_motion import alike_in_any

if TYPE_CHECKING:
    from excite.diagnosis.next_experiment.choice import Proposal

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
            # The filter, its checks and the generators, for the few records that leave something open.
            from excite.diagnosis.next_experiment.candidates import touching  # lazy: coal
            from excite.diagnosis.next_experiment.choice import propose, written  # lazy: pyarrow

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
