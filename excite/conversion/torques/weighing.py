"""Questions about a recording that its torques answer, or what they make of those that stay."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.clock import FASTEST_HZ, SLOWEST_HZ
from excite.conversion.columns.units import TO_SI
from excite.conversion.guesses import RATE_LINE, Question
from excite.conversion.mapping import Map
from excite.conversion.result import Conversion
from excite.conversion.torques.scales import torque_scales
from excite.doctor.misreadings import LEAST_GAIN, explained
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import torque_samples
from excite.errors import InputError
from excite.logs.log import Log
from excite.logs.robot import nominal_robot


@dataclass(frozen=True)
class Settled:
    """An answer that torques gave.

    Attributes:
        mapping: what a person said, and the answer.
        because: what speaks for it.
    """

    mapping: Map
    because: str


def settled_by_torques(
    questions: Sequence[Question], tried: Callable[[Map], Conversion], stated: Map
) -> Settled | None:
    """The answer to the one question that there is, of positions' units, where torques give one.

    Likely bodies explain torques by the postures that a robot took: by those of degrees 57 times closer together than
    by those of radians. The best unit has to explain them better than the second by what any misreading has to bring.

    Args:
        questions: what a recording leaves open.
        tried: what converts the recording by another map, whatever its torques' scale.
        stated: what a person said.
    """
    (question,) = questions if len(questions) == 1 else (None,)
    if question is None or len(question.units) < 2:
        return None
    first, *rest = question.units
    try:
        log = tried(stated.model_copy(update={"units": {**stated.units, **first}})).log
        left = _left(log, [first, *rest])
    except InputError:
        return None
    if left is None:
        return None
    best, second = np.argsort(left.sum(axis=1))[:2]
    gain = float((left[second] - left[best]).sum())
    none = np.zeros(left.shape[1] - 1, dtype=bool)
    if gain < LEAST_GAIN or not explained(left[second, :-1], left[best, :-1], none):
        return None
    units = question.units[int(best)]
    said = " and ".join(dict.fromkeys(units.values()))
    because = f"{said}: so likely bodies explain the torques (by {gain:.1f} nat better than in another unit)"
    return Settled(stated.model_copy(update={"units": {**stated.units, **units}}), because)


def _left(log: Log, units: Sequence[Mapping[str, str]]) -> Array | None:
    """What likely bodies leave of each torque, and cost, with positions in each of the units [nat].

    ``(n_units, n_torques + 1)``. The first of the units is the log's.
    """
    if log.header.free_base or log.header.torque in {None, "none"}:
        return None
    samples = torque_samples(nominal_robot(log), log)
    if samples is None:
        return None
    reading = Reading.as_stated(log)

    def factors(by_channel: Mapping[str, str]) -> Array:
        names = [by_channel.get(f"q.{joint}", by_channel.get("q", "rad")) for joint in log.header.joints]
        return np.array([TO_SI[name] for name in names])

    as_first = factors(units[0])
    slides = np.array([samples.slides(joint) for joint in range(len(samples.joints))])
    readings = [
        replace(reading, unit=np.where(slides, 1.0, factors(by_channel) / as_first)) for by_channel in units
    ]
    return np.array([samples.judged(read) for read in readings])


def _with_rate(question: Question, tried: Callable[[Map], Conversion], stated: Map) -> Question:
    """The question for the rate of the rows, with the one at which inertial forces explain the torques.

    Weight does not depend on the rate, inertial forces do, with its square. Torques of either sign are tried: a turned
    one looks like no rate at all. The rate is proposed where it has an end on both sides within what any misreading has
    to bring, and where the model then explains half of the torques' power.
    """
    rates = np.geomspace(SLOWEST_HZ, FASTEST_HZ, 200)
    rate, low, high, turned = float(np.median(rates)), 0.0, 0.0, False
    for _ in range(2):
        try:
            log = tried(stated.model_copy(update={"log": {**stated.log, "rate_hz": rate}})).log
            samples = torque_samples(nominal_robot(log), log)
        except InputError:
            return question
        if samples is None or log.header.torque in (None, "none"):
            return question
        left = []
        for sign in (1.0, -1.0):
            as_stated = Reading.as_stated(log)
            by_clock = samples.by_clock(replace(as_stated, torque_factor=sign * as_stated.torque_factor))
            left.append([float(np.mean(by_clock(rate / one))) for one in rates])
        which, at = np.unravel_index(int(np.argmin(left)), np.shape(left))
        count = len(samples.measured)
        near = np.flatnonzero(np.array(left[which]) * count < left[which][at] * count + LEAST_GAIN)
        if near[0] == 0 or near[-1] == len(rates) - 1 or np.exp(2.0 * left[which][at]) > 0.5:
            return question
        rate, low, high, turned = float(rates[at]), float(rates[near[0]]), float(rates[near[-1]]), bool(which)
    signs = ", with the sign of the torques turned" if turned else ""
    span = f"{_two_digits(low):g} to {_two_digits(high):g}"
    why = f", as the nominal inertias say ({span} explain the torques about as well{signs})"
    return question.with_rate(_two_digits(rate), why)


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def weighed(questions: Sequence[Question], tried: Callable[[Map], Conversion], stated: Map) -> list[Question]:
    """The questions; one alone with what the nominal model makes of it: a torque per volt or duty cycle, or a rate."""
    (question,) = questions if len(questions) == 1 else (None,)
    if question is not None and question.line == RATE_LINE:
        return [_with_rate(question, tried, stated)]
    if question is None or not question.torques:
        return list(questions)
    try:
        found = tried(stated.model_copy(update={"columns": {**stated.columns, **question.torques}}))
        scales = torque_scales(nominal_robot(found.log), found.log)
    except InputError:
        scales = {}
    if not scales:
        return list(questions)
    small = any(
        target in question.torques and factor == 1e-3 for target, (_, factor) in found.columns.items()
    )
    units, unit = ("units: {tau: N·mm} and ", "N·mm") if small else ("", "N·m")
    worth = {f"tau.{joint}": f"{1.0 / scale.gain:.3g}" for joint, scale in scales.items()}
    factors = ", ".join(f"{target}: {worth.get(target, 'FACTOR')}" for target in question.torques)
    least = 100.0 * min(scale.share for scale in scales.values())
    columns = ", ".join(f'{target}: "{column}"' for target, column in question.torques.items())
    line = (
        f"columns: {{{columns}}} and {units}scale: {{{factors}}}   # {unit} per unit by the nominal "
        f"masses, whose weight and inertia are {least:.0f} % of it; or log: {{torque: none}}"
    )
    return [replace(question, line=line)]
