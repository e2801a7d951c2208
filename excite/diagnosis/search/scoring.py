"""Merits of hypotheses: evidence, what they close, what they leave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.noise_floor import other_postures, repeat_floor
from excite.diagnosis.search.attribution import Scored
from excite.diagnosis.search.evidence import Judge, effective_counts
from excite.diagnosis.search.hypotheses import Hypothesis
from excite.diagnosis.search.refinement import price

# Hypotheses that remove this share of the power that another removes are compared by their likelihood.
_ALIKE = 0.7
_HARDLY = 0.3
# Share of all that is left from which it does not matter where an effect closes it.
_NEARLY_ALL = 0.9


@dataclass(frozen=True, eq=False)
class Scorer:
    """What every hypothesis on a record is judged by.

    Attributes:
        baseline: the baseline without any effect.
        spectral: ``(n_joints,)`` spectral noise floor [N·m].
        unrepeated: ``(n_joints,)`` power of noise in all trials less that in repeated ones [(N·m)²].
        scale: ``(n_joints,)`` standard deviation of each torque in the identification trials [N·m].
    """

    baseline: Baseline
    spectral: Array
    unrepeated: Array | float
    scale: Array

    def scored(self, before: Fit, found: Sequence[Hypothesis]) -> tuple[Scored, ...]:
        """Merits of hypotheses against the fit before them, in their order; one floor for all."""
        if not found:
            return ()
        floor = rough = self.floor(found[0].fit)
        if found[0].effect.smooths:
            # Noise that the first has smoothed differs less between repeated trials: no gap for that.
            rough = np.maximum(floor, self.floor(before))
        return tuple(self._score(before, item, floor, rough) for item in found)

    def floor(self, fit: Fit) -> Array:
        """Of repeated trials; of the spectrum where there are none."""
        repeat = repeat_floor(self.baseline.samples, self.baseline.judged(fit.residual))
        if repeat is None:
            return self.spectral
        return other_postures(np.maximum(repeat, 0.5 * self.spectral), self.unrepeated)

    def removed(self, before: Fit, item: Hypothesis) -> float:
        """Normalised power above the floor that a hypothesis removes from the identification trials."""
        least = self.baseline.solver.equations.floor**2
        old, new = (np.maximum(fit.sigma**2 - least, 0.0) for fit in (before, item.fit))
        return float(((old - new) / self.scale**2).sum())

    def ordered(self, before: Fit, found: list[Hypothesis]) -> list[Hypothesis]:
        """First those that remove about as much power as any, the likeliest of them first, and so on.

        By likelihood alone a little cleaned off a quiet joint would come before a lot taken from a bad one.
        """
        power = {id(item): self.removed(before, item) for item in found}
        order: list[Hypothesis] = []
        rest = sorted(found, key=lambda item: -power[id(item)])
        while rest:
            least = _ALIKE * max(power[id(rest[0])], 0.0)
            group = [item for item in rest if power[id(item)] >= least] or rest
            order += sorted(group, key=price)
            rest = [item for item in rest if item not in group]
        return order

    def _score(self, before: Fit, item: Hypothesis, floor: Array, rough: Array) -> Scored:
        """Merits of one against the floor; whether there is a gap is told by the rough one."""
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
        normal = change / self.scale**2
        strength = float(np.sqrt(max(float(normal[normal > 0.0].sum()), 0.0)))
        rest = float((np.maximum(old - floor**2, 0.0) / self.scale**2).sum())
        of_rest = strength**2 / max(rest, strength**2, 1e-300)
        place = int(np.argmax(ratio.sum(axis=1)))
        effect = item.effect
        # What acts on one joint alone has its place there, whatever the fit of all makes of other joints; unless that
        # fit had put nearly all of the gap elsewhere.
        if effect.own_joint and item.location in samples.joints:
            own = samples.joints.index(item.location)
            place = place if of_rest >= _NEARLY_ALL and closed[own] < _HARDLY else own
        left = int(np.sum((old > 2.0 * floor**2) & (closed < _HARDLY)))
        # Without validation trials there are the fitted ones alone to judge by.
        side = int(not samples.identification.all())
        # By the floor alone: sudden changes of an effect itself reach beyond the band, where the spectrum is taken.
        stands = float((first[place] ** 2).mean() / rough[place] ** 2)
        evidence, outside = float(ratio.sum() - cost), float(ratio[:, side].sum())
        quiet = min(float(self.spectral[place]), float(floor[place])) ** 2
        of_noise = float(change[place] / max(old[place] - quiet, 0.05 * old[place]))
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
            of_noise,
        )
