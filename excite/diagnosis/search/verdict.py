"""From an attribution to a verdict: effect, none, ambiguous or unknown."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.result import Verdict
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.search.attribution import Attribution, Scored
from excite.diagnosis.search.gates import Gates
from excite.diagnosis.search.structured import structured_joints

# Rivals within so many nats, or so small a share of the evidence, are not told apart.
_TIE_NATS, _TIE_SHARE = 10.0, 0.015
# The same share where one effect's richer form runs into the other effect.
_KIN_SHARE = 0.25
# Share of what the best removes at its place that a rival has to remove there.
_SAME = 0.6
# An effect that leaves half of the amplitude at its own place, well above the noise, is not what is there.
_EXPLAINED = 0.75
# What a moving link does to other joints tells it from what is not in the library.
_EXPLAINED_COUPLED = 0.5
# Nor those of several at one place that leave so many times the floor's power there, nor one of that joint alone.
_PATCHED, _WHOLE, _PARTLY = 50.0, 0.98, 0.9
# Nor is one that removes so little of the whole gap where the rest is structured.
_TRIFLE = 0.1


@dataclass(frozen=True, eq=False)
class Judgement:
    """A verdict and what it rests on.

    Attributes:
        verdict: effect, none, ambiguous or unknown.
        rivals: other effects that explain as much as the first accepted one.
        twins: by position in ``rivals``, a second name that means the same in the data.
        tied: by position in the accepted effects, places that cannot be told from the effect's.
        renamed: by position, a second name that means the same in the data (bias and asymmetry).
        structured: joints whose residual stands above the noise, most first.
        explained: share of the power above the floor that all accepted effects surely remove at the first one's
            place: less one standard deviation.
    """

    verdict: Verdict
    rivals: tuple[Scored, ...]
    tied: tuple[tuple[str, ...], ...]
    renamed: tuple[str | None, ...]
    structured: tuple[str, ...]
    explained: float = 1.0
    twins: tuple[str | None, ...] = ()


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
    if attribution.stranger is not None:
        place = attribution.stranger.location
        structured = (place, *(name for name in structured if name != place))
    if not accepted:
        return Judgement("unknown" if structured else "none", (), (), (), structured)
    place = attribution.final.samples.joints[accepted[0].place]
    explained = float(explained_shares(attribution, spectral)[accepted[0].place])
    coupled = accepted[0].hypothesis.effect.moves and accepted[0].elsewhere > Gates.elsewhere
    least = _EXPLAINED_COUPLED if coupled else _EXPLAINED
    # A body that would leave a link less than no mass takes up what something else does.
    poor = place in structured and (explained < least or _patched(attribution, spectral))
    if poor or not accepted[0].hypothesis.physical:
        others = tuple(name for name in structured if name != place)
        return Judgement("unknown", (), (), (), (place, *others), explained)
    if structured and _explained_of_all(attribution, spectral) < _TRIFLE:
        return Judgement("unknown", (), (), (), structured, explained)
    faint = accepted[0].stands < Gates.stands
    # What differs between repeated trials may be the effect itself: of a faint one the noise of a trial is asked.
    explained = min(accepted[0].of_noise, 1.0) if faint else max(explained - _unsure(accepted[0]), 0.0)
    rivals = _rivals(accepted[0], steps[0].ranking)
    ambiguous = bool(rivals) or renamed[0] is not None
    twins = tuple(_second_name(item, attribution.final) for item in rivals)
    verdict: Verdict = "ambiguous" if ambiguous else "effect"
    return Judgement(verdict, rivals, tied, renamed, structured, explained, twins)


def withdrawn(attribution: Attribution, baseline: Baseline) -> Attribution:
    """The attribution with nothing accepted, its first ranking kept.

    Args:
        attribution: all its steps.
        baseline: the baseline that they began with.
    """
    first = replace(attribution.stages[0], accepted=None)
    return replace(attribution, stages=(first,), after=attribution.before, final=baseline)


def _patched(attribution: Attribution, spectral: Array) -> bool:
    """Whether a gap at one place has been patched up, by several effects there or by a poor one, and still stands."""
    first = attribution.accepted[0]
    here = sum(item.place == first.place for item in attribution.accepted)
    least = _WHOLE if here > 1 else (_PARTLY if first.hypothesis.effect.own_joint else 0.0)
    _, left = _above(attribution, spectral)
    floor = float(np.maximum(attribution.floor, spectral)[first.place]) ** 2
    stands = float(left[first.place]) / floor
    explained = float(explained_shares(attribution, spectral)[first.place])
    return stands > _PATCHED and explained < least


def explained_shares(attribution: Attribution, spectral: Array) -> Array:
    """Share of each joint's power above the floor that the accepted effects remove, ``(n_joints,)``, 0…1."""
    old, new = _above(attribution, spectral)
    return np.clip(1.0 - new / np.maximum(old, 1e-300), 0.0, 1.0)


