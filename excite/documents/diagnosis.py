"""``excite.diagnosis/1``: where the gap lies, which effect causes it, how far it shrinks."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from excite.documents.document import (
    MOST_CHANNELS,
    MOST_ENTRIES,
    Block,
    Count,
    Document,
    FilePath,
    Interval,
    Maybe,
    MaybePositive,
    Name,
    Names,
    Seconds,
    Text,
    Texts,
    model_of,
)
from excite.finding import Finding

# What explains how much of a diagnosis's gap: a part of ``excite.diagnosis/1``.


class EffectShare(Block):
    """What a named effect takes of a channel's gap."""

    effect: Name = Field(description="name of the effect")
    location: Name = Field(description="its place")
    share: Maybe = Field(description="of the channel's power above the noise floor, on trials that judge")
    interval90: Interval = Field(description="90 % interval of the share, by blocks left out")


class UnnamedShare(Block):
    """What a function of one thing takes of a channel's gap, which no effect's name stands for."""

    follows: Name = Field(
        description="position, velocity, load, acceleration, time, another joint, does not repeat"
    )
    share: Maybe = Field(description="of the channel's power above the noise floor, on trials that judge")
    knots: Annotated[list[Maybe], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="of the piecewise linear function; none where it is no function of one thing"
    )
    torque: Annotated[list[Maybe], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="its values there [the channel's unit]"
    )


class ChannelBudget(Block):
    """A channel's gap and where it goes; shares of effects, unnamed ones and the rest add up to one."""

    noise_floor: MaybePositive = Field(description="what no model can go below [unit]")
    gap: MaybePositive = Field(description="without any effect, standstill left out [unit]")
    unit: Name = Field(default="", description="unit of the two")
    weight: Maybe = Field(default=0.0, description="of the channel's gap among all channels")
    effects: Annotated[list[EffectShare], Field(max_length=MOST_ENTRIES)] = Field(
        description="what named effects take"
    )
    unnamed: Annotated[list[UnnamedShare], Field(max_length=MOST_ENTRIES)] = Field(
        description="what follows something and has no name"
    )
    rest: Maybe = Field(description="share that is left")


class Detectable(Block):
    """How large an effect would have to be for this record to show it."""

    effect: Name = Field(description="name of the effect")
    location: Name = Field(description="its place")
    size: MaybePositive = Field(description="smallest size that would be named [unit]; null where none would")
    unit: Name = Field(description="SI unit; 1 where it has none")


class Estimate(Block):
    """A fitted parameter of an effect."""

    value: Maybe = Field(description="in its unit")
    std: MaybePositive = Field(description="standard deviation in its unit; null where it is not known")
    unit: Name = Field(description="SI unit; 1 where it has none")


class Candidate(Block):
    """An effect at a place, and how well it explains the gap."""

    effect: Name = Field(description="name of the effect")
    location: Name | None = Field(description="joint, link, sensor, base or group of channels")
    parameters: Annotated[dict[Name, Estimate], Field(max_length=MOST_ENTRIES)] = Field(
        description="fitted parameters by name"
    )
    evidence: Maybe = Field(description="log-likelihood ratio less the price of its parameters [nats]")
    gap_after: MaybePositive = Field(description="gap with it, as share of the signal [no unit]")
    share_closed: Maybe = Field(
        description="share of the gap above the noise that it closes: of the torques, or wrenches, on the trials that "
        "judge; an accepted effect together with those before it, every other one alone"
    )
    tied_locations: Names = Field(default=[], description="places that the data cannot tell from its own")
    probability: MaybePositive = Field(
        default=None, description="that this is the effect and the place; null where it was not computed"
    )
    share_closed_90: Interval | None = Field(
        default=None, description="90 % interval of the share closed; null where it was not computed"
    )


class ChannelGap(Block):
    """Gap of one channel."""

    before: MaybePositive = Field(description="of the baseline [unit]")
    after: MaybePositive = Field(description="with the accepted effects [unit]")
    noise_floor: MaybePositive = Field(description="what no model can go below [unit]")
    unit: Name = Field(default="", description="unit of the three")


Channels = Annotated[dict[Name, ChannelGap], Field(max_length=MOST_CHANNELS)]
Errors = Annotated[dict[Name, MaybePositive], Field(max_length=MOST_CHANNELS)]


class Gap(Block):
    """The gap over all channels, as share of the signal."""

    before: MaybePositive = Field(description="of the baseline [no unit]")
    after: MaybePositive = Field(description="with the accepted effects [no unit]")
    noise_floor: MaybePositive = Field(description="what no model can go below [no unit]")
    share_closed: Maybe = Field(description="1 − (after² − floor²)/(before² − floor²)")
    share_closed_90: Interval | None = Field(
        default=None, description="90 % interval of the share closed; null where it was not computed"
    )
    per_channel: Channels = Field(description="by channel")


class Simulation(Block):
    """Short roll-outs of the nominal and the augmented simulator against the record."""

    before: Errors = Field(description="RMS error of the nominal simulator by channel [rad or m]")
    after: Errors = Field(description="RMS error of the augmented simulator by channel [rad or m]")
    floor: Errors = Field(default={}, description="what noise alone makes by channel [rad or m]")
    horizon_s: Seconds = Field(description="length of a roll-out [s]")
    model: FilePath | None = Field(description="file of the augmented simulator; null where none was written")
    driven_by: Text = Field(default="the record", description="what drives the roll-outs")
    warnings: Texts = Field(default=[], description="what the simulator cannot express")

    @model_validator(mode="after")
    def _same_channels(self) -> Simulation:
        for name in self.before:
            if name not in self.after:
                raise ValueError(f"after should have the channel {name[:60]!r} of before")
        return self


