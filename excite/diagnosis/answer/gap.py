"""The gap between record and model: how large it is, what closes, and where it lies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from excite.arrays import Array
from excite.diagnosis.answer.candidate import in_words
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.units import force_unit
from excite.finding import Finding, list_names
from excite.logs.signals.butterworth import noise_bandwidth
from excite.logs.signals.spectrum import welch_spectrum
from excite.results import FEW, HIDDEN, Interval, Name, Stated, Unbounded, UnboundedPositive, added_as, named


@dataclass(frozen=True)
class ChannelGap(Stated):
    """Gap of one channel: RMS over the validation trials of measured minus predicted [the channel's unit].

    Attributes:
        before: with the baseline alone.
        after: with the accepted effects.
        noise_floor: what no model can go below.
        unit: of the three.
    """

    before: UnboundedPositive
    after: UnboundedPositive
    noise_floor: UnboundedPositive
    unit: Name = field(default="N·m", metadata=added_as(""))


@dataclass(frozen=True)
class Gap(Stated):
    """The gap over all channels: root mean square over them, each divided by its standard deviation.

    Attributes:
        before: with the baseline alone.
        after: with the accepted effects.
        noise_floor: what no model can go below.
        share_closed: ``1 − (after² − floor²)/(before² − floor²)``; 0 where there was nothing to close.
        per_channel: by channel, in its own unit.
        interval: 90 % interval of what the effects, sized as they are, close on motions like the record's, their
            noise known; null where it was not computed or the record does not tell.
    """

    before: UnboundedPositive
    after: UnboundedPositive
    noise_floor: UnboundedPositive
    share_closed: Unbounded
    per_channel: Annotated[dict[Name, ChannelGap], FEW]
    interval: Interval | None = field(default=None, metadata=named("share_closed_90"))

    @property
    def of_positions(self) -> bool:
        """Whether it is a gap of positions, in roll-outs, as that of a log without torques is."""
        return of_positions(item.unit for item in self.per_channel.values())


@dataclass(frozen=True)
class Where(Stated):
    """One line of the map of where the gap lies.

    Attributes:
        channel: joint, or wrench component.
        share: its share of the gap's power above the noise floor, over all channels, 0…1; of a joint its weight in
            the budget.
        depends_on: what its residual follows most: velocity, position, load, acceleration, time, … or none.
        band_hz: frequencies that hold the middle 80 % of its residual's power [Hz].
        dependence: share of the residual's power that each thing explains, by name, 0…1.
    """

    channel: Name
    share: Unbounded
    depends_on: Name
    band_hz: Interval
    dependence: Annotated[dict[Name, Unbounded], FEW] = field(default_factory=dict)


# Share of a residual's power from which it is said to depend on something.
_LEAST = 0.02


def locate_residual(
    channel: str,
    share: float,
    residual: Array,
    features: Mapping[str, Array],
    trials: Sequence[Array],
    rate_hz: float,
) -> Where:
    """One line of the map: what a channel's residual follows, and at which frequencies it is.

    The dependence is the share of its power that functions of one thing alone explain, less what as many arbitrary
    columns would.

    Args:
        share: its share of the gap.
        residual: ``(n,)`` of the channel.
        features: by what they are functions of, ``(n, k)``.
        trials: the residual of each trial, those that judge too.
        rate_hz: of the samples.
    """
    dependence = {what: _explained_share(columns, residual) for what, columns in features.items()}
    best = max(dependence, key=lambda what: dependence[what])
    follows = best if dependence[best] > _LEAST else "nothing known"
    return Where(channel, share, follows, _power_band(trials, rate_hz), dependence)


def _explained_share(columns: Array, residual: Array) -> float:
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * max(float(size.max()), 1e-300)]
    rest = residual - columns @ np.linalg.lstsq(columns, residual, rcond=1e-8)[0]
    return max(0.0, 1.0 - float(rest @ rest) / max(float(residual @ residual), 1e-300) - 0.005)


def _power_band(trials: Sequence[Array], rate_hz: float) -> tuple[float, float]:
    """Frequencies between a tenth and nine tenths of a residual's power [Hz]."""
    # One grid of frequencies for all trials, which the shortest can fill.
    length = min(256, *(len(part) for part in trials))
    spectra = []
    for part in trials:
        f, p = welch_spectrum(part, rate_hz, length, centred=False)
        spectra.append(p)
    growth = np.cumsum(np.mean(spectra, axis=0))
    growth /= max(float(growth[-1]), 1e-300)
    low, high = (float(f[min(int(np.searchsorted(growth, x)), len(f) - 1)]) for x in (0.1, 0.9))
    return low, high


def of_positions(units: Iterable[str]) -> bool:
    """Whether a gap whose channels have these units is one of positions."""
    found = set(units)
    return bool(found) and found <= {"rad", "m"}


def describe_closed(positions: bool) -> str:
    """What is meant by what each effect of a list closes.

    Args:
        positions: whether the gap is one of positions.
    """
    of = "the torques that the servo asks for, not of the positions" if positions else "the whole"
    return (
        f"closed: share of the gap of {of}, above the noise, on the trials that judge; an accepted effect "
        "together with those before it, every other one alone"
    )


def share_closed(before: float, after: float, floor: float) -> float:
    """``1 − (after² − floor²)/(before² − floor²)``, 0 where nothing stands above the floor."""
    open_power = before**2 - floor**2
    return 0.0 if open_power <= 0.0 else 1.0 - (after**2 - floor**2) / open_power


# One trial as it was measured, and as the model tells it before and after the accepted effects.


@dataclass(frozen=True, eq=False)
class Curves:
    """A trial of a record.

    Attributes:
        trial: its name.
        validation: whether nothing was fitted on it.
        channels: names of the channels.
        units: unit of each.
        time: ``(n,)`` [s].
        measured: ``(n, n_channels)``, filtered as for the comparison.
        before: of the model alone, ``(n, n_channels)``.
        after: with the effects, ``(n, n_channels)``.
    """

    trial: str
    validation: bool
    channels: tuple[str, ...]
    units: tuple[str, ...]
    time: Array
    measured: Array
    before: Array
    after: Array


# A trial as its joints moved, and as the simulators move them.


@dataclass(frozen=True, eq=False)
class RolloutPath:
    """A trial beside its roll-outs; where nothing was simulated these are the record.

    Attributes:
        trial: its name.
        joints: of the columns.
        time: ``(n,)`` [s].
        recorded: positions, ``(n, n_joints)`` [rad or m].
        before: of the nominal simulator, likewise.
        after: of the simulator with the effects that help, likewise.
    """

    trial: str
    joints: tuple[str, ...]
    time: Array
    recorded: Array
    before: Array
    after: Array


# How far the gap shrinks, and how sure that is.

# Degrees of freedom that blocks must leave to tell a spread, and seconds of those within a trial.
_FREEDOM, _BLOCK_S = 2, 1.0
_DRAWS = 1000


def gap_of(
    samples: ArmSamples, before: Array, after: Array, floor: Array, scale: Array, rng: np.random.Generator
) -> Gap:
    """Gap on the validation trials before and after, with a 90 % interval of the share closed.

    Args:
        before: ``(n_joints, n_rows)`` residual of the baseline [N·m].
        after: the same with the effects.
        floor: ``(n_joints,)`` noise floor [N·m].
        scale: ``(n_joints,)`` standard deviation of the torques in the identification trials [N·m]; infinite for
            channels that the whole leaves out.
        rng: random numbers of the bootstrap.

    Returns:
        The gap; where there are no validation trials, on the identification trials.
    """
    old, new = (samples.squared_residuals(x)[:, samples.judging_rows].mean(axis=1) for x in (before, after))
    level = floor**2 / scale**2
    first, last = (float(np.sqrt(np.mean(x / scale**2))) for x in (old, new))
    total_floor = min(float(np.sqrt(level.mean())), first, last)
    share = share_closed(first, last, total_floor)
    interval = None
    if before is not after:
        was, now = (
            (samples.squared_residuals(x) / scale[:, None] ** 2).mean(axis=0) for x in (before, after)
        )
        interval = _bootstrap_interval(samples, was, now, level, share, rng)
    lowest = np.minimum(floor, np.sqrt(np.minimum(new, old)))
    channels = {
        name: ChannelGap(
            float(np.sqrt(old[j])),
            float(np.sqrt(new[j])),
            float(lowest[j]),
            force_unit(samples.robot, name),
        )
        for j, name in enumerate(samples.joints)
    }
    return Gap(first, last, total_floor, share, channels, interval)


def _bootstrap_interval(
    samples: ArmSamples, was: Array, now: Array, level: Array, share: float, rng: np.random.Generator
) -> tuple[float, float] | None:
    """90 % interval of the share closed on motions like the record's, by block bootstrap (Künsch 1989).

    Blocks are drawn from the validation trials, and whole trials from all: how much is left differs from motion to
    motion, and two validation trials hardly tell how much. The wider of the two counts. Of so few blocks
    percentiles are too narrow; they are taken as far out as Student's are beyond the normal distribution's
    (Hesterberg 2015, the expanded percentile interval). The floor is measured too, on one repeated trial: it is
    drawn as a mean of as many squares as filtered noise has there. No less than nothing can be left: of what can
    be, the shortest interval counts.

    Args:
        was: ``(n_rows,)`` normalised power of the residual before.
        now: ``(n_rows,)`` the same with the effects.
        level: ``(n_joints,)`` normalised power of the floor.
        share: share closed.
        rng: random numbers.

    Returns:
        Bounds with ``share`` between them, at most 1; None where nothing stands above the floor, or one block is all.
    """
    use, lowest = samples.identification_rows, float(level.mean())
    sides = [~use, use] if not use.all() else [use]
    room = float(was[sides[0]].mean()) - lowest
    if room <= 0.0:
        return None
    whole = [_rows_by_trial(samples, rows) for rows in sides]
    parts = [_rows_by_block(samples, sides[0])]
    drawn, freedom = [], []
    for blocks in (whole, parts):
        pool = [_block_spread(was, now, rows, own, lowest) for rows, own in zip(sides, blocks, strict=False)]
        size = np.sqrt([len(b) for b in blocks[0]])
        count = sum(len(own) - 1 for own in blocks if own)
        if count >= _FREEDOM:
            made = rng.choice(np.concatenate(pool), (_DRAWS, len(size))) @ size / (size @ size)
            drawn.append(made - made.mean())
            freedom.append(count)
    if not drawn:
        return None
    widest = max(drawn, key=lambda x: float(x.std()))
    independent = _count_independent_samples(samples)
    floors = rng.chisquare(independent, (_DRAWS, len(level))) / independent @ level / len(level)
    left = 1.0 - share + (widest - share * (floors - lowest)) / room
    tail = float(ndtr(stdtrit(freedom[0], 0.05)))
    low, high = _shortest_interval(np.maximum(left, 0.0), 1.0 - 2.0 * tail)
    return min(1.0 - high, share), max(1.0 - low, share)


def _shortest_interval(values: Array, held: float) -> tuple[float, float]:
    """Bounds of the shortest interval that holds a share of the values."""
    values = np.sort(values)
    count = int(np.ceil(held * len(values)))
    first = int(np.argmin(values[count - 1 :] - values[: len(values) - count + 1]))
    return float(values[first]), float(values[first + count - 1])


def _block_spread(
    was: Array, now: Array, rows: NDArray[np.bool_], blocks: list[NDArray[np.intp]], lowest: float
) -> Array:
    """What blocks leave beyond the share that all rows leave, times the root of their length, unbiased in power.

    Args:
        was: ``(n_rows,)`` normalised power before.
        now: ``(n_rows,)`` the same with the effects.
        rows: those of the blocks and of trials that repeat them.
        blocks: rows of each block.
        lowest: normalised power of the floor.
    """
    if len(blocks) < 2:
        return np.zeros(0)
    room = float(was[rows].mean()) - lowest
    share = max(float(now[rows].mean()) - lowest, 0.0) / room if room > 0.0 else 1.0
    size = np.array([len(b) for b in blocks])
    beyond = np.array([now[b].mean() - share * was[b].mean() for b in blocks])
    beyond -= np.average(beyond, weights=size)
    return beyond * np.sqrt(size * len(blocks) / (len(blocks) - 1))


def _rows_by_trial(samples: ArmSamples, rows: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Rows of each trial among these; a motion that was run again is no other motion."""
    chosen = np.unique(samples.trial_of_row[rows])
    names = {samples.trials[k].name for k in chosen}
    return [
        np.flatnonzero(samples.trial_of_row == k) for k in chosen if samples.trials[k].repeats not in names
    ]


def _rows_by_block(samples: ArmSamples, rows: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Rows of blocks of each trial among these."""
    length = max(1, round(_BLOCK_S * samples.bands.rate_hz))
    made: list[NDArray[np.intp]] = []
    for k in np.unique(samples.trial_of_row[rows]):
        index = np.flatnonzero(samples.trial_of_row == k)
        made += np.array_split(index, max(1, len(index) // length))
    return made


def _count_independent_samples(samples: ArmSamples) -> float:
    """Independent samples that filtered noise has in the shortest trial, by which a repeat is limited."""
    bands = samples.bands
    seconds = min(len(trial.rows) for trial in samples.trials) / bands.rate_hz
    return max(1.0, noise_bandwidth(samples.rate_hz, bands.rows_hz) * samples.rate_hz * seconds)


# The gap of every channel as a budget: what each effect takes, what follows something without a name, the rest.

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
        clear: whether what is left of some joint is clearly more without it, it surely is there, and blocks left out of
            the fit are surely predicted by it.
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
    def channel_weights(self) -> dict[str, float]:
        """By channel, its share of the whole gap above the noise; all 0 where there is none."""
        return {name: channel.weight for name, channel in self.channels.items()}

    @property
    def unexplained_share(self) -> float:
        """Share of the whole gap above the noise that follows nothing."""
        return sum(channel.weight * channel.rest for channel in self.channels.values())

    @property
    def unnamed_shares(self) -> dict[str, float]:
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
        for name, share in sorted(self.unnamed_shares.items(), key=lambda x: -x[1]):
            if share >= _WORTH:
                what = "what does not repeat" if name == NOT_REPEATED else f"unnamed, following {name},"
                parts.append(f"{what} {100 * share:.0f} %")
        if not parts:
            return self._describe_noise()
        parts.append(f"the rest {100 * self.unexplained_share:.0f} %")
        return "Of the gap above the noise: " + "; ".join(parts) + "."

    def _describe_noise(self) -> str:
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


# What predictors far simpler than a simulator reach where it is judged.

# Up to so many times the floor a model does what can be done, and its neighbours tell nothing.
_DONE = 1.3


@dataclass(frozen=True)
class TrivialErrors(Stated):
    """RMS errors of one channel on the rows that judge [unit]; None what the record does not tell.

    Attributes:
        command: of the command taken for the position; null for torques.
        delayed_command: of the command a while ago, to a scale and an offset.
        fir: of a linear filter from the command to the position.
        repeat: by which trials with the same command differ; null without such.
        model: of the simulator with the effects found.
        floor: what no model can go below.
        unit: of them all.
        delay_s: delay of the delayed command [s].
        fir_s: length of the filter [s].
    """

    command: UnboundedPositive | None = None
    delayed_command: UnboundedPositive | None = None
    fir: UnboundedPositive | None = None
    repeat: UnboundedPositive | None = None
    model: UnboundedPositive | None = None
    floor: float = field(default=0.0, metadata=HIDDEN)
    unit: Name = "rad"
    delay_s: UnboundedPositive | None = None
    fir_s: UnboundedPositive | None = None

    @property
    def least_learnt_error(self) -> float | None:
        """The least error of the predictors that have learnt from commands."""
        known = [value for value in (self.delayed_command, self.fir) if value is not None]
        return min(known) if known else None


def find_beaten_channels(errors: Mapping[str, TrivialErrors]) -> tuple[Finding, ...]:
    """A finding where a simulator is no better on trials left out than what has no physics."""
    known = {name: (e, e.least_learnt_error, e.model) for name, e in errors.items()}
    worse = {
        name: (item, best, model)
        for name, (item, best, model) in known.items()
        if best is not None and model is not None and model >= max(best, _DONE * item.floor)
    }
    if not worse:
        return ()
    said = [
        f"{name} {model:.2g} {item.unit} against {best:.2g} of {_name_best_predictor(item)}"
        for name, (item, best, model) in worse.items()
    ]
    text = (
        f"at {len(worse)} of {len(errors)} joints the simulator is no better on trials left out than "
        f"a linear filter or a delay of the command: {list_names(said)}; they do not show that its physics is right"
    )
    figures = {
        **{f"model.{name}": model for name, (_, _, model) in worse.items()},
        **{f"trivial.{name}": best for name, (_, best, _) in worse.items()},
    }
    return (
        Finding(
            "no_better_than_trivial",
            text,
            figures,
            tuple(worse),
            "limits",
            remedy="take the filter where only positions are wanted, or look for what the model lacks",
        ),
    )


def _name_best_predictor(item: TrivialErrors) -> str:
    fir, late = item.fir, item.delayed_command
    return "the filter" if late is None or (fir is not None and fir <= late) else "the delay"
