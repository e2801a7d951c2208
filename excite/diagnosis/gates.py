"""What an effect must reach to be named."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Gates:
    """What an effect must reach to be named.

    Attributes:
        evidence: nats, identification and validation trials together, less the price of its parameters.
        validation: nats on validation trials alone.
        closed: share of the power above the floor, on validation trials, that it removes on some joint.
        evidence_again: nats of a further effect.
        validation_again: nats of a further effect on validation trials alone.
        closed_again: share that a further effect removes.
        relative: strength of a further effect against the strongest one, as normalised torque amplitude.
        of_rest: share of all normalised power above the floor that a further effect removes.
        same_joint: share of a joint's power that is needed where the joint has an accepted effect already, and
            for timing.
        left: joints well above the floor that a further effect may leave as they are: where every joint has a
            little of something, naming one of them would be arbitrary.
        most_of_rest: share of all normalised power above the floor from which it is not.
        most: effects at most.
        stands: power at its place over the floor's, before it; a smaller rest would not be called a gap either.
        evidence_faint: nats of an effect that stands less than that.
        validation_faint: nats of such an effect on validation trials alone.
        evidence_faint_again: nats of such a further effect.
        validation_faint_again: nats of such a further effect on validation trials alone.
        clear: the same for a richer form of an effect that does not pass in its textbook's form.
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
    closed_again: float = 0.2
    relative: float = 0.1
    of_rest: float = 0.12
    same_joint: float = 0.6
    left: int = 2
    most_of_rest: float = 0.5
    most: int = 3
    stands: float = 1.5
    evidence_faint: float = 50.0
    validation_faint: float = 10.0
    evidence_faint_again: float = 80.0
    validation_faint_again: float = 20.0
    clear: float = 20.0
    closed_richer: float = 0.98
    elsewhere: float = 200.0
    clear_coupled: float = 4.0
    whole: float = 0.9
    evidence_whole: float = 12.0
    evidence_whole_again: float = 25.0
    validation_whole_again: float = 4.0

    def nats(self, closed: float, *, again: bool) -> tuple[float, float]:
        """Nats that an effect needs in all and on validation trials, by the share that it closes at its place."""
        if closed >= self.whole:
            if again:
                return self.evidence_whole_again, self.validation_whole_again
            return self.evidence_whole, self.validation
        return (self.evidence_again, self.validation_again) if again else (self.evidence, self.validation)

    def nats_faint(self, *, again: bool) -> tuple[float, float]:
        """The same for what hardly stands above the floor, whatever it closes."""
        if again:
            return self.evidence_faint_again, self.validation_faint_again
        return self.evidence_faint, self.validation_faint
