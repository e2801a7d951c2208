"""From hypotheses to a verdict."""

from __future__ import annotations

from dataclasses import dataclass

from excite.diagnosis.answer.result import Verdict
from excite.diagnosis.floating.effects.registry import NAMELESS
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.equations.spectrum import NOT_NOISE, repeat_levels
from excite.diagnosis.floating.search.ranking import DECISIVE, NOISE_SLACK, Ranked, Ranker
from excite.diagnosis.floating.search.refinement import (
    Fitted,
    Placed,
    explained_state,
    nominal_fit,
    refine,
)
from excite.diagnosis.floating.search.together import Step, rivals, search, tied_places
from excite.diagnosis.floating.search.unknown_place import misread_channels

# Share of the power above the noise that the accepted effects must explain.
EXPLAINED = 0.85
# Power left, over the noise's, from which one wrong reading that would leave none is the likelier.
_WRONG_FORM = 4.0


@dataclass(frozen=True, eq=False)
class Attribution:
    """The verdict and what it rests on.

    Attributes:
        verdict: ``none``, ``effect``, ``ambiguous`` or ``unknown``.
        baseline: the baseline's fit.
        steps: for each accepted effect, all its rivals given the others, best first.
        partial: fits of the first accepted effect, of the first two and so on.
        rivals: names that the data cannot tell from the first accepted effect, itself first.
        tied: places that the data cannot tell from each accepted effect's, itself first.
        overdispersion: power that the accepted effects leave over that expected.
        explained: share of the power above the noise that they explain.
    """

    verdict: Verdict
    baseline: Fitted
    steps: tuple[Step, ...]
    partial: tuple[Fitted, ...]
    rivals: tuple[Ranked, ...]
    tied: tuple[tuple[str, ...], ...]
    overdispersion: float
    explained: float

    @property
    def accepted(self) -> Fitted:
        """The fit with all accepted effects."""
        return self.steps[-1][0].fitted if self.steps else self.baseline


def attribute(problem: Problem) -> Attribution:
    """Find effects until the noise is reached or nothing explains what is left, and judge what they leave."""
    baseline = nominal_fit(problem)
    n = len(problem.nominal_rows)
    steps = search(Ranker(problem), baseline)
    current = steps[-1][0].fitted if steps else baseline
    over = max(1.0, current.power / n)
    open_power = baseline.power - n
    explained = 0.0 if open_power <= 0.0 else 1.0 - max(0.0, current.power - n) / open_power
    tied = tuple(tied_places(step, n) for step in steps)
    close = rivals(steps[0], n) if steps else ()
    verdict = _verdict(problem, baseline, steps, close, explained, n)
    if verdict in {"effect", "ambiguous"} and _nameless(problem, current):
        verdict = "unknown"
    patched = current.power > NOISE_SLACK * n and _patches(steps, tied)
    if patched or (steps and current.power > _WRONG_FORM * n and misread_channels(problem, baseline)):
        verdict = "unknown"
    return Attribution(verdict, baseline, steps, _partial(problem, current), close, tied, over, explained)


def _partial(problem: Problem, full: Fitted) -> tuple[Fitted, ...]:
    """Fits of the first effects of a fit, one more each; the last is the fit itself."""
    counts = range(1, len(full.placed))
    first = tuple(refine(problem, full.placed[:k], full.theta[:k], full) for k in counts)
    return (*first, full) if full.placed else ()


def _verdict(
    problem: Problem,
    baseline: Fitted,
    steps: tuple[Step, ...],
    close: tuple[Ranked, ...],
    explained: float,
    n: int,
) -> Verdict:
    quiet = baseline.power < NOISE_SLACK * n and problem.repeatability.repeatable
    if not steps:
        return "none" if quiet else "unknown"
    accepted = steps[-1][0].fitted
    if (accepted.power > NOISE_SLACK * n and explained < EXPLAINED) or not _repeats(problem, accepted):
        return "unknown"
    return "ambiguous" if len(close) > 1 else "effect"


def _patches(steps: tuple[Step, ...], tied: tuple[tuple[str, ...], ...]) -> bool:
    """Whether two effects of one name are at places that the data cannot tell apart: one thing of another form."""
    names = [step[0].last.effect.name for step in steps]
    return any(
        names[i] == names[k] and bool(set(tied[i]) & set(tied[k]))
        for k in range(len(steps))
        for i in range(k)
    )


def _nameless(problem: Problem, fitted: Fitted) -> bool:
    """Whether an effect may as well be something that no word is for."""
    over = max(1.0, fitted.power / len(problem.nominal_rows))
    for k, item in enumerate(fitted.placed):
        if item.effect.word in NAMELESS:
            other = Placed(NAMELESS[item.effect.word], item.location)
            placed = (*fitted.placed[:k], other, *fitted.placed[k + 1 :])
            if refine(problem, placed, fitted.theta, fitted).power < fitted.power + 2.0 * DECISIVE * over:
                return True
    return False


def _repeats(problem: Problem, fitted: Fitted) -> bool:
    """Whether repeated trials differ by no more than noise once a fit's effects are taken out."""
    white = problem.whitening(explained_state(problem, fitted).residual)
    levels = repeat_levels(problem.whitening, white)
    return levels is None or float(levels[: len(levels) // 2].mean()) < NOT_NOISE
