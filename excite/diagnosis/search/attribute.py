"""Attribution: effects added one by one, each the best of all candidates, until nothing above the floor is left."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.fitted_signs import signs_again
from excite.diagnosis.search.accepted_together import searched_together
from excite.diagnosis.search.attribution import Attribution, Scored, Stage
from excite.diagnosis.search.constants import beyond_constants
from excite.diagnosis.search.gates import Gates
from excite.diagnosis.search.hypotheses import Hypothesis, Search
from excite.diagnosis.search.refinement import extended, in_richer_forms, polished, price, refine_with_width
from excite.diagnosis.search.scoring import Scorer
from excite.diagnosis.search.side_by_side import side_by_side
from excite.diagnosis.search.structured import structured_joints
from excite.diagnosis.search.unnamed import unnamed

_REFINED = 5
_STRONG = 3
_LISTED = 24
# An effect that removes no more of what is left may hide one whose richer form is asked for.
_TRIFLE = 0.1
# Joints at which richer forms are tried where no textbook's form explains what is left.
_SEARCHED = 2
# Hypotheses that are made finer where none passes as it is.
_POLISHED = 2


@dataclass(eq=False)
class Attributor:
    """Runs the attribution.

    Attributes:
        baseline: the fitted baseline.
        spectral: ``(n_joints,)`` spectral noise floor [N·m].
        unrepeated: ``(n_joints,)`` power of noise in all trials less that in repeated ones [(N·m)²].
        gates: what an effect must reach.
        effects: the library.
    """

    baseline: Baseline
    spectral: Array
    unrepeated: Array | float = 0.0
    gates: Gates = field(default_factory=Gates)
    effects: tuple[Effect, ...] = field(default_factory=lambda: tuple(EFFECTS.values()))
    _kept: dict = field(default_factory=dict)

    def run(self) -> Attribution:
        """Add effects until none passes."""
        samples = self.baseline.samples
        use = samples.identification
        tau = samples.rows([t.measured for t in samples.trials])
        scale = np.maximum(tau[use].std(axis=0), 1e-9)
        scorer = Scorer(self.baseline, self.spectral, self.unrepeated, scale)
        current = self.baseline
        stages: list[Stage] = []
        accepted: list[Scored] = []
        before = current.fit
        stranger: Scored | None = None
        while len(accepted) < self.gates.most:
            context = Context(current)
            so_far = Attribution(
                tuple(stages), before, current.fit, current, scorer.floor(current.fit), scale
            )
            gaps = structured_joints(so_far, self.spectral)
            best, ranking = self._best(context, gaps, accepted, scorer)
            stranger = self._unnamed(context, best, gaps, scorer)
            best = best if stranger is None else None
            stages.append(Stage(context, ranking, best))
            if best is None:
                break
            best = replace(best, hypothesis=polished(best.hypothesis))
            kin = self._kin(context, best.hypothesis, scorer)
            if kin:
                best = kin[0] if self._passes(kin[0], accepted) else best
                known = {(s.name, s.location) for s in kin}
                ranking = (*kin, *(s for s in ranking if (s.name, s.location) not in known))
            stages[-1] = Stage(context, ranking, best)
            accepted.append(best)
            current = signs_again(extended(best.hypothesis))
            if len(accepted) > 1:
                accepted, current = searched_together(self.baseline, accepted, current)
                stages = [replace(s, accepted=a) for s, a in zip(stages, accepted, strict=True)]
        floor = scorer.floor(current.fit)
        return Attribution(tuple(stages), before, current.fit, current, floor, scale, stranger)

    def _best(
        self, context: Context, joints: tuple[str, ...], accepted: list[Scored], scorer: Scorer
    ) -> tuple[Scored | None, tuple[Scored, ...]]:
        """The effect to be accepted next, None where none passes, and all that were tried."""
        ranking = self._rank(context, scorer)
        passing = [s for s in ranking if self._passes(s, accepted)]
        best = beyond_constants(context.baseline, passing) if passing else None
        if best is None:
            near = self._polished(context, ranking, scorer)
            best = next((s for s in near if self._passes(s, accepted)), None)
            ranking = _first(best, ranking) if best is not None else ranking
        else:
            best, ranking = self._likelier(context, best, ranking, accepted, scorer)
        if best is None or (joints and best.of_rest < _TRIFLE):
            forms = self._richer(context, joints, scorer)
            whole = (s for s in forms if self.gates.explained_by(s) and self._passes(s, accepted))
            form = next(whole, None)
            if form is not None and (best is None or form.strength > best.strength):
                best, ranking = form, _first(form, ranking)
        return best, ranking

    def _likelier(
        self,
        context: Context,
        best: Scored,
        ranking: tuple[Scored, ...],
        accepted: list[Scored],
        scorer: Scorer,
    ) -> tuple[Scored, tuple[Scored, ...]]:
        """What has more evidence than the best that passes, where it passes once it is finer; else that best.

        A gear that swings takes the load from the baseline, which its swinging has bent: the first search ends short.
        """
        lead = max(ranking, key=lambda item: item.evidence)
        effect = lead.hypothesis.effect
        if lead.evidence <= best.evidence or not (effect.moves and effect.searched):
            return best, ranking
        finer = scorer.scored(context.baseline.fit, [polished(lead.hypothesis)])[0]
        if self._passes(finer, accepted) and finer.evidence > best.evidence:
            return finer, _first(finer, ranking)
        return best, ranking

    def _unnamed(
        self, context: Context, best: Scored | None, joints: tuple[str, ...], scorer: Scorer
    ) -> Scored | None:
        """What has no name and says more than the best that has one."""
        search = Search(context, context.baseline.solver, self._kept)
        return unnamed(search, best, joints, self.gates, partial(scorer.scored, context.baseline.fit))

    def _rank(self, context: Context, scorer: Scorer) -> tuple[Scored, ...]:
        search = Search(context, context.baseline.solver, self._kept)
        places = [(e, place) for e in self._offered() for place in e.locations(context)]
        fitted = side_by_side(lambda where: search.coarse(*where), places)
        found = [item for item in fitted if item is not None]
        if not found:
            return ()
        before = context.baseline.fit
        found.sort(key=price)
        strong = sorted(found, key=lambda item: -scorer.removed(before, item))[:_STRONG]
        # A resonance is found by its search, hardly by the grid that the search starts from.
        tuned = [item for item in found if len(item.effect.searched) > 1]
        kinds = {item.effect.name: item for item in reversed(tuned)}
        chosen = [item for item in found if item in found[:_REFINED] or item in [*strong, *kinds.values()]]
        rest = [item for item in found[:_LISTED] if item not in chosen]
        refined = side_by_side(partial(refine_with_width, search), chosen) + rest
        return scorer.scored(before, scorer.ordered(before, refined))

    def _polished(self, context: Context, ranking: tuple[Scored, ...], scorer: Scorer) -> tuple[Scored, ...]:
        """The likeliest again with finer parameters and richer forms, which may have the evidence that they lack."""
        gates = self.gates
        likely = [s for s in ranking if s.evidence >= gates.evidence and s.closed[s.place] >= gates.closed]
        likely.sort(key=lambda s: -s.evidence)
        found = side_by_side(polished, [s.hypothesis for s in likely[:_POLISHED]])
        return scorer.scored(context.baseline.fit, found)

    def _kin(self, context: Context, item: Hypothesis, scorer: Scorer) -> tuple[Scored, ...]:
        """An effect in a richer form and those that it runs into, the likeliest first; none where it has no kin."""
        search = Search(context, context.baseline.solver, self._kept)
        named = [EFFECTS[name] for name in item.effect.overlaps]
        kin = [effect for effect in named if effect.offered(self.baseline.modelled)]
        forms = side_by_side(lambda effect: in_richer_forms(search, effect, item.location), kin)
        others = side_by_side(polished, [form for of_one in forms for form in of_one])
        if not others:
            return ()
        first = {form.effect.name: form for form in sorted([item, *others], key=price, reverse=True)}
        scored = scorer.scored(context.baseline.fit, list(first.values()))
        return tuple(sorted(scored, key=lambda item: -item.evidence))

    def _richer(self, context: Context, joints: tuple[str, ...], scorer: Scorer) -> tuple[Scored, ...]:
        """Richer forms at the joints that have most left to explain, ranked."""
        search = Search(context, context.baseline.solver, self._kept)
        places = [
            (effect, place)
            for effect in self._offered()
            for place in effect.locations(context)
            if place in joints[:_SEARCHED] or (joints and place not in context.joints)
        ]
        forms = side_by_side(lambda where: in_richer_forms(search, *where), places)
        found = [form for of_one in forms for form in of_one]
        before = context.baseline.fit
        return scorer.scored(before, scorer.ordered(before, found))

    def _offered(self) -> list[Effect]:
        return [e for e in self.effects if e.offered(self.baseline.modelled)]

    def _passes(self, item: Scored, accepted: list[Scored]) -> bool:
        return self.gates.passed_by(item, accepted, self.baseline.samples.joints)


def _first(item: Scored, ranking: tuple[Scored, ...]) -> tuple[Scored, ...]:
    """A ranking led by a finer form of one of its hypotheses."""
    return (item, *(s for s in ranking if (s.name, s.location) != (item.name, item.location)))
