"""The verdict on a record and its effects, read from the budget of its gap and put into the equations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtri, stdtrit

from excite.arrays import Array
from excite.diagnosis.answer.answer import Verdict
from excite.diagnosis.answer.gap import Budget, ChannelBudget, EffectShare, Named
from excite.diagnosis.attribution import (
    Attribution,
    Hypothesis,
    Judgement,
    Scored,
    Scorer,
    at_rows,
    extend_baseline,
    fit_along_direction,
    structured_joints,
)
from excite.diagnosis.budget.bodies import fit_likeliest_bodies
from excite.diagnosis.budget.fit.design import Design
from excite.diagnosis.budget.fit.joint_fit import Model, fit_model
from excite.diagnosis.budget.fit.terms import Term, TermMaker
from excite.diagnosis.budget.record import GapModel
from excite.diagnosis.budget.shares import judged_power, linear_deviations, power_of
from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.effects.form import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.dry_friction.fitted_signs import refit_signs

# Candidates that are listed.
_LISTED = 8
# Probability that a size of a named effect is none, by Student's distribution of as many blocks as were left out. In 65
# records of drawn arms all that is named has five deviations or more; names that come and go with what is planted in an
# AR5's record have up to 2.7, where 3.0 are asked.
_NOTHING = 0.02
# Upper end of an interval of 90 %. How far what no effect explains is alike with the torque of one that is named: of
# 107 effects planted in records of eight machines 78 % of the intervals hold without both, 90 % with them.
_HIGH, _ALIKE = 0.95, 0.1
# Fits after which a shape that follows from a size, a secant, is off by the cube of what it was.
_PASSES = 3


@dataclass(frozen=True, eq=False)
class BudgetVerdict:
    """What a budget says of a record.

    Attributes:
        found: the model of the gap.
        budget: its budget.
        scorer: of hypotheses beside what is modelled.
    """

    found: GapModel
    budget: Budget
    scorer: Scorer

    def decide_verdict(self) -> tuple[Attribution, Judgement]:
        """Fit the named effects in the equations and decide the verdict."""
        sure = [item for item in self.budget.named if item.clear and is_accepted(item)]
        whole = is_gap_explained(self.budget, sure)
        # What is clear at its own place is there, whatever hides the rest of the machine or explains it.
        sure = [item for item in sure if self._has_share_at_place(item) and (whole or is_probable(item))]
        # First what surely takes most: of a gap that hardly stands above the noise, shares say little. Of what is no
        # more than likely nobody knows the name, but for the first, whose rivals are told.
        sure.sort(key=lambda item: -item.surely)
        kept, accepted = self._keep_explaining([*sure[:1], *(item for item in sure[1:] if is_probable(item))])
        return self._judge_named_effects(kept, accepted, whole=whole) if kept else self._judge_unnamed_gap()

    def _has_share_at_place(self, item: Named) -> bool:
        """Whether an effect surely takes a share of the gap of its own joint, no less than what has no name there.

        Of what acts on several joints: of any of them. Less than is named may be more than stays unexplained there.
        """
        term = self._terms_by_key[item.effect, item.location]
        own = None if term.own is None else list(self.budget.channels.values())[term.own]
        for channel, share in self._shares_of(item):
            unnamed = [u.share for u in channel.unnamed]
            least = min(THRESHOLDS.sure, max(channel.rest + sum(unnamed), 0.0))
            if (
                (own is None or channel is own)
                and share.interval90[0] > least
                and share.share >= max(unnamed, default=0.0)
            ):
                return True
        return False

    def _shares_of(self, item: Named) -> list[tuple[ChannelBudget, EffectShare]]:
        """Channels whose gap an effect takes a share of, each with that share."""
        return [
            (channel, share)
            for channel in self.budget.channels.values()
            for share in channel.effects
            if (share.effect, share.location) == (item.effect, item.location)
        ]

    def _keep_explaining(self, chosen: Sequence[Named]) -> tuple[list[Named], list[Scored]]:
        """Those that have a size and leave less of what judges, each and all together, put into the equations.

        What has not goes one at a time, the weakest first: beside it others may have none. What only stands for
        something else is denied its name and stays beside the others, which without it would take up what it holds.
        """
        kept, nameless = list(chosen), list[Named]()
        while kept:
            model = self._fit_together([*kept, *nameless])
            gone = self._term_to_drop(model, len(kept))
            if gone is not None:
                if gone < len(kept):
                    del kept[gone]
                else:
                    del nameless[gone - len(kept)]
                continue
            accepted = self._add_effects(kept, model)
            # A search that ended where its name stands for something else has found that.
            made = [scored.hypothesis for scored in accepted]
            other = [k for k, h in enumerate(made) if not (h.is_physical and h.is_within_scope)]
            if not other:
                return kept, accepted
            nameless.append(kept.pop(min(other, key=model.taken_by)))
        return [], []

    def _term_to_drop(self, model: Model, named: int) -> int | None:
        """Index of the term that is dropped next; None where all stay. The first ``named`` of them need a size."""
        terms, left = model.terms, power_of(model).mean
        without = [_log_power_without(model, [k], left) for k in model.chosen]
        if _log_power_without(model, model.chosen, left).sum() <= 0.0:
            return int(np.argmin([gain.sum() for gain in without]))
        # What acts on several joints leaves less as a mean over them of how many times less.
        gone = [
            k
            for k, term in enumerate(terms)
            if not term.is_possible(term.context, model.term_parameters(k))
            or (k < named and not self._has_size(model, k))
            or (without[k].sum() if term.own is None else without[k][term.own]) <= 0.0
        ]
        return min(gone, key=model.taken_by, default=None)

    def _judge_unnamed_gap(self) -> tuple[Attribution, Judgement]:
        """The verdict where no named effect explains the gap."""
        structured = structured_joints(self._empty_attribution, self.scorer.spectral)
        named = (self._terms_by_key[item.effect, item.location] for item in self.budget.named)
        ranking = self._score_terms((*named, *self._unnamed_likely_terms))[:_LISTED]
        strange = [term for term in self._terms_by_key.values() if term.effect.nameless]
        # What has no name is the gap only where it says more than all that has one, each alone.
        most = max((scored.evidence for scored in ranking), default=0.0)
        stranger = next((s for s in self._score_terms(strange) if structured and s.evidence > most), None)
        if stranger is not None:
            place = stranger.location
            structured = (place, *(name for name in structured if name != place))
        made = replace(self._empty_attribution, ranking=ranking, stranger=stranger)
        return made, Judgement("unknown" if structured else "none", (), (), (), structured)

    def _judge_named_effects(
        self, kept: Sequence[Named], accepted: Sequence[Scored], *, whole: bool
    ) -> tuple[Attribution, Judgement]:
        """Effects, the largest share first; ``whole`` where they are the gap and not the part of it at their places."""
        last, first = refit_signs(extend_baseline(accepted[-1].hypothesis)), accepted[0]
        rivals = self._rivals_of(kept[0])
        beside = tuple(scored for scored, _ in rivals)
        others = (self._terms_by_key[item.effect, item.location] for item in kept[1:])
        # Rivals stand beside the friction that was found, what is likely alone beside that which the gap has bent.
        known = {(scored.name, scored.location) for scored in beside}
        likely = (term for term in self._unnamed_likely_terms if term.key not in known)
        listed = (first, *beside, *self._score_terms((*others, *likely)))[:_LISTED]
        after = replace(
            self._empty_attribution,
            ranking=listed,
            accepted=tuple(accepted),
            final=last,
            floor=self.scorer.noise_floor(last.fit),
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

    def _add_effects(self, kept: Sequence[Named], model: Model) -> list[Scored]:
        """Add effects to the equations one after the other, each at its fitted size."""
        accepted = list[Scored]()
        for k, item in enumerate(kept):
            current = extend_baseline(accepted[-1].hypothesis) if accepted else self._initial_baseline
            term = model.design.terms[k]
            beta = term.to_beta(model.term_parameters(k))
            std = self._size_deviation(item, beta, self._block_spread(model, k), len(model.left_out))
            accepted.append(
                self.scorer.score_fit(current.fit, known_hypothesis(term, current, beta, std), item.nats)
            )
        return accepted

    def _size_deviation(self, item: Named, beta: Array, spread: Array, blocks: int) -> Array:
        """Deviations of an effect's sizes: those between blocks, and what is unexplained beside it.

        Blocks are few: 1.645 deviations are to hold what Student's quantile does. What no effect explains of a joint is
        no noise, and is partly alike with any torque: the size is off by as much, wherever it stands clearest.
        """
        open_ = min(
            (
                np.sqrt(max(1.0 - sum(other.share for other in channel.effects), 0.0) / share.share)
                for channel, share in self._shares_of(item)
                if share.share > 0.0
            ),
            default=1.0,
        )
        student = float(stdtrit(max(blocks - 1, 1), _HIGH) / ndtri(_HIGH))
        return np.hypot(student * spread, _ALIKE * open_ * np.abs(beta))

    def _block_spread(self, model: Model, k: int) -> Array:
        """Deviations between blocks left out of a term's linear parameters; of a body as where all of them are free."""
        term = model.design.terms[k]
        if term.direction is not None:
            free = TermMaker(term.context, self.found.baseline.strict).make_term(
                term.effect, term.location, ()
            )
            if free is not None:
                terms = [free if i == k else other for i, other in enumerate(model.design.terms)]
                model = fit_model(Design(model.design.rows, tuple(terms)), model.chosen, model.weight)
        return linear_deviations(model, k)

    def _has_size(self, model: Model, k: int) -> bool:
        """Whether a size of a model's k-th term is told from none: what is said of the robot leaves that out."""
        term = model.design.terms[k]
        told = float(stdtrit(max(len(model.left_out) - 1, 1), 1.0 - 0.5 * _NOTHING))
        there = np.abs(term.to_beta(model.term_parameters(k))) > told * self._block_spread(model, k)
        return term.known or any(
            sure for sure, p in zip(there, term.effect.linear, strict=True) if not p.beside
        )

    def _rivals_of(self, item: Named) -> list[tuple[Scored, float]]:
        """Rivals of an effect, each with its probability."""
        model = self.found.model
        terms = model.design.terms
        k = next(k for k in model.chosen if terms[k].key == (item.effect, item.location))
        made = []
        for rival, chance in zip(self.found.rivals.get(k, ()), item.chances, strict=True):
            scored = self._score_term(terms[rival.index], self._initial_baseline)
            if scored is not None:
                made.append((scored, chance))
        return made

    @cached_property
    def _empty_attribution(self) -> Attribution:
        base = self.scorer.baseline
        return Attribution(base, base, self.scorer.noise_floor(base.fit), self.scorer.scale)

    @cached_property
    def _initial_baseline(self) -> Baseline:
        """What is modelled, its friction changing sign as it does in the model of the gap."""
        return self.scorer.baseline.with_drives_of(self.found.baseline)

    @cached_property
    def _term_numbers(self) -> dict[tuple[str, str], int]:
        """By name and place, the design's term."""
        return {self.found.design.terms[k].key: k for k in self.found.model.chosen}

    @cached_property
    def _terms_by_key(self) -> dict[tuple[str, str], Term]:
        return {term.key: term for term in self.found.model.terms}

    def _fit_together(self, named: Sequence[Named]) -> Model:
        """Effects, fitted: bodies with all their parameters free where those are of ones that can exist.

        Else each is the likeliest that can beside the others. What else the model of the gap has may cancel a part of a
        body: a surgical arm's load stood beside half a newton metre at the yaw axis that its weight all but cancelled.
        """
        found, rows = self.found.model, self.found.design.rows
        numbers = [self._term_numbers[item.effect, item.location] for item in named]
        maker = TermMaker(self.found.prediction.context, self.found.baseline.strict)
        free = [found.design.terms[k] for k in numbers]
        free = [t if t.direction is None else maker.make_term(t.effect, t.location, ()) or t for t in free]
        model = fit_model(Design(rows, tuple(free)), range(len(free)))
        bodies = [k for k, term in enumerate(free) if term.effect.is_body]
        if not all(free[k].is_possible(free[k].context, model.term_parameters(k)) for k in bodies):
            terms = fit_likeliest_bodies(found, numbers, maker)
            model = fit_model(Design(rows, tuple(terms)), range(len(terms)))
        return self._fit_shapes(model)

    def _fit_shapes(self, model: Model) -> Model:
        """The model, fitted again where a shape follows from a size: alone, an effect is of another size."""
        for _ in range(_PASSES):
            terms = tuple(self._shape_at_size(model, k) for k in model.chosen)
            if terms == model.terms:
                break
            model = fit_model(Design(model.design.rows, terms), model.chosen, model.weight)
        return model

    def _shape_at_size(self, model: Model, k: int) -> Term:
        """A term of a model at the shape that goes with its fitted size."""
        term = model.design.terms[k]
        maker = TermMaker(term.context, self.found.baseline.strict)
        return maker.shape_at_size(term, model.term_parameters(k))

    @property
    def _unnamed_likely_terms(self) -> tuple[Term, ...]:
        return tuple(term for term in self.found.likely if term.key not in self._terms_by_key)

    def _score_terms(self, terms: Iterable[Term]) -> tuple[Scored, ...]:
        made = (self._score_term(term, self.scorer.baseline) for term in terms)
        return tuple(scored for scored in made if scored is not None)

    def _score_term(self, term: Term, baseline: Baseline) -> Scored | None:
        """A term in the equations of what is modelled; None where it cannot be there."""
        named = self._terms_by_key.get(term.key) is term or baseline is self._initial_baseline
        # Friction on other bristles, or on none, has other columns.
        other = term.effect.friction and baseline.signs != term.context.baseline.signs
        made = hypothesis_of(term, baseline, term.context if named and not other else None)
        return None if made is None or not made.is_physical else self.scorer.score_fit(baseline.fit, made)


