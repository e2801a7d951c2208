"""Errors in the naming of channels, found by comparison with the nominal model, and the log without them.

Nominal inertias are off by some tenths and friction is not known; a turned sign, an exchanged joint or a wrong clock
spoils the prediction by far more. Every mistake is undone in turn; the one that brings most is believed where it brings
much, and the search goes on from there: mistakes come in company.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, permutations, product

import numpy as np

from excite.arrays import Array, Flags
from excite.doctor.channel_mapping import Reading
from excite.doctor.doubt import Doubt
from excite.doctor.inertial_prior import STRONG_ODDS, Judgement
from excite.doctor.mistakes.joints import (
    exchange_places,
    find_base_frame,
    find_clock,
    find_differential,
    find_exchanged_positions,
    find_gravity,
    find_order,
    find_position_sign,
    find_revolutions,
    find_torque_order,
    find_turned_joints,
    find_unit,
    find_zeros,
    zeros_together,
)
from excite.doctor.mistakes.torques import find_delay, find_missing_weight, find_torque_sign
from excite.doctor.samples import THE_UNIT, Correction, Mistake, Samples
from excite.doctor.thresholds import THRESHOLD, is_near_one
from excite.doctor.torque_samples import TorqueSamples
from excite.doctor.torque_scale import TORQUE_SCALE
from excite.doctor.wrench_samples import WrenchSamples
from excite.logs.columns import WRENCH_AXES
from excite.logs.units import size_of


@dataclass(frozen=True, eq=False)
class Misreading:
    """A mistake that was found.

    Attributes:
        correction: what undoes it.
        mistake: what it is.
        before: share of the channels' power that nothing explains as they were, geometric mean.
        after: the same with it undone.
        gain: logarithm of the likelihood ratio of the reading without it to that with it [nat].
        sure: probability of the mistake beside all that were tried.
    """

    correction: Correction
    mistake: Mistake
    before: float
    after: float
    gain: float
    sure: float

    @classmethod
    def of(
        cls, correction: Correction, mistake: Mistake, before: Judgement, after: Judgement, merit: float
    ) -> Misreading:
        """By what is left before and after, and the logarithm of its posterior odds."""
        left, then = (float(np.exp(2.0 * judged.left.mean())) for judged in (before, after))
        # To the three digits of documents, in which only what was counted is certain.
        sure = min(float(1.0 / (1.0 + np.exp(-merit))), 0.999)
        return cls(correction, mistake, left, then, before.odds(after), sure)


def misreadings(
    samples: Samples, reading: Reading, mistakes: Sequence[Mistake]
) -> tuple[Reading, tuple[Misreading, ...]]:
    """Undo mistakes one after the other, each time the one that brings most.

    Of k corrections that are tried each has prior odds of 1/k (Bonferroni): what is believed has posterior odds of
    twenty to one at least, and matters.

    Args:
        samples: samples of the log.
        reading: as the log states its channels.
        mistakes: those that are possible.

    Returns:
        The reading without them, and what was found.
    """
    found: list[Misreading] = []
    left = samples.judged(reading)
    while len(found) < THRESHOLD.most_mistakes:
        # Where hardly anything is left there is nothing to gain.
        spare = left.left - 0.5 * np.log(THRESHOLD.least_share)
        gainable = float(left.counts @ spare) + left.cost > STRONG_ODDS
        # Those that are believed come before those that only surprise.
        chosen: list[tuple[bool, float, Correction, Mistake, Judgement]] = []
        tried, promising = find_promising(
            samples, reading, [m for m in mistakes if gainable or m.may_surprise]
        )
        for mistake, correction in promising:
            then = samples.judged(correction.reading, left.counts)
            merit = left.posterior(then, tried=tried, changes=correction.changes)
            believed = merit > STRONG_ODDS and _explains(samples, correction, left, then)
            size = merit if believed else correction.surprise
            if size is not None:
                chosen.append((believed, size, correction, mistake, then))
        if not chosen:
            break
        _, merit, correction, mistake, then = max(chosen, key=lambda item: item[:2])
        found.append(Misreading.of(correction, mistake, left, then, merit))
        reading, left = correction.reading, samples.judged(correction.reading)
    return reading, tuple(found)


def refine_zeros(
    samples: TorqueSamples, reading: Reading, found: tuple[Misreading, ...], mistakes: Sequence[Mistake]
) -> tuple[Reading, tuple[Misreading, ...]]:
    """Zeros of all joints, fitted together beside likely bodies, with how well they are known.

    What one of several zeros was first believed to be holds part of the others, and one alone may bring nothing: zeros
    of all joints are free together (Gauss and Newton), those that were not found as far as calibrations leave them.

    Returns:
        The reading, and what was found, with one mistake of all zeros.
    """
    mine = [one for one in found if one.mistake.name == "zero_position" and not one.correction.certain]
    zero = next((one for one in mistakes if one.name == "zero_position"), None)
    if zero is None or (found and not mine):
        return reading, found
    before = samples.judged(reading)
    n = len(samples.joints)
    turning = ~samples.sliding
    off = np.isin(samples.joints, [place for one in mine for place in one.correction.places])
    usual, std, start = 0.5 * THRESHOLD.least_zero_rad, np.zeros(n), reading.zero
    for _ in range(8):
        spread = np.where(off, np.pi / 2, np.where(turning, usual, 1e-9))
        judged = samples.judged(reading, zeros=spread)
        step, std = judged.moved[-n:], judged.std[-n:]
        off |= turning & (np.abs(step) > np.maximum(usual, 2.0 * std))
        step = np.where(off, np.clip(step, -0.2, 0.2), 0.0)
        reading = replace(reading, zero=reading.zero + step)
        if np.abs(step).max() < 1e-3:
            break
    rest = tuple(one for one in found if one not in mine)
    if off.sum() == 1 and (np.abs(reading.zero) < 2.0 * std)[off].all():
        # One zero alone that may as well be none: something else is there, a load for instance.
        return replace(reading, zero=np.where(off, 0.0, reading.zero)), rest
    if not off.any():
        return reading, found
    correction = zeros_together(samples, reading, off, std)
    after = samples.judged(reading, before.counts)
    if not mine:
        merit = before.posterior(after, tried=n, changes=correction.changes)
        if merit <= STRONG_ODDS or not _explains(samples, correction, before, after):
            return replace(reading, zero=start), found
        return reading, (Misreading.of(correction, zero, before, after, merit),)
    first = mine[0]
    merged = replace(first, correction=correction, after=float(np.exp(2.0 * after.left.mean())))
    return reading, tuple(merged if one is first else one for one in found if one is first or one in rest)


def find_promising(
    samples: Samples, reading: Reading, mistakes: Sequence[Mistake]
) -> tuple[int, list[tuple[Mistake, Correction]]]:
    """How many corrections there are, and the best of each mistake by the nominal bodies alone, which are quick."""
    chosen, tried = [], 0
    for mistake in mistakes:
        corrections = list(mistake.corrections(samples, reading))
        some = samples.thin_out(len(corrections))
        scored = [(-float(some.left(item.reading).sum()), k, item) for k, item in enumerate(corrections)]
        tried += len(scored)
        chosen += [(mistake, item) for *_, item in sorted(scored, reverse=True)[:3]]
    return tried, chosen


def _explains(samples: Samples, correction: Correction, left: Judgement, then: Judgement) -> bool:
    """Whether channels that gain, and those that were changed, are explained then.

    Where no channel was changed and none gains, likelier bodies are all that speaks for the change; of torques that
    nothing explains they say nothing.
    """
    changed = [name in correction.places and name not in correction.along for name in samples.channels]
    return explained(left.left, then.left, np.array(changed))


def explained(before: Array, after: Array, changed: Flags) -> bool:
    """Whether channels are explained that gain by another reading or that it changes: by likely bodies, for the most.

    Args:
        before: ``(n,)`` half the logarithm of what is left of each channel, ``after``: by the other reading.
        changed: ``(n,)`` channels that the other reading changes.
    """
    good = after < 0.5 * np.log(THRESHOLD.explained)
    return bool(good[(before - after > THRESHOLD.gains) | changed].all() and good.any())


# Contact wrenches under another name: turned signs, exchanged feet and axes, another unit.

# Units of force in newtons, and of moments per force in metres, that loggers write.
_FORCES = {unit: size_of(unit) for unit in ("kgf", "kN", "lbf")}
_LEVERS = {unit: size_of(unit) for unit in ("m", "mm", "cm")}


# Signs of forces and moments and of one column, and orders and signs of three axes but for the one as it is and that
# with all turned.
_SIGNS = {
    what: np.diag(np.repeat(signs, 3))
    for what, signs in (("wrench", (-1.0, -1.0)), ("force", (-1.0, 1.0)), ("moment", (1.0, -1.0)))
} | {what: np.diag(1.0 - 2.0 * row) for what, row in zip(WRENCH_AXES, np.eye(6), strict=True)}
_AXES = {
    ", ".join(("-" if s < 0.0 else "") + "xyz"[k] for k, s in zip(order, signs, strict=True)): np.kron(
        np.eye(2), np.eye(3)[list(order)] * np.array(signs)[:, None]
    )
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3))
    if order != (0, 1, 2) or len(set(signs)) > 1
}


def find_wrench_maps(
    samples: WrenchSamples, reading: Reading, *, maps: Mapping[str, Array], text: str
) -> Iterable[Correction]:
    """Wrenches of all sensors, or of each one, under other signs or axes.

    Feet push up: a sensor that reads a pull has its sign turned, or says what the robot does to the ground. Axes stand
    under other names, with or without a sign: columns in another order, or a frame turned by quarters.
    """
    n, names = len(samples.sensors), samples.sensors
    for sensors in (*([tuple(range(n))] if n > 1 else []), *((s,) for s in range(n))):
        some = tuple(names[s] for s in sensors)
        for said, matrix in maps.items():
            other = reading.with_wrenches(sensors, matrix)
            yield Correction(other, text.format(said, " and ".join(some)), some)


def find_wrench_order(samples: WrenchSamples, reading: Reading) -> Iterable[Correction]:
    """Two sensors' columns exchanged: the other foot's."""
    for i, j in combinations(range(len(samples.sensors)), 2):
        order = exchange_places(np.arange(len(samples.sensors)), i, j)
        names = (samples.sensors[i], samples.sensors[j])
        text = f"wrenches of {names[0]} and {names[1]} are exchanged"
        other = replace(reading, sensor_of=reading.sensor_of[order], wrench_map=reading.wrench_map[order])
        yield Correction(other, text, names)


def find_wrench_unit(samples: WrenchSamples, reading: Reading) -> Iterable[Correction]:
    """Forces and moments in units other than newtons and metres: the whole weight is known to some tenths."""
    everywhere, sensors = tuple(range(len(samples.sensors))), samples.sensors
    factor = samples.weight_ratio(reading)

    def scaled(newtons: float, metres: float) -> Reading:
        return reading.with_wrenches(everywhere, np.diag(np.repeat([newtons, newtons * metres], 3)))

    if factor <= 0.0 or is_near_one(factor, THRESHOLD.scale_off):
        for lever, metres in _LEVERS.items():
            if metres != 1.0:
                text = f"moments of {' and '.join(sensors)} are probably in N·{lever}"
                yield Correction(scaled(1.0, metres), text, sensors, {"newton_metres": metres})
        return
    surprise = abs(float(np.log(factor)))
    near = {name: n for name, n in _FORCES.items() if abs(np.log(factor * n)) < THRESHOLD.near_unit}
    for (force, newtons), (lever, metres) in product(near.items(), _LEVERS.items()):
        other = scaled(newtons, metres)
        # The moments' unit is told by how the fit is; a price keeps the one that goes with the force.
        worse = float(samples.left(other)[3:].sum())
        text = f"wrenches carry {factor:.3g} times the robot's weight: they are probably in {force} and {force}·{lever}"
        figures = {"newtons": newtons, "newton_metres": newtons * metres}
        yield Correction(other, text, sensors, figures, surprise=surprise - 0.01 * worse)
    if not near:
        yield Correction(
            scaled(1.0 / factor, 1.0),
            f"wrenches carry {factor:.3g} times the robot's weight: another unit, or another robot",
            sensors,
            {"factor": factor},
            surprise=surprise,
            ask=THE_UNIT,
            as_logged=lambda read: read.with_wrenches(everywhere, factor * np.eye(6)),
            certain=False,
        )


def find_zeroed_wrenches(samples: WrenchSamples, reading: Reading) -> Iterable[Correction]:
    """Contact wrenches that were zeroed while the robot stood on the sensors: what they carried then is off them.

    Constants bring the nominal weight back; how sensors share it is told as far as their levers change.
    """
    ratio = samples.weight_ratio(reading)
    # Nearer to no weight than to all of it.
    if reading.wrench_added.any() or abs(ratio) > 0.5:
        return
    added = samples.best_constants(reading)
    weight = float(np.linalg.norm(added[:, :3].sum(axis=0)))
    text = (
        f"wrenches carry {ratio:.2g} times the robot's weight, and all of it with constants of "
        f"{weight:.0f} N in sum: they were zeroed under load"
    )
    yield Correction(
        replace(reading, wrench_added=reading.wrench_added + added),
        text,
        samples.sensors,
        {"weight_ratio": ratio, "added_n": weight},
        certain=False,
        mends="the nominal weight was added to them; zero sensors that carry nothing",
    )


# All mistakes in how channels are called, by the equations that betray them.

_UNITS_AND_SIGNS = (
    Mistake("degrees", partial(find_unit, unit=np.pi / 180.0, name="degrees"), of_posture=True),
    Mistake("revolutions", partial(find_unit, unit=2.0 * np.pi, name="revolutions"), of_posture=True),
    Mistake("position_sign", find_position_sign, of_posture=True),
)
DELAY = Mistake("torque_late", find_delay, leaves=frozenset({Doubt.DELAY}))
_GRAVITY = Mistake("gravity", find_gravity, leaves=frozenset({Doubt.GRAVITY}))
_ZERO = Mistake("zero_position", find_zeros, leaves=frozenset({Doubt.POSITION}), of_posture=True)

OF_TORQUES: tuple[Mistake, ...] = (
    Mistake("torque_sign", find_torque_sign),
    Mistake("torque_order", find_torque_order),
    TORQUE_SCALE,
    *_UNITS_AND_SIGNS,
    Mistake("direction", find_turned_joints, of_posture=True),
    Mistake("order", find_order, of_posture=True),
    Mistake("revolutions", find_revolutions, of_posture=True),
    Mistake("differential", find_differential, of_posture=True),
    _ZERO,
    _GRAVITY,
    Mistake("compensated", find_missing_weight, may_surprise=True),
    Mistake("clock", find_clock, leaves=frozenset({Doubt.CLOCK})),
    DELAY,
)

OF_WRENCHES: tuple[Mistake, ...] = (
    Mistake(
        "wrench_sign",
        partial(
            find_wrench_maps,
            maps=_SIGNS,
            text="the {} of {} has the opposite sign, as of what the ground feels",
        ),
    ),
    Mistake("wrench_order", find_wrench_order),
    Mistake(
        "wrench_axes",
        partial(find_wrench_maps, maps=_AXES, text="axes of {1} are exchanged: x, y, z are columns {0}"),
    ),
    Mistake("wrench_unit", find_wrench_unit, leaves=frozenset({Doubt.SIZE}), may_surprise=True),
    Mistake("zeroed_wrenches", find_zeroed_wrenches, leaves=frozenset({Doubt.SIZE})),
    Mistake("base_pose", find_base_frame, of_posture=True),
    *_UNITS_AND_SIGNS,
    Mistake("order", find_exchanged_positions, of_posture=True),
    # One alone shows in how a robot stands.
    replace(_ZERO, corrections=partial(find_zeros, together=0)),
    _GRAVITY,
    DELAY,
)
