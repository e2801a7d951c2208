"""Rules for what sensors do to values: ranges that are reached, coarse steps, channels that never change."""

from __future__ import annotations

from collections import Counter

import numpy as np

from excite.doctor.case import Case
from excite.doctor.checks.torques import kind_of_torque, mark_rails
from excite.doctor.thresholds import THRESHOLD
from excite.finding import list_names
from excite.logs.log import Log

_UNITS = {"q": " rad", "q_cmd": " rad", "v": " rad/s", "tau": " N·m", "i": " A"}


def find_range_ends(case: Case) -> None:
    """Values that stay at the largest or smallest that the channel has."""
    rows = sum((Counter(trial.cleaning.clipped) for trial in case.log.trials), Counter[str]())
    before = case.log
    case.log = mark_rails(before)
    # Of torques the motion says more, once their columns and units are right (find_torque_ends).
    torque = f"{kind_of_torque(before)}." if case.log is not before else "none"
    kept = {k: n for k, n in rows.items() if not k.startswith(torque) and not _sticks(before, k)}
    if kept:
        said = list_names([f"{name} in {count} rows" for name, count in kept.items()])
        text = f"{said}: clipped at the sensor's range or the drive's limit"
        trials = tuple(trial.name for trial in before.trials if set(kept) & set(trial.cleaning.clipped))
        case.add("clipped", text, {"rows": float(sum(kept.values()))}, tuple(kept), trials=trials)


def _sticks(log: Log, name: str) -> bool:
    """Whether a position stays where dry friction held its joint as it turned back, in each trial elsewhere.

    The end of a sensor's range, or a stop, is at one place in all trials.
    """
    channel, _, joint = name.partition(".")
    if channel != "q" or joint not in log.header.joints or len(log.trials) < 2:
        return False
    place = log.header.joints.index(joint)
    values = [trial.q[:, place] for trial in log.trials]
    top, bottom = max(q.max() for q in values), min(q.min() for q in values)
    ends = Counter[bool]()
    for trial, q in zip(log.trials, values, strict=True):
        if name in trial.cleaning.clipped:
            step = 0.5 * trial.cleaning.quantised.get(name, 0.0)
            above = bool(np.sum(q >= q.max() - step) >= np.sum(q <= q.min() + step))
            ends[above] += (top - q.max() if above else q.min() - bottom) <= THRESHOLD.same_end * (
                top - bottom
            )
    return max(ends.values(), default=0) < 2


def find_coarse_steps(case: Case) -> None:
    """Values on a grid that is coarser than the noise."""
    sizes = {name: size for trial in case.log.trials for name, size in trial.cleaning.quantised.items()}
    if not sizes:
        return
    turning = case.joints(case.turning)

    def unit(channel: str) -> str:
        """Units of joints that slide, and of wrenches, differ from part to part and are left out."""
        kind, _, joint = channel.partition(".")
        return _UNITS.get(kind, "") if joint in turning else ""

    said = list_names([f"{name} {size:.3g}{unit(name)}" for name, size in sizes.items()])
    text = f"values come in steps: {said}; a coarse sensor, or few digits in the file"
    trials = tuple(trial.name for trial in case.log.trials if trial.cleaning.quantised)
    case.add("quantised", text, {f"step_{k}": size for k, size in sizes.items()}, tuple(sizes), trials=trials)


def find_constants(case: Case) -> None:
    """Channels that never change over the whole log; a torque that does not is declared to mean nothing."""
    header, trials = case.log.header, case.log.trials
    if _is_unforced(case.log):
        text = "no torque, no current and no command was recorded: nothing shows what moved the joints"
        case.add("no_torques", text, {"channels": 0.0})
        return
    dead: dict[str, str] = {}
    for attribute, prefix in (("tau", "tau"), ("current", "i"), ("q", "q")):
        values = [getattr(trial, attribute) for trial in trials]
        if all(value is not None for value in values):
            still = np.all([np.ptp(value, axis=0) == 0.0 for value in values], axis=0)
            ignored = () if prefix == "q" else header.no_torque
            dead |= {f"{prefix}.{joint}": joint for joint in case.joints(still) if joint not in ignored}
    for sensor in header.sensors:
        readings = [trial.wrenches[sensor.name] for trial in trials if sensor.name in trial.wrenches]
        if readings and all(np.ptp(reading) == 0.0 for reading in readings):
            dead[f"wrench.{sensor.name}"] = ""
    if not dead:
        return
    torques = [joint for name, joint in dead.items() if name.startswith(("tau.", "i."))]
    figures, places = {"channels": float(len(dead))}, tuple(dead)
    if torques and {*header.no_torque, *torques} == set(header.joints):
        text = f"no torque changes at all ({list_names(places)})"
        remedy = "record the torques or currents, or state torque: none"
        case.add("no_torques", text, figures, places, remedy=remedy)
        return
    text = (
        f"{list_names(places)} never change: a dead channel, or a locked joint, whose parameters "
        "are not identifiable"
    )
    more: dict[str, object] = {"severity": "spoils"} if torques or places[0].startswith("wrench") else {}
    if torques:
        remedy = "joints whose torque never changes are treated as no_torque"
        more |= {"repaired": len(torques) == len(dead), "remedy": remedy}
        case.ignore_torques(torques)
    case.add("constant", text, figures, places, **more)


def _is_unforced(log: Log) -> bool:
    """Whether a log of a robot that does not move about says nothing of what moved it: positions alone."""
    placed = log.header.base in ("fixed", "held") and not log.header.sensors
    return placed and all(t.tau is None and t.current is None and t.q_cmd is None for t in log.trials)