def _log_power_without(model: Model, gone: Sequence[int], left: Array) -> Array:
    """Logarithm of how many times more a model leaves of the trials that judge without some terms, ``(n_joints,)``.

    Args:
        model: the model.
        gone: the terms.
        left: ``(n_joints,)`` power that it leaves with them.
    """
    others = [k for k in model.chosen if k not in gone]
    without = judged_power(model.design, others, model.weight).mean
    return np.asarray(np.log(without / np.maximum(left, 1e-300)))


def known_hypothesis(term: Term, baseline: Baseline, beta: Array, std: Array) -> Hypothesis:
    """A term of known size in the equations of a baseline: its torque is taken off, the rest fitted again.

    Args:
        baseline: the equations.
        beta: ``(n_linear,)`` its linear parameters.
        std: ``(n_linear,)`` their standard deviations.
    """
    shape = term.effect.shape(term.context, term.location, term.theta)
    columns, solver = at_rows(Context(baseline), shape), baseline.solver
    made = solver.fit_columns(offset=columns.predict_torque(beta, solver.equations.y.shape))
    if columns.extra is not None:
        # Sizes that trials disagree on beside bodies and friction are no surer than that.
        free = solver.fit_columns(columns.extra, columns.offset, widths=term.effect.prior_widths)
        std = np.maximum(std, solver.std_between_trials(free, term.effect.prior_widths))
    return Hypothesis(
        term.effect,
        term.location,
        term.theta,
        columns,
        replace(made, extra=beta, extra_std=std),
        baseline,
        term.context,
    )


