"""Which effects together: the selection over all that may be there, each polished beside the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.answer import held_out_gain
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.search.ranking import (
    DECISIVE,
    NOISE_SLACK,
    Ranked,
    Ranker,
    by_evidence,
    overdispersion,
)
from excite.diagnosis.floating.search.refinement import (
    Fitted,
    Placed,
    effect_columns,
    explained_state,
    nominal_fit,
    refine,
)
from excite.diagnosis.selection import sampler
from excite.progress import step

# Nats that an effect must have, after the number of places is paid for, to be there at all.
SIGNIFICANT = 8.0
# Share of the power above the noise that an effect must close, of what is open without it and of all; more where
# another of its kind is there, since that is what an approximate form leaves behind.
_OF_OPEN, _OF_ALL, _SAME_OF_ALL = 0.3, 0.002, 0.1
# Nats where the others leave no more than noise may be.
_WITHIN_NOISE = 25.0
# Where a form is seen to be wrong, others that leave this share more are as wrong as it is.
FORM_DOUBT = 0.1
# Share of the noise's power by which noise in the regressors' kinematics prefers one place to another.
_LITTLE_OF_NOISE = 0.1
_TURNS, _PER_MODEL, _MOST_EFFECTS = 5, 16, 3
# Deviation of what of a polished contribution no parameter changes, in units of itself.
_POLISHED = 0.02

Step = tuple[Ranked, ...]


@step("look for effects")
def search(ranker: Ranker, baseline: Fitted) -> tuple[Step, ...]:
    """Effects that explain a record, each with its rivals, the accepted one first.

    By turns, what may be there is polished beside the likeliest model and beside each that lacks one of its effects;
    the likeliest model of all these comes next. So an effect that imitates two a little gives way to both.

    Args:
        ranker: of the problem.
        baseline: the baseline's fit.
    """
    problem, current, models = ranker.problem, baseline, [baseline]
    pool: dict[int, _Atom] = {}
    for _ in range(_TURNS):
        rests = [_without(problem, current, k) for k in range(len(current.placed))]
        for beside in (current, *rests, *(_rival(ranker(rest), current) for rest in rests if rest.placed)):
            for item in ranker(beside)[:_PER_MODEL]:
                pool.setdefault(id(item), _Atom.of(ranker.coarse, item))
        current = _needed(problem, _likeliest(ranker, baseline, current, [*pool.values()]), baseline)
        known = any(_places(current) == _places(model) for model in models)
        models.append(current)
        if known:
            break
    return _steps(ranker, current)


def _rival(ranked: Sequence[Ranked], current: Fitted) -> Fitted:
    """The likeliest of what stands in an effect's place under a name that the model has not; the model if none."""
    names = {item.effect.name for item in current.placed}
    return next((item.fitted for item in ranked if item.last.effect.name not in names), current)


def _places(fitted: Fitted) -> set[tuple[str, str]]:
    return {(item.effect.word, item.location) for item in fitted.placed}


def _without(problem: Problem, fitted: Fitted, k: int) -> Fitted:
    """A fit without one of its effects."""
    placed, theta = fitted.placed[:k] + fitted.placed[k + 1 :], fitted.theta[:k] + fitted.theta[k + 1 :]
    return refine(problem, placed, theta, fitted) if placed else nominal_fit(problem)


@dataclass(frozen=True, eq=False)
class _Atom:
    """What an effect makes of the rows, polished beside others.

    Attributes:
        item: the effect among its rivals.
        columns: ``(m, 1 + k)`` whitened: what no change of its parameters makes, then these in units of their scales.
    """

    item: Ranked
    columns: Array

    @classmethod
    def of(cls, problem: Problem, item: Ranked) -> _Atom:
        """The last effect of a fit, beside the others in it."""
        fitted, placed, theta = item.fitted, item.last, item.fitted.theta[-1]
        others = replace(fitted, placed=fitted.placed[:-1], theta=fitted.theta[:-1])
        state = explained_state(problem, others)
        columns = effect_columns(problem, state, placed.effect, placed.location, theta)
        made = problem.rows(state) - problem.rows(placed.effect.apply(state, placed.location, theta))
        scaled = theta / placed.effect.scales(problem.nominal, placed.location)
        return cls(item, np.column_stack([made - columns @ scaled, columns]))

    @property
    def group(self) -> tuple[str, str]:
        """Of which at most one is in a model: an effect at a place."""
        return self.item.last.effect.name, self.item.last.location


