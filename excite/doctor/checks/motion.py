"""Whether what was recorded is motion that says something: standing, seams, steps, joints in unison, too little."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.doctor.check import Check, Outcome
from excite.finding import Finding, list_names
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.logs.signals.seams import without_seams
from excite.robot.robot import Robot
from excite.robot.sliding import is_prismatic

# Speeds below this are standing [rad/s or m/s], as for the rows of an identification.
_STILL = 0.01
# A joint that takes no more positions than this trembles within its encoder's steps, as fast as these are coarse: an
# arm that stood for ten seconds took five (steps of 0.8 mrad), at 12 mrad/s.
_TREMBLING = 10
_SHORTEST_S = 5.0
_FEWEST_PER_PARAMETER = 2.0
# Joints whose velocities are so alike move as one.
_UNISON = 0.999
# A row in which a joint goes five times further than in those beside it, and further than steps of encoders [rad or m],
# is a leap; a joint that makes half its way in leaps does not move but is set.
_LEAP, _LEAP_RAD, _JUMPS = 5.0, 0.05, 0.5


class Standing(Check):
    """Trials in which nothing moves: they show gravity, not inertia."""

    kinds = ("standing", "nothing_moves")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        still = tuple(trial.name for trial in log.trials if not _moves(trial))
        if not still:
            return Outcome(log)
        chosen = [trial.name for trial in log.trials if trial.role == "identification"]
        if all(name in still for name in chosen):
            lost = Finding(
                "nothing_moves",
                "no joint ever moves in the trials to learn from",
                {},
                ("q",),
                severity="fatal",
                remedy="record motions; check that positions are in radians and the right columns",
                trials=still,
            )
            return Outcome(log, (lost,))
        text = f"nothing moves in {list_names(still)}: standing trials show gravity alone"
        finding = Finding(
            "standing",
            text,
            {"trials": float(len(still))},
            severity="note",
            trials=still,
            remedy="they are used for weights, not for inertias",
        )
        return Outcome(log, (finding,))


class WholeTurns(Check):
    """Positions that jump by whole turns: an encoder that passed the end of its count, or was read anew."""

    kinds = ("whole_turns",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        turning = [
            (j, name)
            for j, name in enumerate(log.header.joints)
            if not is_prismatic(robot.model, robot.n_base_v + robot.joint_index(name))
        ]
        joints: dict[str, None] = {}
        trials = []
        for trial in log.trials:
            found = {
                (c, j): w
                for c in ("q", "q_cmd")
                for j, _ in turning
                if (w := _whole(trial, c, j)) is not None
            }
            joints |= {log.header.joints[j]: None for _, j in found}
            trials.append(_going_on(trial, found))
        if not joints:
            return Outcome(log)
        finding = Finding(
            "whole_turns",
            f"positions of {list_names([*joints])} jump by whole turns: counters that pass their end, or angles kept "
            "within a turn",
            {"joints": float(len(joints))},
            tuple(joints),
            severity="spoils",
            repaired=True,
            remedy="they go on in what follows; log angles that go on",
        )
        return Outcome(replace(log, trials=tuple(trials)), (finding,))


def _whole(trial: Trial, channel: str, joint: int) -> Array | None:
    """A joint's positions in radians, degrees or revolutions without their jumps by whole turns; None for none."""
    values = getattr(trial, channel)
    if values is None:
        return None
    found = (without_seams(values[:, joint], turn, within=turn == 1.0) for turn in (2.0 * np.pi, 360.0, 1.0))
    return next((whole for whole in found if whole is not None), None)


def _going_on(trial: Trial, found: dict[tuple[str, int], Array]) -> Trial:
    """The trial with some columns replaced, and commands on the turn that their joint is on."""
    if not found:
        return trial
    q, command = trial.q.copy(), None if trial.q_cmd is None else trial.q_cmd.copy()
    for (channel, j), whole in found.items():
        (q if channel == "q" or command is None else command)[:, j] = whole
    if command is not None:
        for j in {j for _, j in found}:
            command[:, j] += 2.0 * np.pi * np.round(np.median(q[:, j] - command[:, j]) / (2.0 * np.pi))
    return replace(trial, q=q, q_cmd=command)


