"""A verdict and what it rests on."""

from __future__ import annotations

from dataclasses import dataclass, replace

from excite.diagnosis.answer.result import Verdict
from excite.diagnosis.attribution.attribution import Attribution, Scored
from excite.diagnosis.equations.baseline import Baseline


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


def withdrawn(attribution: Attribution, baseline: Baseline) -> Attribution:
    """The attribution with nothing accepted, its first ranking kept.

    Args:
        attribution: all its steps.
        baseline: the baseline that they began with.
    """
    first = replace(attribution.stages[0], accepted=None)
    return replace(attribution, stages=(first,), after=attribution.before, final=baseline)