def _likeliest(ranker: Ranker, baseline: Fitted, current: Fitted, pool: Sequence[_Atom]) -> Fitted:
    """The likeliest model of what is in a pool, fitted together, in noise as loud as the best one leaves."""
    atoms = sorted(pool, key=lambda atom: atom.group)
    if not atoms:
        return baseline
    least = min((current, *(atom.item.fitted for atom in atoms)), key=lambda fit: fit.power)
    posed = _posed(ranker.coarse, atoms, overdispersion(ranker.problem, least))
    mode = sampler.climb(posed, np.full(len(posed.begin), -1, dtype=np.int64))
    lost = {}
    for g in np.flatnonzero(mode >= 0):
        rest = np.where(np.arange(len(mode)) == g, -1, mode)
        lost[int(mode[g])] = float(sampler.gains_beside(posed, rest)[mode[g]])
    chosen = [atoms[a].item for a in sorted(lost, key=lambda a: -lost[a])[:_MOST_EFFECTS]]
    if not chosen:
        return baseline
    theta = tuple(item.fitted.theta[-1] for item in chosen)
    return refine(ranker.problem, tuple(item.last for item in chosen), theta, current)


def _posed(problem: Problem, atoms: Sequence[_Atom], over: float) -> sampler.Problem:
    """The selection problem of atoms that stand group by group, in noise of ``over`` times the power expected."""
    columns = np.hstack([atom.columns for atom in atoms])
    rows = problem.nominal_rows
    shadow, seen = problem.project(columns), problem.project(rows)
    width = np.array([atom.columns.shape[1] for atom in atoms], dtype=np.int64)
    first = np.cumsum(width) - width
    precision, mean = np.ones(len(columns.T)), np.zeros(len(columns.T))
    precision[first], mean[first] = _POLISHED**-2.0, 1.0
    groups = list(dict.fromkeys(atom.group for atom in atoms))
    group = np.array([groups.index(atom.group) for atom in atoms], dtype=np.int64)
    count = np.bincount(group)
    odds = [-SIGNIFICANT - atom.item.choice - atom.item.last.effect.price for atom in atoms]
    free = np.full(len(mean), 1e30)
    return sampler.Problem(
        gram=np.ascontiguousarray((columns.T @ columns - shadow.T @ shadow) / over),
        right=(columns.T @ rows - shadow.T @ seen) / over + precision * mean,
        precision=precision,
        constant=-0.5 * precision * mean**2,
        low=-free,
        high=free,
        mass=np.zeros(len(mean)),
        first=first,
        width=width,
        group=group,
        log_prior=np.array(odds),
        begin=np.cumsum(count) - count,
        n_atoms=count,
        needs=np.full(len(count), -1, dtype=np.int64),
    )


def _needed(problem: Problem, fitted: Fitted, baseline: Fitted) -> Fitted:
    """A fit without effects that the others make superfluous, the least needed first."""
    while fitted.placed:
        rests = [_without(problem, fitted, k) for k in range(len(fitted.placed))]
        spared = [k for k, rest in enumerate(rests) if not _is_needed(problem, fitted, rest, k, baseline)]
        if not spared:
            break
        fitted = rests[min(spared, key=lambda k: rests[k].power)]
    if len(fitted.placed) < 2:
        return fitted
    order = sorted(range(len(fitted.placed)), key=lambda k: -rests[k].power)
    placed, theta = tuple(fitted.placed[k] for k in order), tuple(fitted.theta[k] for k in order)
    return refine(problem, placed, theta, fitted)