class Jumps(Check):
    """Positions that leap and stand: set points, or a log of steps, from which no acceleration is to be had."""

    kinds = ("steps",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        way, leapt = np.zeros(len(log.header.joints)), np.zeros(len(log.header.joints))
        for trial in log.trials:
            change = np.abs(np.diff(trial.q, axis=0))
            beside = np.maximum(change[:-2], change[2:])
            leaps = (change[1:-1] > _LEAP * beside) & (change[1:-1] > _LEAP_RAD)
            way += change.sum(axis=0)
            leapt += (change[1:-1] * leaps).sum(axis=0)
        share = leapt / np.maximum(way, 1e-12)
        bad = share > _JUMPS
        if not bad.any():
            return Outcome(log)
        names = tuple(np.array(log.header.joints)[bad])
        text = (
            f"positions of {list_names(names)} leap from row to row and stand between ({100 * float(share.max()):.0f} % of "
            "their way): steps instead of motion"
        )
        finding = Finding(
            "steps",
            text,
            {"share": float(share.max())},
            names,
            severity="spoils",
            remedy="log what encoders measure, not set points, at a rate that follows the motion",
        )
        return Outcome(log, (finding,))


class Unison(Check):
    """Joints that only ever moved together: what tells them apart is not in the log."""

    kinds = ("unison",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        speeds = [v for trial in log.trials if (v := _velocity(trial)) is not None]
        if not speeds:
            return Outcome(log)
        v = np.concatenate(speeds)
        size = np.sqrt((v**2).mean(axis=0))
        moving = np.flatnonzero(size > _STILL)
        if len(moving) < 2:
            return Outcome(log)
        alike = np.abs((v[:, moving].T @ v[:, moving]) / len(v) / np.outer(size[moving], size[moving]))
        pairs = [
            (int(moving[i]), int(moving[j]))
            for i, j in zip(*np.nonzero(np.triu(alike > _UNISON, 1)), strict=True)
        ]
        if not pairs:
            return Outcome(log)
        joints = tuple(log.header.joints[k] for k in sorted({k for pair in pairs for k in pair}))
        unknown = tuple(f"{name}({_link(robot, joint)})" for joint in joints for name in ("m·c", "I"))
        text = (
            f"{list_names(joints)} move in unison: this log cannot tell their parameters apart, {list_names(unknown, 6)} "
            "only in sums"
        )
        finding = Finding(
            "unison",
            text,
            {"pairs": float(len(pairs))},
            joints,
            severity="limits",
            remedy="record motions in which each joint moves by itself, too",
        )
        return Outcome(log, (finding,))


class Amount(Check):
    """Too few rows for the parameters."""

    kinds = ("too_few_rows",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        chosen = [trial for trial in log.trials if trial.role == "identification"]
        if not chosen:
            return Outcome(log)
        seconds = sum(float(trial.time[-1] - trial.time[0]) for trial in chosen)
        channels = 6 if robot.floating else chosen[0].q.shape[1]
        numbers = channels * sum(trial.n_samples for trial in chosen)
        parameters = 10 * len(robot.segments)
        if seconds >= _SHORTEST_S and numbers >= _FEWEST_PER_PARAMETER * parameters:
            return Outcome(log)
        text = f"{seconds:.1f} s and {numbers} numbers for {parameters} parameters: too few rows"
        finding = Finding(
            "too_few_rows",
            text,
            {"seconds": seconds, "numbers": float(numbers)},
            severity="limits",
            remedy="record longer motions",
        )
        return Outcome(log, (finding,))


def _link(robot: Robot, joint: str) -> str:
    place = robot.model.getJointId(joint)
    return next((segment.link for segment in robot.segments if segment.joint == place), joint)


def _velocity(trial: Trial) -> Array | None:
    """Velocities without the encoders' noise, ``(n, n_joints)``; None for a trial too short to filter."""
    rate = 1.0 / float(np.median(np.diff(trial.time)))
    cutoff = min(5.0, 0.2 * rate)
    if trial.n_samples <= 2 * settling_samples(rate, cutoff):
        return None
    return np.gradient(lowpass(trial.q, rate, cutoff), trial.time, axis=0)


def _moves(trial: Trial) -> bool:
    v = _velocity(trial)
    size = np.ptp(trial.q, axis=0) if v is None else np.abs(v).max(axis=0)
    return any(len(np.unique(trial.q[:, j])) > _TREMBLING for j in np.flatnonzero(size > _STILL))
