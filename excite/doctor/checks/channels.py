"""Channels that are not what the log calls them, as the nominal model tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from excite.display import percent
from excite.doctor.channel_errors import OF_TORQUES, OF_WRENCHES, Misreading, misreadings
from excite.doctor.channel_mapping import Reading
from excite.doctor.check import Check, Outcome
from excite.doctor.checks.torques import of_unknown_unit
from excite.doctor.inertial_prior import STRONG_ODDS
from excite.doctor.mistakes.mistake import Mistake
from excite.doctor.mistakes.torques import OtherMachine, carried_load, other_machine
from excite.doctor.torque_samples import TorqueSamples, torque_samples
from excite.doctor.wrench_samples import wrench_samples
from excite.finding import Finding, list_names
from excite.logs.log import Log
from excite.robot.robot import Robot


class Channels(Check):
    """Signs, order, units, zeros, clock, delay, poses by which the model explains torques or wrenches far better."""

    kinds = (
        *dict.fromkeys(
            (*(mistake.name for mistake in OF_TORQUES), *(mistake.name for mistake in OF_WRENCHES))
        ),
        "other_model",
    )

    def examine(self, robot: Robot, log: Log) -> Outcome:
        reading, found, what, other = _read(robot, log)
        if not found:
            return Outcome(log)
        doubts = frozenset(
            doubt for item in found if not item.correction.certain for doubt in item.mistake.leaves
        )
        if other is not None:
            return Outcome(log, (_of_another_machine(found, what, other),), doubts)
        mended = not all(item.correction.ask for item in found)
        log = _as_logged(reading, found).of(log) if mended else log
        return Outcome(log, tuple(_finding(item, what) for item in found), doubts)


class _Read(NamedTuple):
    """The likeliest reading of a log, what was found on the way, and what was measured.

    ``other`` is another machine than the model's, where that says as much as all that was found.
    """

    reading: Reading
    found: tuple[Misreading, ...]
    what: str
    other: OtherMachine | None = None


def _read(robot: Robot, log: Log) -> _Read:
    stated = Reading.as_stated(log)
    if log.header.free_base:
        wrenches = wrench_samples(robot, log) if log.header.sensors else None
        if wrenches is not None:
            possible = [m for m in OF_WRENCHES if not m.of_posture or log.header.posture == "measured"]
            return _Read(*misreadings(wrenches, stated, possible), wrenches.measured_name)
    elif log.header.torque not in {None, "none"}:
        torques = torque_samples(robot, log)
        if torques is not None:
            possible_of_torques = [
                m for m in OF_TORQUES if not m.of_posture or log.header.posture == "measured"
            ]
            return _of_torques(torques, stated, possible_of_torques)
    return _Read(stated, (), "")


def _of_torques(samples: TorqueSamples, stated: Reading, possible: Sequence[Mistake[TorqueSamples]]) -> _Read:
    """What torques betray; beside a load where that explains them better than the first mistake would.

    A load of a robot's own weight is no likely body: torques of an arm that carried one were scaled, and without that
    its clock looked fast. Torques in a unit that nothing tells, too small for bodies anywhere near the nominal ones,
    betray nothing: gravity looked turned by 145 degrees in those before the gears of a KUKA KR 300.
    """
    if of_unknown_unit(samples, stated) is not None:
        return _Read(stated, (), samples.measured_name)
    used = samples
    reading, found = misreadings(samples, stated, possible)
    load = carried_load(samples, stated) if found else None
    if load is not None:
        loaded = replace(samples, carried=load.parameters)
        before = samples.judged(stated)
        if before.odds(loaded.judged(stated, before.counts)) > found[0].gain:
            used = loaded
            reading, found = misreadings(loaded, stated, possible)
    return _Read(reading, found, samples.measured_name, _other_machine(used, stated, reading, found))


def _other_machine(
    samples: TorqueSamples, stated: Reading, mended: Reading, found: tuple[Misreading, ...]
) -> OtherMachine | None:
    """Another machine that explains the log as it stands; None where the mistakes that were found explain more.

    One mistake is as likely as another model. Put into a Panda's log, mistakes of seven kinds explain 2.7 to 15 nat
    more than any bodies do; a UR10e's log with the model of a UR3 is explained by other bodies as well as by a unit of
    its own at every joint together with a clock that is too fast.
    """
    if len(found) < 2:
        return None
    clock = any(item.mistake.name == "clock" and item.correction.ask for item in found)
    other = other_machine(samples, stated, mended.tick if clock else stated.tick)
    then = samples.judged(mended, samples.judged(stated).counts)
    return other if float(then.counts @ (other.left - then.left)) - then.cost < STRONG_ODDS else None


def _as_logged(reading: Reading, found: tuple[Misreading, ...]) -> Reading:
    """The reading without what a person has to say first."""
    for item in found:
        if item.correction.ask:
            reading = item.correction.as_logged(reading)
    return reading


def _of_another_machine(found: tuple[Misreading, ...], what: str, other: OtherMachine) -> Finding:
    """One model that is another machine's instead of several mistakes."""
    kinds = dict.fromkeys(item.mistake.name.replace("_", " ") for item in found)
    before, after = percent(min(100.0, 100.0 * found[0].before)), percent(100.0 * other.share)
    size = "" if other.length == 1.0 else f", about {other.length:.2g} times as long"
    text = (
        f"the model looks like another machine's: with bodies anywhere near what it says {before} of the "
        f"{what}' power is left, with other bodies on its joints{size}, {after}, and it would take "
        f"{len(found)} mistakes in the log at once ({list_names(list(kinds))}) to explain as much"
    )
    return Finding(
        "other_model",
        text,
        {"left_before": found[0].before, "left_after": other.share, "length": other.length},
        tuple(dict.fromkeys(place for item in found for place in item.correction.places)),
        severity="spoils",
        sure=0.8,
        remedy="take the recorded robot's model, or say which of these mistakes the log has",
    )


def _finding(item: Misreading, what: str) -> Finding:
    correction = item.correction
    before, after = (percent(min(100.0, 100.0 * share)) for share in (item.before, item.after))
    text = f"{correction.text} (likely bodies leave {before} of the {what}' power as it is, {after} then)"
    if correction.ask:
        remedy = correction.ask
    elif correction.mends:
        remedy = correction.mends
    elif correction.certain:
        remedy = "it was put right for what follows; correct the log"
    else:
        remedy = f"it was put right as far as the {what} tell; correct the log"
    return Finding(
        item.mistake.name,
        text,
        {**correction.figures, "left_before": item.before, "left_after": item.after},
        correction.places,
        severity="spoils",
        sure=item.sure,
        repaired=not correction.ask,
        remedy=remedy,
    )
