"""Whether closed-loop roll-outs confirm what the servo's torques speak for, and what stays open without torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Candidate, Estimate
from excite.diagnosis.answer.gap import ChannelGap, Gap, share_closed
from excite.diagnosis.answer.result import Diagnosis, NextExperiment, Rollout
from excite.diagnosis.attribution.structured import STRUCTURED
from excite.diagnosis.effects.readings.time_delay import TimeDelay
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.servo.witness import Witness

# Effects that leave more of every joint's roll-out error are not confirmed, nor are those that make it worse.
_CONFIRMS = 0.95


def confirmed(gap: Gap, said: Witness | None = None) -> bool:
    """Whether roll-outs are clearly nearer to the record, or at least do not speak against the effects.

    Nearer is on some joint, and no further in all. What the encoders' noise has of the error, no simulator takes
    away.

    Args:
        gap: of roll-outs with the effects that help.
        said: by all effects' change of the roll-outs.
    """
    if said is not None and not said.speaks_against:
        return True

    def left(value: float, floor: float) -> float:
        return float(np.sqrt(max(value**2 - floor**2, 0.0)))

    channels = gap.per_channel.values()
    return gap.after <= gap.before and any(
        left(c.after, c.noise_floor) < _CONFIRMS * left(c.before, c.noise_floor) for c in channels
    )


def position_gap(rollout: Rollout, deviation: Array, floor: Array) -> Gap:
    """The gap in positions, from closed-loop roll-outs.

    Args:
        rollout: the comparison.
        deviation: ``(n_joints,)`` standard deviation of the positions in identification trials [rad].
        floor: ``(n_joints,)`` noise of the filtered positions [rad].
    """
    names = list(rollout.before)
    before, after = (np.array([x[n] for n in names]) for x in (rollout.before, rollout.after))
    floor = np.minimum(floor, np.minimum(before, after))
    first, last, least = (float(np.sqrt(np.mean((x / deviation) ** 2))) for x in (before, after, floor))
    channels = {
        n: ChannelGap(float(b), float(a), float(f), "rad")
        for n, b, a, f in zip(names, before, after, floor, strict=True)
    }
    return Gap(first, last, least, share_closed(first, last, least), channels)


def above_noise(joints: Sequence[str], gap: Gap) -> tuple[str, ...]:
    """Those of some joints whose roll-outs are off by more than the noise of the positions that they are held against.

    What torques leave there else, a servo that stiff, or encoders that coarse, hide in the positions; the torques are
    made of the same positions.

    Args:
        joints: with a rest of their torques that is no noise.
        gap: of roll-outs.
    """
    return tuple(
        j
        for j in joints
        if j in gap.per_channel
        and gap.per_channel[j].after ** 2 > STRUCTURED * gap.per_channel[j].noise_floor ** 2
    )


def with_twin(
    result: Diagnosis, estimated: bool, *, lags: bool = False, delay: Estimate | None = None
) -> Diagnosis:
    """Ambiguous where another name means the same without torque.

    Args:
        result: the diagnosis.
        estimated: whether gains were estimated: inertia and braking that a joint lacks, or has too
            much, are a wrong gain then.
        lags: whether a lag is clearly no delay.
        delay: what a delay in the place of a lag would be.
    """
    first = result.effects[0]
    effect = EFFECTS[first.effect]
    names = () if lags else effect.twins_without_torque
    twins = [replace(first, effect=name) for name in (*names, *(effect.twins_of_a_gain if estimated else ()))]
    if not twins:
        return result
    if delay is not None:
        twins = [replace(t, parameters={"delay": delay}) if t.effect == TimeDelay.name else t for t in twins]
    rest = tuple(c for c in result.candidates if (c.effect, c.location) != (first.effect, first.location))
    tied: tuple[Candidate, ...] = (first, *twins)
    said = " and ".join(c.effect.replace("_", " ") for c in tied)
    return replace(
        result,
        verdict="ambiguous",
        candidates=(*tied, *rest),
        n_tied=len(tied),
        next_experiment=NextExperiment(
            f"{said} look alike without torque; what tells them apart: a torque or current reading",
            tuple(f"{c.effect}@{c.location}" for c in tied),
        ),
    )
