"""What an effect must reach to be named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from excite.diagnosis.search.attribution import Scored


@dataclass(frozen=True)
class Gates:
    """What an effect must reach to be named.

    Attributes:
        evidence: nats, identification and validation trials together, less the price of its parameters.
        validation: nats on validation trials alone.
        closed: share of the power above the floor, on validation trials, that it removes on some joint.
        evidence_again: nats of a further effect.
        validation_again: nats of a further effect on validation trials alone.
        closed_again: share that a further effect removes at its place.
        relative: strength of a further effect against the strongest one, as normalised torque amplitude.
        of_rest: share of all normalised power above the floor that a further effect removes.
        same_joint: share of a joint's power that is needed where the joint has an accepted effect already, and
            for timing.
        left: joints well above the floor that a further effect may leave as they are: where every joint has a
            little of something, naming one of them would be arbitrary. The same for a first effect that is a trifle.
        trifle: share of all normalised power above the floor below which an effect is one.
        most_of_rest: share of all normalised power above the floor from which a further effect may leave more joints.
        most: effects at most.
        stands: power at its place over the floor's, before it; a smaller rest would not be called a gap either.
        stands_least: the same that any effect needs: what is below the floor is no gap.
        stands_rough: the same for an effect that may smooth the model's torque, noise in it and all.
        closed_rough: share from which such an effect is named all the same.
        stands_smooth: what it needs in any case: noise of the encoders is not known better.
        evidence_faint: nats of an effect that stands less than that.
        validation_faint: nats of such an effect on validation trials alone.
        evidence_faint_again: nats of such a further effect.
        validation_faint_again: nats of such a further effect on validation trials alone.
        stands_alone: power over the floor's at the place of a further effect that needs no comparison with the rest.
        stands_apart: the same where all effects act on joints of their own, and the least for a further effect that
            does not.
        closed_alone: share that such an effect removes there.
        evidence_alone: nats of such an effect.
        validation_alone: nats of such an effect on validation trials alone.
        clear: power over the floor's at its place that a richer form needs where no textbook's form passes.
        closed_richer: share that such a form removes at its place.
        elsewhere: nats at other joints by which a moving link is known.
        clear_coupled: what stands clear where a richer form is known so.
        whole: share removed at its place from which an effect leaves no gap there; a short record of few joints
            has fewer nats to give, and these are enough then.
        evidence_whole: nats of such an effect.
        evidence_whole_again: nats of such a further effect.
        validation_whole_again: nats of such a further effect on validation trials alone.
    """

    evidence: float = 25.0
    validation: float = 4.0
    closed: float = 0.4
    evidence_again: float = 80.0
    validation_again: float = 30.0
    closed_again: float = 0.4
    relative: float = 0.1
    of_rest: float = 0.12
    same_joint: float = 0.6
    left: int = 2
    trifle: float = 0.1
    most_of_rest: float = 0.5
    most: int = 4
    stands: float = 1.5
    stands_least: float = 0.8
    stands_rough: float = 2.0
    closed_rough: float = 0.7
    stands_smooth: float = 1.25
    evidence_faint: float = 30.0
    validation_faint: float = 8.0
    evidence_faint_again: float = 80.0
    validation_faint_again: float = 20.0
    stands_alone: float = 4.0
    stands_apart: float = 2.0
    closed_alone: float = 0.8
    evidence_alone: float = 400.0
    validation_alone: float = 100.0
    clear: float = 20.0
    closed_richer: float = 0.98
    elsewhere: float = 200.0
    clear_coupled: float = 4.0
    whole: float = 0.9
    evidence_whole: float = 12.0
    evidence_whole_again: float = 25.0
    validation_whole_again: float = 4.0

    def passed_by(self, item: Scored, accepted: Sequence[Scored], joints: tuple[str, ...]) -> bool:
        """Whether an effect is named.

        Args:
            item: the effect.
            accepted: those that are named already.
            joints: names of the joints with rows.
        """
        if not item.hypothesis.settled:
            return False
        closed = float(item.closed[item.place])
        # An effect on its own joint alone leaves nothing at others, however strong.
        places = {joints[item.place], item.location}
        apart = all(a.hypothesis.effect.own_joint and a.location not in places for a in accepted)
        evidence, validation = self._nats(closed, again=bool(accepted))
        if item.hypothesis.effect.smooths and item.stands < self.stands_rough:
            if closed < self.closed_rough or item.stands < self.stands_smooth:
                return False
        if item.stands < self.stands:
            if not apart or item.of_noise < self.closed or item.stands < self.stands_least:
                return False
            evidence, validation = self._nats_faint(again=bool(accepted))
        if item.evidence < evidence or item.validation < validation or not item.hypothesis.significant:
            return False
        if accepted:
            return self._further(item, accepted, apart=apart)
        # Where every joint has a little of something, naming one of them would be arbitrary.
        arbitrary = item.left > self.left and item.of_rest < self.trifle
        return closed >= self.closed and not arbitrary

    def explained_by(self, item: Scored) -> bool:
        """Whether a richer form leaves next to nothing of a clear gap: with enough parameters half of one fits.

        What a moving link does to other joints no parameters make up.
        """
        if item.hypothesis.effect.moves and item.elsewhere >= self.elsewhere:
            return item.stands >= self.clear_coupled
        return item.stands >= self.clear and float(item.closed[item.place]) >= self.closed_richer

    def _further(self, item: Scored, accepted: Sequence[Scored], *, apart: bool) -> bool:
        effect, closed = item.hypothesis.effect, float(item.closed[item.place])
        if not item.hypothesis.physical:
            return False
        if effect.timing and any(a.hypothesis.effect.timing for a in accepted):
            return False
        if (item.name, item.location) in {(a.name, a.location) for a in accepted}:
            return False
        # What acts on several joints takes up a little of what each of them has left.
        if effect.moves and item.stands < self.stands_apart:
            return False
        # Bodies and geometry act on all joints alike: what one of them leaves another can take up.
        bodies = effect.moves and any(a.hypothesis.effect.moves for a in accepted)
        crowded = effect.timing or bodies or item.location in {a.location for a in accepted}
        if not crowded and (self._alone(item, apart=apart) or (apart and self._alike(item, accepted))):
            return True
        # What is most of the rest, and closes it, is no trace of an effect before it.
        most = item.of_rest >= self.most_of_rest
        if item.of_rest < self.of_rest or (item.left > self.left and not most):
            return False
        faint = item.strength < self.relative * max(a.strength for a in accepted)
        if faint and (crowded or not (apart or (most and closed >= self.whole))):
            return False
        if crowded and (float(item.closed.max()) if effect.timing else closed) < self.same_joint:
            return False
        return closed >= self.closed_again

    def _alone(self, item: Scored, *, apart: bool) -> bool:
        """Whether an effect is beyond doubt, whatever else is left and however small it is beside others."""
        stands = self.stands_apart if apart and item.hypothesis.effect.own_joint else self.stands_alone
        clear = item.stands >= stands and float(item.closed[item.place]) >= self.closed_alone
        return clear and item.evidence >= self.evidence_alone and item.validation >= self.validation_alone

    def _alike(self, item: Scored, accepted: Sequence[Scored]) -> bool:
        """Whether a joint has what another joint of the same machine has been found to have."""
        closes = item.stands >= self.stands and float(item.closed[item.place]) >= self.same_joint
        return closes and item.hypothesis.effect.own_joint and item.name in {a.name for a in accepted}

    def _nats(self, closed: float, *, again: bool) -> tuple[float, float]:
        """Nats that an effect needs in all and on validation trials, by the share that it closes at its place."""
        if closed >= self.whole:
            if again:
                return self.evidence_whole_again, self.validation_whole_again
            return self.evidence_whole, self.validation
        return (self.evidence_again, self.validation_again) if again else (self.evidence, self.validation)

    def _nats_faint(self, *, again: bool) -> tuple[float, float]:
        """The same for what hardly stands above the floor, whatever it closes."""
        if again:
            return self.evidence_faint_again, self.validation_faint_again
        return self.evidence_faint, self.validation_faint