def hypothesis_of(term: Term, baseline: Baseline, made_at: Context | None = None) -> Hypothesis | None:
    """A term of the model in the equations of a baseline; None where it is no body that can exist there.

    Args:
        baseline: the equations.
        made_at: predictions that its columns are made of, where not the baseline's own: a gear's load is what its link
            needs beside all that the model has.
    """
    shape = term.effect.shape(made_at or Context(baseline), term.location, term.theta)
    columns = at_rows(Context(baseline), shape)
    fit = baseline.solver.fit_columns(columns.extra, columns.offset, 6, term.effect.prior_widths)
    made = Hypothesis(term.effect, term.location, term.theta, columns, fit, baseline, made_at)
    # Free parameters of a body may be those of none that can exist.
    if term.direction is None or term.effect.is_possible(term.context, term.location, fit.extra):
        return made
    made = fit_along_direction(made, term.direction)
    return made if term.effect.is_possible(term.context, term.location, made.fit.extra) else None


def _second_name(item: Scored, final: Baseline) -> str | None:
    """Another name that means the same in the data."""
    return item.hypothesis.effect.second_name(final, item.location, item.hypothesis.fit)


# What a budget says of a gap: which of its effects stand clear, and whether they are what the gap is.


def is_gap_explained(budget: Budget, effects: Sequence[Named]) -> bool:
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
    structured = taken >= max(THRESHOLDS.most * (1.0 - budget.unexplained_share), THRESHOLDS.trifle)
    structured = (
        structured and first is not None and first.share >= max([*budget.unnamed_shares.values(), 0.0])
    )
    if structured and first is not None and _is_leading_effect(budget, first):
        # Of much that stays open a name that is not sure says nothing.
        if first.probability >= THRESHOLDS.probable or taken >= _structureless_share(budget):
            return True
    there = (item.share for item in effects if _is_leading_effect(budget, item, most=True))
    return sum(there) >= THRESHOLDS.trifle


def _structureless_share(budget: Budget) -> float:
    """Share of the gap above the noise that follows no signal, over all channels."""
    return sum(
        channel.weight * channel.rest
        for channel in budget.channels.values()
        if channel.rest * (channel.gap**2 - channel.noise_floor**2) > channel.noise_floor**2
    )


def _is_leading_effect(budget: Budget, item: Named, *, most: bool = False) -> bool:
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


def is_accepted(item: Named) -> bool:
    """Whether an effect has the probability of one that is accepted, or shares it with rivals."""
    return bool(item.rivals) or is_probable(item)


def is_probable(item: Named) -> bool:
    """Whether an effect has the probability of one that is accepted, whatever its rivals have."""
    return item.probability >= THRESHOLDS.probable
