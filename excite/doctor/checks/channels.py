"""Channels that are not what the log calls them, as the nominal model tells."""

from __future__ import annotations

import numpy as np

from excite.doctor.check import Check, Outcome
from excite.doctor.misreadings import LEAST_GAIN, Misreading, misreadings
from excite.doctor.mistakes.registry import OF_TORQUES
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import torque_samples
from excite.finding import Finding
from excite.logs.log import Log
from excite.robot.robot import Robot


class Channels(Check):
    """Signs, order, units, zeros, clock, delay and gravity by which the model explains the torques far better."""

    kinds = tuple(mistake.name for mistake in OF_TORQUES)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        if log.header.free_base or log.header.torque in {None, "none"}:
            return Outcome(log)
        samples = torque_samples(robot, log)
        if samples is None:
            return Outcome(log)
        reading, found = misreadings(samples, Reading.as_stated(log), OF_TORQUES)
        if not found:
            return Outcome(log)
        imitated = tuple(
            name for item in found if not item.correction.certain for name in item.mistake.imitates
        )
        mended = any(item.correction.surprise is None for item in found)
        log = _without_scale(reading, found).of(log) if mended else log
        return Outcome(log, tuple(_finding(item) for item in found), imitated)


def _without_scale(reading: Reading, found: tuple[Misreading, ...]) -> Reading:
    """The reading with torques in the unit in which they were logged: which one it is a person knows."""
    for item in found:
        if item.correction.surprise is not None:
            factor = item.correction.figures["factor"]
            reading = reading.with_torque(range(len(reading.torque_factor)), factor)
    return reading


def _finding(item: Misreading) -> Finding:
    correction = item.correction
    before, after = (min(100.0, 100.0 * share) for share in (item.before, item.after))
    text = f"{correction.text} (likely bodies leave {before:.2g} % of the torques' power as it is, {after:.2g} % then)"
    repaired = correction.surprise is None
    if not repaired:
        remedy = "find the unit; what follows is in the log's"
    elif correction.certain:
        remedy = "it was put right for what follows; correct the log"
    else:
        remedy = "it was put right as far as the torques tell; correct the log"
    gain = correction.surprise if correction.surprise is not None else item.gain / correction.changes
    return Finding(
        correction.kind,
        text,
        {**correction.figures, "left_before": item.before, "left_after": item.after},
        correction.places,
        severity="spoils",
        sure=float(1.0 - 0.5 * np.exp(-(gain - LEAST_GAIN) / LEAST_GAIN)) if gain > LEAST_GAIN else 0.5,
        repaired=repaired,
        remedy=remedy,
    )
