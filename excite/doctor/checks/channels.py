"""Channels that are not what the log calls them, as the nominal model tells."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from excite.doctor.check import Check, Outcome
from excite.doctor.misreadings import LEAST_GAIN, Misreading, misreadings
from excite.doctor.mistakes.carried_load import carried_load
from excite.doctor.mistakes.registry import OF_TORQUES, OF_WRENCHES
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples, torque_samples
from excite.doctor.unknown_unit import of_unknown_unit
from excite.doctor.wrench_samples import wrench_samples
from excite.finding import Finding
from excite.logs.log import Log
from excite.robot.robot import Robot


class Channels(Check):
    """Signs, order, units, zeros, clock, delay, poses by which the model explains torques or wrenches far better."""

    kinds = tuple(
        dict.fromkeys((*(mistake.name for mistake in OF_TORQUES), *(mistake.name for mistake in OF_WRENCHES)))
    )

    def examine(self, robot: Robot, log: Log) -> Outcome:
        reading, found, what = _read(robot, log)
        if not found:
            return Outcome(log)
        doubts = frozenset(
            doubt for item in found if not item.correction.certain for doubt in item.mistake.leaves
        )
        mended = not all(item.correction.ask for item in found)
        log = _as_logged(reading, found).of(log) if mended else log
        return Outcome(log, tuple(_finding(item, what) for item in found), doubts)


class _Read(NamedTuple):
    """The likeliest reading of a log, what was found on the way, and what was measured."""

    reading: Reading
    found: tuple[Misreading, ...]
    what: str


def _read(robot: Robot, log: Log) -> _Read:
    stated = Reading.as_stated(log)
    if log.header.free_base:
        wrenches = wrench_samples(robot, log) if log.header.sensors else None
        if wrenches is not None:
            return _Read(*misreadings(wrenches, stated, OF_WRENCHES), wrenches.measured_name)
    elif log.header.torque not in {None, "none"}:
        torques = torque_samples(robot, log)
        if torques is not None:
            return _Read(*_of_torques(torques, stated), torques.measured_name)
    return _Read(stated, (), "")


def _of_torques(samples: TorqueSamples, stated: Reading) -> tuple[Reading, tuple[Misreading, ...]]:
    """What torques betray; beside a load where that explains them better than the first mistake would.

    A load of a robot's own weight is no likely body: torques of an arm that carried one were scaled, and without that
    its clock looked fast. Torques in a unit that nothing tells, too small for bodies anywhere near the nominal ones,
    betray nothing: gravity looked turned by 145 degrees in those before the gears of a KUKA KR 300.
    """
    if of_unknown_unit(samples, stated):
        return stated, ()
    reading, found = misreadings(samples, stated, OF_TORQUES)
    load = carried_load(samples, stated) if found else None
    if load is None:
        return reading, found
    loaded = replace(samples, carried=load.parameters)
    if float((samples.judged(stated) - loaded.judged(stated)).sum()) <= found[0].gain:
        return reading, found
    return misreadings(loaded, stated, OF_TORQUES)


def _as_logged(reading: Reading, found: tuple[Misreading, ...]) -> Reading:
    """The reading without what a person has to say first."""
    for item in found:
        if item.correction.ask:
            reading = item.correction.as_logged(reading)
    return reading


def _finding(item: Misreading, what: str) -> Finding:
    correction = item.correction
    before, after = (min(100.0, 100.0 * share) for share in (item.before, item.after))
    text = f"{correction.text} (likely bodies leave {before:.2g} % of the {what}' power as it is, {after:.2g} % then)"
    if correction.ask:
        remedy = correction.ask
    elif correction.certain:
        remedy = "it was put right for what follows; correct the log"
    else:
        remedy = f"it was put right as far as the {what} tell; correct the log"
    gain = correction.surprise if correction.surprise is not None else item.gain / correction.changes
    return Finding(
        correction.kind,
        text,
        {**correction.figures, "left_before": item.before, "left_after": item.after},
        correction.places,
        severity="spoils",
        sure=float(1.0 - 0.5 * np.exp(-(gain - LEAST_GAIN) / LEAST_GAIN)) if gain > LEAST_GAIN else 0.5,
        repaired=not correction.ask,
        remedy=remedy,
    )