def _is_needed(problem: Problem, fitted: Fitted, rest: Fitted, k: int, baseline: Fitted) -> bool:
    """Whether an effect closes what counts beside the others, on the trials that check it too."""
    n, item = len(problem.nominal_rows), fitted.placed[k]
    others = fitted.placed[:k] + fitted.placed[k + 1 :]
    closed, left = rest.power - fitted.power, max(0.0, rest.power - n)
    nats = 0.5 * closed / max(1.0, fitted.power / n) - (fitted.price - rest.price)
    within = bool(others) and rest.power < NOISE_SLACK * n
    if nats < (_WITHIN_NOISE if within else SIGNIFICANT) or closed < item.effect.least_shrink * n:
        return False
    if others and not within:
        of_all = _SAME_OF_ALL if any(_is_alike(other, item) for other in others) else _OF_ALL
        if closed < max(_OF_OPEN * left, of_all * (baseline.power - n)):
            return False
    return held_out_gain(problem, rest, fitted) > 0.0


def _is_alike(found: Placed, further: Placed) -> bool:
    """Whether a further effect may be what an approximate form of one that was found leaves."""
    same_place = found.location == further.location
    return found.effect.name == further.effect.name or (
        same_place and further.effect.name in found.effect.leaves
    )


def _steps(ranker: Ranker, accepted: Fitted) -> tuple[Step, ...]:
    """For each effect of a fit its rivals beside the others, itself first; the last step's first fit is the whole."""
    problem, steps = ranker.problem, []
    for k, item in enumerate(accepted.placed):
        others = _without(problem, accepted, k)
        ranked = ranker(others)
        own = [
            r for r in ranked if (r.last.effect.word, r.last.location) == (item.effect.word, item.location)
        ]
        choice = own[0].choice if own else 0.0
        turned = [i for i in range(len(accepted.placed)) if i != k] + [k]
        placed, theta, std = accepted.placed, accepted.theta, accepted.std
        whole = replace(
            accepted,
            placed=tuple(placed[i] for i in turned),
            theta=tuple(theta[i] for i in turned),
            std=tuple(std[i] for i in turned),
        )
        rest = [r for r in ranked if r not in own]
        ranked = by_evidence(
            [(r.fitted, r.choice) for r in (Ranked(whole, 0.0, choice), *rest)], others, problem
        )
        mine = next(r for r in ranked if r.fitted is whole)
        steps.append((mine, *(r for r in ranked if r is not mine)))
    return tuple(steps)


def tied_places(step: Step, n: int) -> tuple[str, ...]:
    """Places that the data cannot tell from the accepted effect's, itself first.

    Args:
        step: an effect's rivals, the accepted one first.
        n: number of whitened numbers.
    """
    best = step[0]
    same = (item for item in step if item.last.effect.name == best.last.effect.name)
    doubt = best.fitted.power + _LITTLE_OF_NOISE * n
    return tuple(
        dict.fromkeys(i.last.location for i in same if _untold(i, best, n) or i.fitted.power < doubt)
    )


def rivals(step: Step, n: int) -> tuple[Ranked, ...]:
    """The accepted effect and those of other names that the data cannot tell from it; arguments as above."""
    chosen: dict[str, Ranked] = {}
    for item in step:
        if _untold(item, step[0], n):
            chosen.setdefault(item.last.effect.name, item)
    return tuple(chosen.values())


def _untold(item: Ranked, best: Ranked, n: int) -> bool:
    """Whether evidence does not decide between two, or what the form of the better one leaves is larger."""
    left = best.fitted.power - n
    misfit = FORM_DOUBT * left if best.fitted.power > NOISE_SLACK * n else 0.0
    return item.evidence > best.evidence - DECISIVE or item.fitted.power - best.fitted.power < misfit