def _explained_of_all(attribution: Attribution, spectral: Array) -> float:
    """Share of the whole normalised power above the floor that the accepted effects remove."""
    old, new = (float((power / attribution.scale**2).sum()) for power in _above(attribution, spectral))
    return 1.0 - new / max(old, 1e-300)


def _above(attribution: Attribution, spectral: Array) -> tuple[Array, Array]:
    """Power above the floor without and with the accepted effects, ``(n_joints,)`` each [(N·m)²]."""
    final, floor = attribution.final, np.maximum(attribution.floor, spectral) ** 2
    old, new = (
        np.maximum((final.judged(fit.residual) ** 2).mean(axis=1) - floor, 0.0)
        for fit in (attribution.before, attribution.after)
    )
    return old, new


def nats_behind(best: Scored, other: Scored) -> float:
    """How much less likely another hypothesis is, by the effective samples of what the best one leaves [nats]."""
    logs = np.log(np.maximum(other.power, 1e-300) / np.maximum(best.power, 1e-300))
    return float(0.5 * (best.count * logs).sum()) + other.price - best.price


def same_gap(best: Scored, other: Scored) -> bool:
    """Whether another hypothesis explains the gap that the best one explains, not one at other joints."""
    return float(other.closed[best.place]) >= _SAME * float(best.closed[best.place])


def tie(evidence: float) -> float:
    """How far a hypothesis with this evidence may lead another that is still not told apart from it [nats]."""
    return max(_TIE_NATS, _TIE_SHARE * evidence)


def _close(best: Scored, other: Scored) -> bool:
    kin = other.name in best.hypothesis.effect.overlaps
    # How a contact comes on is nobody's law: the form that was tried may be off by more than the rivals are.
    least = _KIN_SHARE * best.evidence if kin else tie(best.evidence)
    return same_gap(best, other) and nats_behind(best, other) < least


def probabilities(
    best: Scored, ranking: tuple[Scored, ...], explained: float = 1.0
) -> dict[tuple[str, str], float]:
    """Probability of each name and place that explains the same gap; something outside the library has the rest.

    Likelihoods are tempered: where a tie is called, the odds are about 20 to 1, and what a model leaves of a
    strong effect is no noise, and grows with it. Where power stands ``φ`` times above what the noise leaves, a
    nat counts for ``1/φ`` (quasi-likelihood, Wedderburn 1974). What all candidates leave unexplained is
    evidence of something that none of them is; it gets that share.

    Args:
        best: the accepted hypothesis.
        ranking: all that were tried against it.
        explained: share of the power above the floor that is removed at its place, 0…1.

    Returns:
        By effect and location; they sum to ``explained``.
    """
    dispersion = 1.0 + (1.0 - explained) * max(best.stands - 1.0, 0.0)
    width = dispersion * tie(best.evidence) / 3.0
    rivals = [item for item in ranking if same_gap(best, item)]
    known = {(item.name, item.location): item for item in rivals} | {(best.name, best.location): best}
    weight = {key: np.exp(-max(nats_behind(best, item), 0.0) / width) for key, item in known.items()}
    total = float(sum(weight.values())) / explained if explained > 0.0 else np.inf
    return {key: float(value) / total for key, value in weight.items()}


def _unsure(item: Scored) -> float:
    """Standard deviation of the share explained: a power of n effective samples is known to √(2/n) of itself."""
    return float(np.sqrt(2.0 / max(item.count[item.place].sum(), 2.0)) / max(item.stands - 1.0, 1e-9))


def _tied(best: Scored, ranking: tuple[Scored, ...]) -> tuple[str, ...]:
    same = [s for s in ranking if s.name == best.name and s.location != best.location and _close(best, s)]
    return (best.location, *(s.location for s in same if s.hypothesis.physical))


def _rivals(best: Scored, ranking: tuple[Scored, ...]) -> tuple[Scored, ...]:
    """Other names that explain as much, one place each, without those that contain the best as a special case."""
    found: dict[str, Scored] = {}
    for item in ranking:
        contains = set(_columns(best)) <= set(_columns(item)) and item.location == best.location
        can_be = item.hypothesis.physical and item.hypothesis.settled
        if item.name == best.name or contains or not _close(best, item) or not can_be:
            continue
        found.setdefault(item.name, item)
    return tuple(found.values())


def _columns(item: Scored) -> tuple[str, ...]:
    return item.hypothesis.effect.spans or (item.name,)


def _second_name(item: Scored, final: Baseline) -> str | None:
    """Another name that means the same in the data."""
    return item.hypothesis.effect.second_name(final, item.location, item.hypothesis.fit)
