"""What a diagnosis says of the next measurement: a motion where one helps, a reading or a load where none does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.answer import NextExperiment
from excite.diagnosis.attribution import Attribution, Judgement, Scored
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.next_experiment.candidates import touching
from excite.diagnosis.next_experiment.choice import propose, written
from excite.diagnosis.next_experiment.evidence import LONGEST_S, Expectation
from excite.motion.motion import Motion, MotionMetadata

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
