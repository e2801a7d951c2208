"""The verdict on a record and its effects, read from the budget of its gap and put into the equations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from excite.diagnosis.answer.answer import Verdict
from excite.diagnosis.answer.gap import Budget, Named
from excite.diagnosis.attribution import (
    Attribution,
    Hypothesis,
    Judgement,
    Scored,
    Scorer,
    Search,
    Stage,
    along,
    at_rows,
    extended,
    structured_joints,
)
from excite.diagnosis.budget.bodies import likeliest_beside
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.record import Found
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.fitted_signs import signs_again
from excite.diagnosis.simulator.model_text import fitted_sizes

# Candidates that are listed.
_LISTED = 8
# Standard deviations by which a size of a named effect differs from none. In 24 records of one effect or two and ten of
# six (gap/arm, gap/many) all that is named has 2.1 or more; a Stribeck friction that is not there, 1.3.
_TOLD = 2.0


@dataclass(frozen=True, eq=False)
class Reading:
    """What a budget says of a record.

    Attributes:
        found: the model of the gap.
        budget: its budget.
        scorer: of hypotheses beside what is modelled.
    """

    found: Found
    budget: Budget
    scorer: Scorer

    def verdict(self) -> tuple[Attribution, Judgement]:
        """The effects that are named, in the equations, and the verdict."""
        sure = [item for item in self.budget.named if item.clear]
        whole = explained(self.budget, sure)
        if not whole:
            # What is clear at its own place is there, whatever hides the rest of the machine.
            sure = [item for item in sure if alone(item) and takes_its_place(self.budget, item)]
        if not sure:
            return self._open()
        # First what surely takes most: of a gap that hardly stands above the noise, shares say little.
        first, *others = sorted(sure, key=lambda item: -item.surely)
        # Of what has a rival elsewhere than in the first place nobody knows the name.
        chosen = [first, *(item for item in others if alone(item))]
        # The model of the gap may have bristles bend by less than its encoders tell, which trials that judge deny.
        own = () if self._begun is self.scorer.baseline else (self.scorer.baseline,)
        for begun in (self._begun, *own):
            stages, kept = self._that_explain(chosen, begun)
            if kept:
                return self._named(stages, kept, whole=whole)
        return self._open()

    def _that_explain(self, chosen: list[Named], begun: Baseline) -> tuple[list[Stage], list[Named]]:
        """Stages of the effects that have some size beside each other; none where trials that judge deny them."""
        while True:
            stages, kept = self._stages(chosen, begun)
            if not kept or not self._nearer(stages[-1].context.baseline):
                return [], []
            chosen = self._of_some_size(stages, kept)
            chosen = [item for item in chosen if self._closes(stages[kept.index(item)])]
            if chosen == kept:
                return stages, kept

    def _open(self) -> tuple[Attribution, Judgement]:
        """Nothing that is named is the gap."""
        structured = structured_joints(self._nothing, self.scorer.spectral)
        named = (self._terms[item.effect, item.location] for item in self.budget.named)
        ranking = self._scored((*named, *self._likely))[:_LISTED]
        stage = Stage(Context(self.scorer.baseline), ranking, None)
        strange = [term for term in self._terms.values() if term.effect.nameless]
        # What has no name is the gap only where it says more than all that has one, each alone.
        most = max((scored.evidence for scored in ranking), default=0.0)
        stranger = next((s for s in self._scored(strange) if structured and s.evidence > most), None)
        if stranger is not None:
            place = stranger.location
            structured = (place, *(name for name in structured if name != place))
        made = replace(self._nothing, stages=(stage,), stranger=stranger)
        return made, Judgement("unknown" if structured else "none", (), (), (), structured)

    def _named(
        self, stages: list[Stage], kept: Sequence[Named], *, whole: bool
    ) -> tuple[Attribution, Judgement]:
        """Effects, the largest share first; ``whole`` where they are the gap and not the part of it at their places."""
        last = stages[-1].context.baseline
        rivals, (first,) = self._rivals(kept[0]), stages[0].ranking
        beside = tuple(scored for scored, _ in rivals)
        others = (self._terms[item.effect, item.location] for item in kept[1:])
        # Rivals stand beside the friction that was found, what is likely alone beside that which the gap has bent.
        known = {(scored.name, scored.location) for scored in beside}
        likely = (term for term in self._likely if term.key not in known)
        listed = (first, *beside, *self._scored((*others, *likely)))[:_LISTED]
        stages[0] = replace(stages[0], ranking=listed)
        after = replace(
            self._nothing,
            stages=tuple(stages),
            after=last.fit,
            final=last,
            floor=self.scorer.floor(last.fit),
        )
        named = [(scored, chance) for scored, chance in rivals if scored.name != first.name]
        renamed = tuple(_second_name(item, last) for item in after.accepted)
        chance = kept[0].probability + sum(p for scored, p in rivals if scored.name == first.name)
        structured = structured_joints(after, self.scorer.spectral)
        verdict: Verdict = "ambiguous" if named or renamed[0] is not None else "effect"
        judgement = Judgement(
            verdict if whole or not structured else "unknown",
            tuple(scored for scored, _ in named),
            tuple((item.location, *(p for n, p in item.rivals if n == item.effect)) for item in kept),
            renamed,
            structured,
            tuple(_second_name(scored, last) for scored, _ in named),
            chance,
            tuple(p for _, p in named),
        )
        return after, judgement

    def _of_some_size(self, stages: list[Stage], kept: list[Named]) -> list[Named]:
        """Those effects of which a size, as it is beside the others, is told from none: what is told leaves it out."""
        made, found = replace(self._nothing, stages=tuple(stages), final=stages[-1].context.baseline), []
        for item, scored, beta in zip(kept, made.accepted, fitted_sizes(made), strict=True):
            told, linear = scored.hypothesis.told.extra_std, scored.hypothesis.effect.linear
            spread = np.maximum(told, [item.values.get(p.name, (0.0, None))[1] or 0.0 for p in linear])
            there = np.abs(beta) > _TOLD * spread
            if not linear or any(sure for sure, p in zip(there, linear, strict=True) if not p.beside):
                found.append(item)
        return found

    def _closes(self, stage: Stage) -> bool:
        """Whether an effect, beside those before it, leaves less of the trials that judge at its own place.

        What acts on several joints: as a mean over them of how many times less.
        """
        item, before = stage.accepted, stage.context.baseline
        if item is None:
            return True
        judging = self.scorer.baseline.samples.judging
        old = (before.judged(before.fit.residual)[:, judging] ** 2).mean(axis=1)
        gain = np.log(np.maximum(old, 1e-300) / np.maximum(item.power[:, 1], 1e-300))
        return bool((gain[item.place] if item.hypothesis.effect.own_joint else gain.sum()) > 0.0)

    def _nearer(self, last: Baseline) -> bool:
        """Whether a baseline leaves less of the trials that judge than that without effects."""
        base, scale = self.scorer.baseline, self.scorer.scale
        return last.gap(last.fit.residual, scale) < base.gap(base.fit.residual, scale)

    def _stages(self, chosen: Iterable[Named], begun: Baseline) -> tuple[list[Stage], list[Named]]:
        """The effects one after the other, at last nothing; and which of them can be there.

        Args:
            chosen: the effects.
            begun: what is modelled, its friction changing sign as in the model of the gap or as it does by itself.
        """
        stages, kept, current, chosen = list[Stage](), list[Named](), begun, list(chosen)
        terms = self._beside_each_other([(item.effect, item.location) for item in chosen])
        for item in chosen:
            scored = self._try(terms[item.effect, item.location], current, item.nats)
            # A search that ended where its name stands for something else has found that.
            if scored is None or not scored.hypothesis.settled:
                continue
            stages.append(Stage(Context(current), (scored,), scored))
            kept.append(item)
            current = extended(scored.hypothesis)
        return [*stages, Stage(Context(signs_again(current)), (), None)], kept

    def _rivals(self, item: Named) -> list[tuple[Scored, float]]:
        """What might stand in the place of an effect, with its probability."""
        model = self.found.model
        terms = model.design.terms
        k = next(k for k in model.chosen if terms[k].key == (item.effect, item.location))
        made = []
        for rival, chance in zip(self.found.rivals.get(k, ()), item.chances, strict=True):
            scored = self._try(terms[rival.index], self._begun)
            if scored is not None:
                made.append((scored, chance))
        return made

    @cached_property
    def _nothing(self) -> Attribution:
        base = self.scorer.baseline
        first = Stage(Context(base), (), None)
        return Attribution((first,), base.fit, base.fit, base, self.scorer.floor(base.fit), self.scorer.scale)

    @cached_property
    def _begun(self) -> Baseline:
        """What is modelled, its friction changing sign as it does in the model of the gap."""
        base, now = self.scorer.baseline, self.found.baseline
        if base.signs == now.signs:
            return base
        moved = base.with_signs(now.signs)
        return moved.updated(moved.solver.fit())

    @cached_property
    def _terms(self) -> dict[tuple[str, str], Term]:
        return {term.key: term for term in self.found.model.terms}

    def _beside_each_other(self, named: Sequence[tuple[str, str]]) -> dict[tuple[str, str], Term]:
        """Terms by effect and place, each body of them the likeliest beside the others.

        A surgical arm's load stood beside half a newton metre at the yaw axis that its weight all but cancelled. That
        constant was no name, and the load without it closed 43 % of the gap where the one of these terms closes 79 %.
        """
        model = self.found.model
        numbers = [k for k in model.chosen if model.design.terms[k].key in named]
        maker = TermMaker(self.found.prediction.context, self.found.baseline.strict)
        return {term.key: term for term in likeliest_beside(model, numbers, maker)}

    @property
    def _likely(self) -> tuple[Term, ...]:
        return tuple(term for term in self.found.likely if term.key not in self._terms)

    def _scored(self, terms: Iterable[Term]) -> tuple[Scored, ...]:
        made = (self._try(term, self.scorer.baseline) for term in terms)
        return tuple(scored for scored in made if scored is not None)

    def _try(self, term: Term, baseline: Baseline, nats: float | None = None) -> Scored | None:
        """A term in the equations of what is modelled; None where it cannot be there."""
        named = self._terms.get(term.key) is term or baseline is self._begun
        # Friction on other bristles, or on none, has other columns.
        other = term.effect.friction and baseline.signs != term.context.baseline.signs
        made = hypothesis_of(term, baseline, term.context if named and not other else None)
        if made is None:
            return None
        if made.effect.along:
            # Play before friction is told by rows near standstill, which count here and hardly in the model of the gap.
            made = Search(Context(made.baseline), made.baseline.solver).refine(made)
        return self.scorer.scored(baseline.fit, made, nats) if made.physical else None


def hypothesis_of(term: Term, baseline: Baseline, made_at: Context | None = None) -> Hypothesis | None:
    """A term of the model in the equations of a baseline; None where it is no body that can exist there.

    Args:
        term: the term.
        baseline: the equations.
        made_at: predictions that its columns are made of, where not the baseline's own: a gear's load is what its link
            needs beside all that the model has.
    """
    shape = term.effect.shape(made_at or Context(baseline), term.location, term.theta)
    columns = at_rows(Context(baseline), shape)
    fit = baseline.solver.fit(columns.extra, columns.offset, 6, term.effect.widths)
    made = Hypothesis(term.effect, term.location, term.theta, columns, fit, baseline, made_at)
    # Free parameters of a body may be those of none that can exist.
    if term.direction is None or term.effect.possible(term.context, term.location, fit.extra):
        return made
    made = along(made, term.direction)
    return made if term.effect.possible(term.context, term.location, made.fit.extra) else None


def _second_name(item: Scored, final: Baseline) -> str | None:
    """Another name that means the same in the data."""
    return item.hypothesis.effect.second_name(final, item.location, item.hypothesis.fit)


# What a budget says of a gap: which of its effects stand clear, and whether they are what the gap is.


def explained(budget: Budget, effects: Sequence[Named]) -> bool:
    """Whether effects are what the gap is.

    They are if they take most of it together; or most of what has structure, where that is no trifle, the largest share
    that follows anything is one of theirs, and at its place no less than what has no name there; or if those that lead
    their own places so, with most of what has structure there, are no trifle together: what other joints have above
    their noise says nothing of these. With the lower end of an interval as most of a place instead, a UR10e that a run
    of 20 s judges loses load-dependent friction of 380 and 193 nats, and no verdict on 82 drawn arms is another.
    """
    taken = sum(item.share for item in effects)
    if taken >= THRESHOLDS.most:
        return True
    first = max(effects, key=lambda item: item.share, default=None)
    structured = taken >= max(THRESHOLDS.most * (1.0 - budget.rest), THRESHOLDS.trifle)
    structured = structured and first is not None and first.share >= max([*budget.follows.values(), 0.0])
    if structured and first is not None and _leads(budget, first):
        # Of much that stays open a name that is not sure says nothing.
        if first.probability >= THRESHOLDS.probable or taken >= _open(budget):
            return True
    there = (item.share for item in effects if _leads(budget, item, most=True))
    return sum(there) >= THRESHOLDS.trifle


def _open(budget: Budget) -> float:
    """What follows nothing and yet stands above the noise, over all channels."""
    return sum(
        channel.weight * channel.rest
        for channel in budget.channels.values()
        if channel.rest * (channel.gap**2 - channel.noise_floor**2) > channel.noise_floor**2
    )


def _leads(budget: Budget, item: Named, *, most: bool = False) -> bool:
    """Whether an effect takes no less of a channel than what follows nothing, or has no name, there.

    And ``most`` of what has structure there.
    """
    return any(
        s.share >= max([channel.rest, *(u.share for u in channel.unnamed)])
        and (not most or s.share >= THRESHOLDS.most * (1.0 - channel.rest))
        for channel in budget.channels.values()
        for s in channel.effects
        if (s.effect, s.location) == (item.effect, item.location)
    )


def takes_its_place(budget: Budget, item: Named) -> bool:
    """Whether an effect surely takes something of the gap of its own joint, and no less there than has no name.

    Of what acts on several joints: of any of them. Of a Panda that runs into something at joint 3 a constant takes less
    than what is left there, and is its mean.
    """
    own = budget.channels.get(item.location)
    places = budget.channels.values() if own is None else (own,)
    return any(
        s.interval90[0] > 0.0 and s.share >= max([channel.rest, *(u.share for u in channel.unnamed)])
        for channel in places
        for s in channel.effects
        if (s.effect, s.location) == (item.effect, item.location)
    )


def alone(item: Named) -> bool:
    """Whether an effect has no rival of another name."""
    return item.probability >= THRESHOLDS.probable and all(name == item.effect for name, _ in item.rivals)
