"""What sensors do to values: ranges that are reached, coarse steps, channels that never change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.doctor.check import Check, Outcome
from excite.doctor.torque_rails import at_rails, kind_of_torque
from excite.finding import Finding, list_names
from excite.logs.log import Log
from excite.robot.robot import Robot
from excite.robot.sliding import is_prismatic

# Ends of one range agree by this share of what a joint moves in all trials: sensors that are clipped read one number,
# turns of different motions differ by tenths.
_SAME_END = 0.002


class Range(Check):
    """Values that stay at the largest or smallest that the channel has."""

    kinds = ("clipped",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        rows: dict[str, int] = {}
        for trial in log.trials:
            for name, count in trial.cleaning.clipped.items():
                rows[name] = rows.get(name, 0) + count
        torque = kind_of_torque(log) + "."
        marked = at_rails(log)
        # Of torques the motion says more, once their columns and units are right (TorqueRange).
        rows = {
            name: count
            for name, count in rows.items()
            if not (name.startswith(torque) and marked is not log) and not _sticks(log, name)
        }
        if not rows:
            return Outcome(marked)
        said = list_names([f"{name} in {count} rows" for name, count in rows.items()])
        finding = Finding(
            "clipped",
            f"{said}: clipped at the sensor's range or the drive's limit",
            {"rows": float(sum(rows.values()))},
            tuple(rows),
            severity="limits",
            remedy="move slower or carry less, or raise the range; what lies beyond is lost",
            trials=tuple(trial.name for trial in log.trials if set(rows) & set(trial.cleaning.clipped)),
        )
        return Outcome(marked, (finding,))


def _sticks(log: Log, name: str) -> bool:
    """Whether a position stays where dry friction held its joint as it turned back, in each trial elsewhere.

    The end of a sensor's range, or a stop, is at one place in all trials. An arm with 1.3 N·m of dry friction at an
    elbow and encoders of 14 bits stood still at its turns, left them at speed, and was said to be clipped.
    """
    channel, _, joint = name.partition(".")
    if channel != "q" or joint not in log.header.joints or len(log.trials) < 2:
        return False
    place = log.header.joints.index(joint)
    values = [trial.q[:, place] for trial in log.trials]
    top, bottom = max(q.max() for q in values), min(q.min() for q in values)
    near = _SAME_END * (top - bottom)
    ends = []
    for trial, q in zip(log.trials, values, strict=True):
        if name in trial.cleaning.clipped:
            step = 0.5 * trial.cleaning.quantised.get(name, 0.0)
            above = np.sum(q >= q.max() - step) >= np.sum(q <= q.min() + step)
            ends.append((above, (top - q.max() if above else q.min() - bottom) <= near))
    return max(ends.count((True, True)), ends.count((False, True))) < 2


def _unit(robot: Robot, log: Log, channel: str) -> str:
    """Unit of a channel of a joint with a blank before it; nothing of others, whose units differ from part to part."""
    kind, _, joint = channel.partition(".")
    turns = joint in robot.joint_names and not is_prismatic(
        robot.model, robot.n_base_v + robot.joint_index(joint)
    )
    units = {"q": "rad", "q_cmd": "rad", "v": "rad/s", "tau": "N·m", "i": "A"}
    return f" {units[kind]}" if turns and kind in units else ""


class Steps(Check):
    """Values on a grid that is coarser than the noise."""

    kinds = ("quantised",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        sizes: dict[str, float] = {}
        for trial in log.trials:
            sizes |= trial.cleaning.quantised
        if not sizes:
            return Outcome(log)
        said = list_names([f"{name} {size:.3g}{_unit(robot, log, name)}" for name, size in sizes.items()])
        finding = Finding(
            "quantised",
            f"values come in steps: {said}; a coarse sensor, or few digits in the file",
            {f"step_{name}": size for name, size in sizes.items()},
            tuple(sizes),
            severity="note",
            remedy="write all digits, or filter more; velocities of slow motion are not to be had from coarse steps",
            trials=tuple(trial.name for trial in log.trials if trial.cleaning.quantised),
        )
        return Outcome(log, (finding,))


class Constant(Check):
    """Channels that never change over the whole log; a torque that does not is declared to mean nothing."""

    kinds = ("constant", "no_torques")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        header = log.header
        if unforced(log):
            lost = Finding(
                "no_torques",
                "no torque, no current and no command was recorded: nothing tells what moved the joints",
                {"channels": 0.0},
                severity="fatal",
                remedy="record torques or currents (tau.*, i.*), or at least the commanded positions (q_cmd.*)",
            )
            return Outcome(log, (lost,))
        dead, torques = [], []
        for attribute, prefix in (("tau", "tau"), ("current", "i"), ("q", "q")):
            values = [getattr(trial, attribute) for trial in log.trials]
            if any(value is None for value in values):
                continue
            still = np.all([np.ptp(value, axis=0) == 0.0 for value in values], axis=0)
            for name, flag in zip(header.joints, still, strict=True):
                if flag and not (name in header.no_torque and prefix != "q"):
                    dead.append(f"{prefix}.{name}")
                    torques += [name] if prefix != "q" else []
        for sensor in header.sensors:
            readings = [trial.wrenches[sensor.name] for trial in log.trials if sensor.name in trial.wrenches]
            if readings and all(np.ptp(reading) == 0.0 for reading in readings):
                dead.append(f"wrench.{sensor.name}")
        if not dead:
            return Outcome(log)
        return self._said(log, tuple(dead), tuple(torques))

    def _said(self, log: Log, dead: tuple[str, ...], torques: tuple[str, ...]) -> Outcome:
        text = f"{list_names(dead)} never change: a dead channel, or a joint that was locked; its parameters say nothing"
        figures = {"channels": float(len(dead))}
        silent = tuple(dict.fromkeys((*log.header.no_torque, *torques)))
        if torques and len(silent) == len(log.header.joints):
            lost = Finding(
                "no_torques",
                f"no torque changes at all ({list_names(dead)})",
                figures,
                dead,
                severity="fatal",
                remedy="record the torques or currents, or state torque: none",
            )
            return Outcome(log, (lost,))
        finding = Finding(
            "constant",
            text,
            figures,
            dead,
            severity="spoils" if torques or dead[0].startswith("wrench") else "limits",
            repaired=bool(torques) and len(torques) == len(dead),
            remedy="joints whose torque never changes are taken as no_torque"
            if torques
            else "check the channel",
        )
        header = log.header.model_copy(update={"no_torque": silent})
        return Outcome(replace(log, header=header) if torques else log, (finding,))


def unforced(log: Log) -> bool:
    """Whether a log of a robot that does not move about says nothing of what moved it: positions alone."""
    header = log.header
    placed = header.base in ("fixed", "held") and not header.sensors
    return placed and all(t.tau is None and t.current is None and t.q_cmd is None for t in log.trials)
