"""The gap of every channel as a budget: what each effect takes, what follows something without a name, the rest."""

from __future__ import annotations

from dataclasses import dataclass

from excite.diagnosis.answer.candidate import in_words
from excite.results import Interval, Name, Stated, Unbounded, UnboundedPositive

# What differs between repeats of one command beyond the noise of a trial.
NOT_REPEATED = "does not repeat"
# Shares below this are not worth a word in a sentence.
_WORTH = 0.05


@dataclass(frozen=True)
class EffectShare(Stated):
    """What an effect takes of a channel's gap.

    Attributes:
        effect: its name.
        location: its place.
        share: of the power above the noise floor on the trials that judge, 0…1 (below 0 where it does harm there).
        interval90: of the share, by blocks left out of what is fitted and of what judges.
    """

    effect: Name
    location: Name
    share: Unbounded
    interval90: Interval


@dataclass(frozen=True)
class UnnamedShare(Stated):
    """What a function of one thing takes, which has no name.

    Attributes:
        follows: position, velocity, load, acceleration, time, the name of another joint, or ``does not repeat``.
        share: of the power above the noise floor on the trials that judge.
        knots: where the piecewise linear function has its knots; empty where it is none.
        torque: its values there [the channel's unit].
    """

    follows: Name
    share: Unbounded
    knots: tuple[Unbounded, ...] = ()
    torque: tuple[Unbounded, ...] = ()


@dataclass(frozen=True)
class ChannelBudget(Stated):
    """A channel's gap and where it goes; shares of effects, unnamed ones and the rest add up to one.

    Attributes:
        noise_floor: what no model can go below [unit].
        gap: root mean square of measured less predicted without any effect, standstill left out [unit].
        effects: what named effects take.
        unnamed: what follows something.
        rest: what is left.
        weight: of the channel's gap among all, 0…1.
        unit: of noise floor and gap; of commands alone that of the torque that the servo must have asked for.
    """

    noise_floor: UnboundedPositive
    gap: UnboundedPositive
    effects: tuple[EffectShare, ...]
    unnamed: tuple[UnnamedShare, ...]
    rest: Unbounded
    weight: Unbounded = 0.0
    unit: Name = ""


@dataclass(frozen=True)
class Named:
    """An effect that the model of the gap has.

    Attributes:
        effect: its name.
        location: its place.
        share: of the whole gap above the noise, over all channels.
        probability: that this is the effect and the place.
        values: its parameters by name, with their deviations by blocks left out.
        nats: by which it predicts blocks better that were left out, less its price.
        rivals: what else would score alike in the company of all others.
        chances: by position in ``rivals``, their probabilities.
        surely: what it surely takes of the whole gap, the lower ends of its intervals.
        clear: whether what is left of some joint is clearly more without it, and it surely is there.
    """

    effect: str
    location: str
    share: float
    probability: float
    values: dict[str, tuple[float, float | None]]
    nats: float
    rivals: tuple[tuple[str, str], ...] = ()
    chances: tuple[float, ...] = ()
    surely: float = 0.0
    clear: bool = True


@dataclass(frozen=True)
class Detectable(Stated):
    """How large an effect would have to be for a record to show it.

    Attributes:
        effect: its name.
        location: its place.
        size: smallest size that would be named [unit], at which it is worth its price; null where none would.
        unit: SI unit; 1 where it has none.
    """

    effect: Name
    location: Name
    size: UnboundedPositive
    unit: Name


@dataclass(frozen=True)
class Budget:
    """The gap of a record.

    Attributes:
        channels: by name.
        named: effects of the model, largest share first.
        detectable: how large effects would have to be for the record to show them.
    """

    channels: dict[str, ChannelBudget]
    named: tuple[Named, ...]
    detectable: tuple[Detectable, ...] = ()

    @property
    def weights(self) -> dict[str, float]:
        """By channel, its share of the whole gap above the noise; all 0 where there is none."""
        return {name: channel.weight for name, channel in self.channels.items()}

    @property
    def rest(self) -> float:
        """Share of the whole gap above the noise that follows nothing."""
        return sum(channel.weight * channel.rest for channel in self.channels.values())

    @property
    def follows(self) -> dict[str, float]:
        """Shares of the whole gap above the noise without a name, by what they follow."""
        made: dict[str, float] = {}
        for channel in self.channels.values():
            for item in channel.unnamed:
                made[item.follows] = made.get(item.follows, 0.0) + channel.weight * item.share
        return made

    def sentence(self) -> str:
        """The budget over all channels in one sentence."""
        parts = [
            f"{in_words(item.effect, item.location)} {100 * item.share:.0f} %"
            for item in self.named
            if item.share >= _WORTH
        ]
        for name, share in sorted(self.follows.items(), key=lambda x: -x[1]):
            if share >= _WORTH:
                what = "what does not repeat" if name == NOT_REPEATED else f"unnamed, following {name},"
                parts.append(f"{what} {100 * share:.0f} %")
        if not parts:
            return self._noise()
        parts.append(f"the rest {100 * self.rest:.0f} %")
        return "Of the gap above the noise: " + "; ".join(parts) + "."

    def _noise(self) -> str:
        """The same where nothing in the gap follows anything: how near to the noise it is."""
        if not self.channels:
            return "Nothing was compared."
        # A channel whose gap is no more than its noise has no weight.
        above = {
            name: c.gap / max(c.noise_floor, 1e-300) for name, c in self.channels.items() if c.weight > 0.0
        }
        if not above:
            return "No channel's gap stands above its noise on the trials that judge."
        name = max(above, key=lambda channel: above[channel])
        most = self.channels[name]
        there = f"{most.gap:.3g} {most.unit}, noise {most.noise_floor:.3g} {most.unit}"
        return (
            "No effect and nothing that a joint does takes a part of the gap of the trials that judge; it stands "
            f"furthest above the noise at {name}: {there}, {above[name]:.3g} times as much."
        )
