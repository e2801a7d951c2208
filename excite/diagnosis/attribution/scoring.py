"""How likely a hypothesis is beside what is modelled, and where it acts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.attribution.attribution import Scored
from excite.diagnosis.attribution.evidence import Judge, effective_counts
from excite.diagnosis.attribution.hypotheses import Hypothesis
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.noise_floor import other_postures, repeat_floor


@dataclass(frozen=True, eq=False)
class Scorer:
    """What every hypothesis on a record is judged by.

    Attributes:
        baseline: the baseline without any effect.
        spectral: ``(n_joints,)`` spectral noise floor [N·m].
        unrepeated: ``(n_joints,)`` power of noise in all trials less that in repeated ones [(N·m)²].
        scale: ``(n_joints,)`` standard deviation of each torque in the identification trials [N·m];
            infinite where the joint stands throughout.
    """

    baseline: Baseline
    spectral: Array
    unrepeated: Array | float
    scale: Array

    def floor(self, fit: Fit) -> Array:
        """Of repeated trials; of the spectrum where there are none."""
        repeat = repeat_floor(self.baseline.samples, self.baseline.judged(fit.residual))
        if repeat is None:
            return self.spectral
        return other_postures(np.maximum(repeat, 0.5 * self.spectral), self.unrepeated)

    def scored(self, before: Fit, item: Hypothesis, nats: float | None = None) -> Scored:
        """A hypothesis against the fit before it.

        Args:
            before: the fit without it.
            item: the hypothesis.
            nats: its evidence, where that is known from a fit of all effects.
        """
        samples = self.baseline.samples
        first, last = self.baseline.judged(before.residual), self.baseline.judged(item.fit.residual)
        # Of what this hypothesis leaves: what another has left to explain would count for correlated noise.
        counts = effective_counts(last, samples.identification, samples.trial_of_row)
        # Repeated trials may show less noise than the spectrum above the band makes one expect.
        judge = Judge(samples.identification, counts, np.minimum(self.spectral, self.floor(item.fit)))
        ratio = judge.ratio(first, last)
        cost = 0.5 * item.n_parameters * np.log(max(judge.count.sum(), 2.0)) + np.log(200.0)
        own = item.effect.own_joint and item.location in samples.joints
        place = samples.joints.index(item.location) if own else int(np.argmax(ratio.sum(axis=1)))
        left = judge.power(last)
        power = np.column_stack([left.identification, left.validation])
        evidence = float(ratio.sum() - cost) if nats is None else nats
        return Scored(item, evidence, place, power, counts)
