"""What the attribution found, step by step."""

from __future__ import annotations

from dataclasses import dataclass

from excite.arrays import Array
from excite.diagnosis.attribution.hypotheses import Hypothesis
from excite.diagnosis.effects.context import Context
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.joint_torque import Fit


@dataclass(frozen=True, eq=False)
class Scored:
    """A hypothesis against the fit before it.

    Attributes:
        hypothesis: the hypothesis.
        evidence: nats less the price of its parameters and of the candidates tried.
        place: index of the joint that it acts on; of what acts on several, of the one that it changes most.
        power: ``(n_joints, 2)`` mean squares that it leaves, identification and validation [(N·m)²].
        count: ``(n_joints, 2)`` effective samples of what it leaves.
    """

    hypothesis: Hypothesis
    evidence: float
    place: int
    power: Array
    count: Array

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.hypothesis.effect.name

    @property
    def location(self) -> str:
        """Its place."""
        return self.hypothesis.location


@dataclass(frozen=True, eq=False)
class Stage:
    """One step of the attribution.

    Attributes:
        context: what the effects were tried against.
        ranking: candidates, best first.
        accepted: the one that was accepted, None at the end.
    """

    context: Context
    ranking: tuple[Scored, ...]
    accepted: Scored | None


@dataclass(frozen=True, eq=False)
class Attribution:
    """All steps.

    Attributes:
        stages: in order; the last accepts nothing.
        before: fit of the baseline.
        after: fit with all accepted effects.
        final: the baseline with them.
        floor: ``(n_joints,)`` noise floor after them [N·m].
        scale: ``(n_joints,)`` standard deviation of each torque in the identification trials [N·m];
            infinite where the joint stands throughout.
        stranger: what explains the rest better than any effect that has a name, and has none itself.
    """

    stages: tuple[Stage, ...]
    before: Fit
    after: Fit
    final: Baseline
    floor: Array
    scale: Array
    stranger: Scored | None = None

    @property
    def accepted(self) -> tuple[Scored, ...]:
        """Accepted effects in order."""
        return tuple(s.accepted for s in self.stages if s.accepted is not None)