class Where(Block):
    """One line of the map of the gap."""

    channel: Name = Field(description="joint or component of a wrench")
    share: Maybe = Field(description="its share of the gap's power above the noise floor")
    depends_on: Name | None = Field(description="what its gap follows most")
    band_hz: Interval = Field(description="frequencies that hold the middle 80 % of its power [Hz]")
    dependence: Annotated[dict[Name, Maybe], Field(max_length=MOST_CHANNELS)] = Field(
        default={}, description="share of its power that each thing explains"
    )


class NextExperiment(Block):
    """What to measure next."""

    why: Text = Field(description="one sentence")
    separates: Texts = Field(description="effects that it tells apart")
    motion: FilePath | None = Field(description="motion file; null where none helps or none was planned")


class LogFault(Block):
    """Something that was wrong with the record."""

    kind: Name = Field(description="a word that programs can test for")
    where: Text = Field(description="trial, channel or both")
    what: Text = Field(description="one sentence with the number")
    cause: Text = Field(description="the likely cause")
    repaired: bool = Field(description="whether it was repaired for the diagnosis")


class Noticed(model_of(Finding)):  # type: ignore[misc]
    """What the doctor found in the record."""

    code: Name = Field(description="as kind")
    where: Text = Field(description="trials and places")
    message: Text = Field(description="as text")


class TrivialErrors(Block):
    """What predictors far simpler than a simulator reach where it is judged, and it beside them: RMSE [unit]."""

    command: MaybePositive = Field(description="of the command taken for the position; null for torques")
    delayed_command: MaybePositive = Field(description="of the command delayed, scaled and offset")
    fir: MaybePositive = Field(description="of a linear filter from the command to the position")
    repeat: MaybePositive = Field(description="by which trials with one command differ; null without such")
    model: MaybePositive = Field(default=None, description="of the simulator or model with the effects found")
    unit: Name = Field(default="rad", description="unit of them all")
    delay_s: MaybePositive = Field(default=None, description="delay of the delayed command [s]")
    fir_s: MaybePositive = Field(default=None, description="length of the filter [s]")


class Absorbed(Block):
    """A size that was taken from the record before the first effect was asked for."""

    joint: Name = Field(description="its joint")
    parameter: Name = Field(description="word of modelled, gain of the servo or torque constant")
    value: Maybe = Field(description="fitted [unit]")
    std: MaybePositive = Field(description="standard deviation [unit]; null where it is not known")
    unit: Name = Field(description="SI unit")
    interval90: Interval | None = Field(description="90 % interval [unit]; null where it was not computed")


class Applied(Block):
    """The robot that was written with the effects in it."""

    robot: FilePath = Field(description="its robot.yaml, from --out or the working folder")
    written: Texts = Field(description="what was changed")
    left_out: Texts = Field(description="what the files have no place for")


class Diagnosis(Document):
    """Where the gap lies, which effect causes it, how far it shrinks."""

    schema_: Literal["excite.diagnosis/1"] = Field(alias="schema", description="version of this document")
    robot: Name | None = Field(default=None, description="name of the robot")
    log_file: FilePath | None = Field(
        default=None,
        description="the log, relative to this document's folder; null where it was made in memory",
    )
    robot_file: FilePath | None = Field(
        default=None, description="the nominal robot where another than the log's was given, likewise"
    )
    verdict: Literal["effect", "none", "ambiguous", "unknown"] = Field(description="what was found")
    effect: Name | None = Field(description="the accepted effect, or the likeliest of those that tie")
    location: Name | None = Field(description="its likeliest place, or the place of an unknown gap")
    tied_locations: Names = Field(description="places that the data cannot tell from it, itself among them")
    candidates: Annotated[list[Candidate], Field(max_length=MOST_ENTRIES)] = Field(
        description="likeliest first"
    )
    n_tied: Count = Field(default=0, description="leading candidates that the data cannot tell apart")
    effects: Annotated[list[Candidate], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="accepted effects in the order in which they were added"
    )
    gap: Gap = Field(description="the gap before and after")
    simulation: Simulation | None = Field(description="roll-outs; null where there were none")
    where: Annotated[list[Where], Field(max_length=MOST_CHANNELS)] = Field(
        description="map of the gap, largest share first"
    )
    next_experiment: NextExperiment | None = Field(description="what would settle what is open")
    sentence: Text = Field(default="", description="what was found, in one sentence")
    log: Annotated[list[LogFault], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="what was wrong with the record"
    )
    budget: Annotated[dict[Name, ChannelBudget], Field(max_length=MOST_CHANNELS)] = Field(
        default={}, description="where each channel's gap goes; empty where it was not computed"
    )
    budget_sentence: Text = Field(default="", description="the budget in one sentence")
    detectable: Annotated[list[Detectable], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="how large effects would have to be for the record to show them"
    )
    trivial: Annotated[dict[Name, TrivialErrors], Field(max_length=MOST_CHANNELS)] = Field(
        default={}, description="by channel, what simple predictors reach on the rows that judge"
    )
    applied: Applied | None = Field(
        default=None, description="the robot that was written; null without --apply"
    )
    findings: Annotated[list[Noticed], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="the same, with their figures"
    )
    warnings: Texts = Field(default=[], description="limits of what was said, one sentence each")
    modelled: Texts = Field(
        default=[], description="what the model had before the first effect, as in log.yaml"
    )
    baseline: Annotated[list[Absorbed], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="what of it was fitted to the record, joint by joint"
    )
