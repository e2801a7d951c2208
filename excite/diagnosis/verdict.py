"""From an attribution to a verdict: effect, none, ambiguous or unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.diagnosis.attribute import Attribution, Scored
from excite.diagnosis.baseline import Baseline
from excite.diagnosis.evidence import effective_counts
from excite.diagnosis.result import Verdict
from excite.robot.robot import Array

# Rivals within so many nats, or so small a share of the evidence, are not told apart.
_TIE_NATS, _TIE_SHARE = 10.0, 0.015
_STRUCTURED, _STRUCTURED_NATS = 2.0, 20.0


@dataclass(frozen=True, eq=False)
class Judgement:
    """A verdict and what it rests on.

    Attributes:
        verdict: effect, none, ambiguous or unknown.
        rivals: other effects that explain as much as the first accepted one.
        tied: by position in the accepted effects, places that cannot be told from the effect's.
        renamed: by position, a second name that means the same in the data (bias and asymmetry).
        structured: joints whose residual stands above the noise, most first.
    """

    verdict: Verdict
    rivals: tuple[Scored, ...]
    tied: tuple[tuple[str, ...], ...]
    renamed: tuple[str | None, ...]
    structured: tuple[str, ...]


def judge(attribution: Attribution, spectral: Array) -> Judgement:
    """The verdict on an attribution.

    Args:
        attribution: all its steps.
        spectral: ``(n_joints,)`` spectral noise floor [N·m].

    Returns:
        The judgement.
    """
    accepted = attribution.accepted
    steps = [s for s in attribution.stages if s.accepted is not None]
    tied = tuple(_tied(step.accepted, step.ranking) for step in steps if step.accepted)
    renamed = tuple(_second_name(s, attribution.final) for s in accepted)
    structured = structured_joints(attribution, spectral)
    if not accepted:
        return Judgement("unknown" if structured else "none", (), (), (), structured)
    rivals = _rivals(accepted[0], steps[0].ranking)
    ambiguous = bool(rivals) or renamed[0] is not None
    return Judgement("ambiguous" if ambiguous else "effect", rivals, tied, renamed, structured)


def structured_joints(attribution: Attribution, spectral: Array) -> tuple[str, ...]:
    """Joints whose residual after all accepted effects is significantly more than noise."""
    samples = attribution.final.samples
    residual, use = attribution.final.judged(attribution.after.residual), samples.identification
    counts = effective_counts(residual, use, samples.trial_of_row).sum(axis=1)
    power = (residual**2).mean(axis=1)
    floor = np.maximum(attribution.floor, spectral) ** 2
    ratio = power / floor
    nats = 0.5 * counts * (ratio - 1.0 - np.log(np.maximum(ratio, 1.0)))
    found = [j for j in range(len(ratio)) if ratio[j] > _STRUCTURED and nats[j] > _STRUCTURED_NATS]
    return tuple(samples.joints[j] for j in sorted(found, key=lambda j: -ratio[j]))


def _close(best: Scored, other: Scored) -> bool:
    return best.evidence - other.evidence < max(_TIE_NATS, _TIE_SHARE * best.evidence)


def _tied(best: Scored, ranking: tuple[Scored, ...]) -> tuple[str, ...]:
    same = [s for s in ranking if s.name == best.name and s.location != best.location and _close(best, s)]
    return (best.location, *(s.location for s in same))


def _rivals(best: Scored, ranking: tuple[Scored, ...]) -> tuple[Scored, ...]:
    """Other names that explain as much, one place each, without those that contain the best as a special case."""
    found: dict[str, Scored] = {}
    for item in ranking:
        contains = set(_columns(best)) <= set(_columns(item)) and item.location == best.location
        if item.name == best.name or contains or not _close(best, item):
            continue
        found.setdefault(item.name, item)
    return tuple(found.values())


_CONTAINED = {"torque_bias": ("1",), "joint_spring": ("q", "1")}


def _columns(item: Scored) -> tuple[str, ...]:
    return _CONTAINED.get(item.name, (item.name,))


def _second_name(item: Scored, final: Baseline) -> str | None:
    """A constant no larger than the Coulomb level may be friction that differs between directions."""
    if item.name != "torque_bias" or "coulomb_friction" not in final.modelled:
        return None
    own = final.fit.own[final.samples.joints.index(item.location)]
    level = abs(float(own[1 if "viscous_friction" in final.modelled else 0]))
    return "coulomb_asymmetry" if abs(float(item.hypothesis.fit.extra[0])) <= 1.1 * level else None
