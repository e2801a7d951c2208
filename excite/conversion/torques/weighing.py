"""Questions about a recording that its torques answer, or what they make of those that stay."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.units import TO_SI
from excite.conversion.guesses import Question
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


def weighed(questions: Sequence[Question], tried: Callable[[Map], Conversion], stated: Map) -> list[Question]:
    """The questions; one for a torque per volt or duty cycle with what the nominal weights make of it."""
    (question,) = questions if len(questions) == 1 else (None,)
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
