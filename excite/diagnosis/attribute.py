"""Attribution: effects added one by one, each the best of all candidates, until nothing above the floor is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from excite.diagnosis.accepted_together import searched_together
from excite.diagnosis.attribution import Attribution, Scored, Stage
from excite.diagnosis.baseline import Baseline
from excite.diagnosis.effects.effect import Context, Effect
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations import Fit
from excite.diagnosis.evidence import Judge, effective_counts
from excite.diagnosis.gates import Gates
from excite.diagnosis.hypotheses import Hypothesis, Search
from excite.diagnosis.noise_floor import other_postures, repeat_floor
from excite.diagnosis.refinement import extended, in_richer_forms, polished, price, refine_with_width
from excite.diagnosis.sign_changes import signs_again
from excite.diagnosis.unnamed import unnamed
from excite.diagnosis.verdict import structured_joints
from excite.robot.robot import Array

_REFINED = 5
_STRONG = 3
_LISTED = 24
# Hypotheses that remove this share of the power that another removes are compared by their likelihood.
_ALIKE = 0.7
_HARDLY = 0.3
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
    effects: tuple[Effect, ...] = tuple(EFFECTS.values())
    _kept: dict = field(default_factory=dict)

    def run(self) -> Attribution:
        """Add effects until none passes."""
        samples = self.baseline.samples
        use = samples.identification
        tau = samples.rows([t.tau for t in samples.trials])
        scale = np.maximum(tau[use].std(axis=0), 1e-9)
        current = self.baseline
        stages: list[Stage] = []
        accepted: list[Scored] = []
        before = current.fit
        stranger: Scored | None = None
        while len(accepted) < self.gates.most:
            context = Context(current)
            so_far = Attribution(tuple(stages), before, current.fit, current, self._floor(current.fit), scale)
            gaps = structured_joints(so_far, self.spectral)
            ranking = self._rank(context, scale)
            best = next((s for s in ranking if self._passes(s, accepted)), None)
            if best is None:
                near = self._polished(context, ranking, scale)
                best = next((s for s in near if self._passes(s, accepted)), None)
                ranking = (best, *ranking) if best is not None else ranking
            if best is None:
                forms = self._richer(context, gaps, scale)
                best = next(
                    (s for s in forms if self.gates.explained_by(s) and self._passes(s, accepted)), None
                )
                ranking = (best, *ranking) if best is not None else ranking
            stranger = self._unnamed(context, best, gaps, scale)
            best = best if stranger is None else None
            stages.append(Stage(context, ranking, best))
            if best is None:
                break
            best = replace(best, hypothesis=polished(best.hypothesis))
            stages[-1] = Stage(context, ranking, best)
            accepted.append(best)
            current = signs_again(extended(best.hypothesis))
            if len(accepted) > 1:
                accepted, current = searched_together(self.baseline, accepted, current)
                stages = [replace(s, accepted=a) for s, a in zip(stages, accepted, strict=True)]
        floor = self._floor(current.fit)
        return Attribution(tuple(stages), before, current.fit, current, floor, scale, stranger)

    def _unnamed(
        self, context: Context, best: Scored | None, joints: tuple[str, ...], scale: Array
    ) -> Scored | None:
        """What has no name and says more than the best that has one."""
        before = context.baseline.fit

        def score(found: Sequence[Hypothesis]) -> tuple[Scored, ...]:
            floor = self._floor(found[0].fit) if found else self.spectral
            return tuple(self._score(before, item, floor, scale) for item in found)

        search = Search(context, context.baseline.solver, self._kept)
        return unnamed(search, best, joints, self.gates, score)

    def _floor(self, fit: Fit) -> Array:
        """Of repeated trials; of the spectrum where there are none."""
        repeat = repeat_floor(self.baseline.samples, self.baseline.judged(fit.residual))
        if repeat is None:
            return self.spectral
        return other_postures(np.maximum(repeat, 0.5 * self.spectral), self.unrepeated)

    def _rank(self, context: Context, scale: Array) -> tuple[Scored, ...]:
        search = Search(context, context.baseline.solver, self._kept)
        found: list[Hypothesis] = []
        for effect in self._offered():
            for location in effect.locations(context):
                item = search.coarse(effect, location)
                if item is not None:
                    found.append(item)
        if not found:
            return ()
        before = context.baseline.fit
        found.sort(key=price)
        strong = sorted(found, key=lambda item: -self._removed(before, item, scale))[:_STRONG]
        # A resonance is found by its search, hardly by the grid that the search starts from.
        tuned = [item for item in found if len(item.effect.searched) > 1]
        kinds = {item.effect.name: item for item in reversed(tuned)}
        chosen = [item for item in found if item in found[:_REFINED] or item in [*strong, *kinds.values()]]
        rest = [item for item in found[:_LISTED] if item not in chosen]
        refined = [refine_with_width(search, item) for item in chosen] + rest
        refined = self._ordered(before, refined, scale)
        floor = self._floor(refined[0].fit)
        return tuple(self._score(before, item, floor, scale) for item in refined)

    def _polished(self, context: Context, ranking: tuple[Scored, ...], scale: Array) -> tuple[Scored, ...]:
        """The likeliest again with finer parameters and richer forms, which may have the evidence that they lack."""
        gates = self.gates
        likely = [s for s in ranking if s.evidence >= gates.evidence and s.closed[s.place] >= gates.closed]
        likely.sort(key=lambda s: -s.evidence)
        found = [polished(s.hypothesis) for s in likely[:_POLISHED]]
        if not found:
            return ()
        before = context.baseline.fit
        floor = self._floor(found[0].fit)
        return tuple(self._score(before, item, floor, scale) for item in found)

    def _richer(self, context: Context, joints: tuple[str, ...], scale: Array) -> tuple[Scored, ...]:
        """Richer forms at the joints that have most left to explain, ranked."""
        search = Search(context, context.baseline.solver, self._kept)
        found = [
            item
            for effect in self._offered()
            for place in effect.locations(context)
            if place in joints[:_SEARCHED] or (joints and place not in context.joints)
            for item in in_richer_forms(search, effect, place)
        ]
        if not found:
            return ()
        before = context.baseline.fit
        found = self._ordered(before, found, scale)
        floor = self._floor(found[0].fit)
        return tuple(self._score(before, item, floor, scale) for item in found)

    def _removed(self, before: Fit, item: Hypothesis, scale: Array) -> float:
        """Normalised power above the floor that a hypothesis removes from the identification trials."""
        least = self.baseline.solver.equations.floor**2
        old, new = (np.maximum(fit.sigma**2 - least, 0.0) for fit in (before, item.fit))
        return float(((old - new) / scale**2).sum())

    def _ordered(self, before: Fit, found: list[Hypothesis], scale: Array) -> list[Hypothesis]:
        """First those that remove about as much power as any, the likeliest of them first, and so on.

        By likelihood alone a little cleaned off a quiet joint would come before a lot taken from a bad one.
        """
        power = {id(item): self._removed(before, item, scale) for item in found}
        order: list[Hypothesis] = []
        rest = sorted(found, key=lambda item: -power[id(item)])
        while rest:
            least = _ALIKE * max(power[id(rest[0])], 0.0)
            group = [item for item in rest if power[id(item)] >= least] or rest
            order += sorted(group, key=price)
            rest = [item for item in rest if item not in group]
        return order

    def _offered(self) -> list[Effect]:
        return [e for e in self.effects if e.offered(self.baseline.modelled)]

    def _score(self, before: Fit, item: Hypothesis, floor: Array, scale: Array) -> Scored:
        samples = self.baseline.samples
        first, last = self.baseline.judged(before.residual), self.baseline.judged(item.fit.residual)
        # Of what this hypothesis leaves: what another has left to explain would count for correlated noise.
        counts = effective_counts(last, samples.identification, samples.trial_of_row)
        # Repeated trials may show less noise than the spectrum above the band makes one expect.
        judge = Judge(samples.identification, counts, np.minimum(self.spectral, floor))
        ratio = judge.ratio(first, last)
        cost = 0.5 * item.n_parameters * np.log(max(judge.count.sum(), 2.0)) + np.log(200.0)
        left_over = judge.power(last)
        old, new = judge.power(first).validation, left_over.validation
        change = old - new
        room = np.maximum(old - floor**2, 0.05 * old)
        closed = change / room
        normal = change / scale**2
        strength = float(np.sqrt(max(float(normal[normal > 0.0].sum()), 0.0)))
        rest = float((np.maximum(old - floor**2, 0.0) / scale**2).sum())
        of_rest = strength**2 / max(rest, strength**2, 1e-300)
        place = int(np.argmax(ratio.sum(axis=1)))
        left = int(np.sum((old > 2.0 * floor**2) & (closed < _HARDLY)))
        # Without validation trials there are the fitted ones alone to judge by.
        side = int(not samples.identification.all())
        # By the floor alone: sudden changes of an effect itself reach beyond the band, where the spectrum is taken.
        stands = float((first[place] ** 2).mean() / floor[place] ** 2)
        evidence, outside = float(ratio.sum() - cost), float(ratio[:, side].sum())
        power = np.column_stack([left_over.identification, new])
        return Scored(
            item,
            evidence,
            outside,
            closed,
            strength,
            of_rest,
            place,
            float(cost),
            power,
            counts,
            left,
            stands,
            float(ratio.sum() - ratio[place].sum()),
        )

    def _passes(self, item: Scored, accepted: list[Scored]) -> bool:
        return self.gates.passed_by(item, accepted, self.baseline.samples.joints)
