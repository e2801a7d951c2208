"""Whether what was recorded is motion that says something: standing, seams, steps, joints in unison, too little."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, assign_rows
from excite.doctor.channel_mapping import Reading
from excite.doctor.check import Check, Outcome
from excite.doctor.checks.clock import velocity_ratios
from excite.doctor.inertial_prior import STRONG_ODDS
from excite.doctor.torque_samples import torque_samples
from excite.finding import Finding, list_names
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.logs.signals.resample import without_seams
from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot

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
            f"positions of {list_names(names)} leap from row to row and stand between "
            f"({100 * float(share.max()):.0f} % of "
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
            f"{list_names(joints)} move in unison: this log cannot tell their parameters apart, "
            f"{list_names(unknown, 6)} "
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


# Measured channels beside what was commanded: another joint's, turned, in another unit.

_COMMANDS_DEGREE = 180.0 / np.pi
# A channel tracks a command when what is left is this share of the command's own deviation.
_TRACKS = 0.5
# Factor by which another assignment of channels has to be better.
_BETTER = 3.0
_MEASURED = {"q": "positions", "tau": "torques"}


class Commands(Check):
    """Order, sign and unit of measured positions and torques against their commands; which side is wrong is open."""

    kinds = ("command_order", "command_sign", "command_degrees")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        found = [*_order(log, "q_cmd", "commanded positions"), *_order(log, "tau_cmd", "commanded torques")]
        return Outcome(log, tuple(found))


def _order(log: Log, attribute: str, what: str) -> list[Finding]:
    measured = "q" if attribute == "q_cmd" else "tau"
    pairs = [
        (getattr(trial, measured), getattr(trial, attribute))
        for trial in log.trials
        if getattr(trial, attribute) is not None and getattr(trial, measured) is not None
    ]
    if not pairs:
        return []
    y, x = np.concatenate([pair[0] for pair in pairs]), np.concatenate([pair[1] for pair in pairs])
    deviation = x.std(axis=0)
    moving = (deviation > 1e-6 * max(float(deviation.max()), 1e-12)) & (y.std(axis=0) > 0.0)
    if moving.sum() < 1:
        return []
    names = np.array(log.header.joints)[moving]
    y, x = y[:, moving] - y[:, moving].mean(axis=0), x[:, moving] - x[:, moving].mean(axis=0)
    miss = np.array([[np.sqrt(np.mean((yi - xj) ** 2)) for xj in x.T] for yi in y.T]) / x.std(axis=0)
    own = np.diag(miss)
    rows, order = np.arange(len(miss)), assign_rows(np.minimum(miss, 10.0))
    moved = (rows != order) & (miss[rows, order] < np.minimum(_TRACKS, own / _BETTER))
    if moved.any():
        text = (
            f"{_MEASURED[measured]} of {list_names(tuple(names[moved]))} follow the {what} of "
            f"{list_names(tuple(names[order[moved]]))}: the joints stand in another order in one of them"
        )
        figures = {"own_miss": float(own[moved].max()), "other_miss": float(miss[rows, order][moved].max())}
        return [_finding("command_order", text, figures, tuple(names[moved]))]
    return _sign_and_scale(y, x, own, names, measured, what)


def _sign_and_scale(y: Array, x: Array, own: Array, names: Array, measured: str, what: str) -> list[Finding]:
    slope = (y * x).sum(axis=0) / (x**2).sum(axis=0)
    left = (y - slope * x).std(axis=0) / np.maximum(y.std(axis=0), 1e-300)
    follows = (left < _TRACKS) & (own > _TRACKS)
    found = []
    for kind, chosen, cause in (
        ("command_sign", follows & (slope < 0.0), "the sign of one of them is turned"),
        (
            "command_degrees",
            follows
            & (
                (np.abs(slope * _COMMANDS_DEGREE - 1.0) < 0.3)
                | (np.abs(slope / _COMMANDS_DEGREE - 1.0) < 0.3)
            ),
            "one is in degrees, the other in radians",
        ),
    ):
        if chosen.any():
            joints = tuple(names[chosen])
            text = f"{_MEASURED[measured]} of {list_names(joints)} are {slope[chosen][0]:.3g} times the {what}: {cause}"
            found.append(_finding(kind, text, {"slope": float(slope[chosen][0])}, joints))
    return found


def _finding(kind: str, text: str, figures: dict[str, float], joints: tuple[str, ...]) -> Finding:
    remedy = "correct the columns that are wrong, the measured ones or the commands"
    return Finding(kind, text, figures, joints, severity="limits", remedy=remedy)


# Positions, speeds and torques that the robot's limits do not allow.

_DEGREE = 180.0 / np.pi
# Positions may pass a limit by this share of the range (bent limits, calibration) before anything is said.
_BEYOND = 0.1
_TORQUE_BEYOND = 2.0
# Degrees exceed limits manifold; joints that count turns do so by whole ones.
_MANIFOLD = 3.0
# So near to the slope of the positions are velocities in the same unit.
_SAME = 1.15
_TURN = 2.0 * np.pi


class Degrees(Check):
    """Joints far beyond their limits that are inside them if the numbers are degrees."""

    kinds = ("degrees",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        reach = _Reach.of(robot, log)
        columns = [robot.joint_index(name) for name in log.header.joints]
        turning = np.array([not is_prismatic(robot.model, robot.n_base_v + k) for k in columns])
        inside = (reach.low / _DEGREE >= reach.lower) & (reach.high / _DEGREE <= reach.upper)
        furthest = np.maximum(np.abs(reach.low), np.abs(reach.high))
        manifold = furthest > _MANIFOLD * np.maximum(np.abs(reach.lower), np.abs(reach.upper))
        speed = np.max([_speed(trial) for trial in log.trials], axis=0)
        degrees = (
            turning
            & inside
            & reach.outside
            & (manifold | (speed > _MANIFOLD * robot.limits.velocity[columns]))
        )
        # Most joints in degrees: all are that turn, also those that hardly moved. Else those alone that nothing else
        # explains.
        most = bool(inside[turning].all()) and 2 * degrees.sum() > turning.sum()
        which = turning if most else degrees & manifold & ~reach.counted
        turning_over = speed <= _MANIFOLD * robot.limits.velocity[columns]
        if not which.any() or (turning_over[which].all() and _in_radians_by_others(robot, log, which)):
            return Outcome(log)
        names = tuple(np.array(log.header.joints)[which])
        text = (
            f"positions of {list_names(names)} reach {furthest[which].max():.4g}, far beyond their "
            "limits in radians and "
            "inside them in degrees: they look like degrees"
        )
        finding = Finding(
            "degrees",
            text,
            {"largest": float(furthest[which].max())},
            names,
            severity="spoils",
            repaired=True,
            remedy="they were converted; write radians",
        )
        return Outcome(replace(log, trials=tuple(_in_radians(t, which) for t in log.trials)), (finding,))


def _in_radians_by_others(robot: Robot, log: Log, which: NDArray[np.bool_]) -> bool:
    """Whether torques, or velocities where there are none, say of joints beyond their limits that these turn over."""
    measured = not log.header.free_base and log.header.torque not in {None, "none"}
    samples = torque_samples(robot, log) if measured else None
    if samples is not None:
        reading = Reading.as_stated(log)
        turned = replace(reading, unit=np.where(which, 1.0 / _DEGREE, reading.unit))
        found = samples.judged(reading)
        return found.posterior(samples.judged(turned, found.counts)) < STRONG_ODDS
    compared = velocity_ratios(log)
    return compared is not None and bool(
        (np.abs(np.log(np.maximum(compared[0][which], 1e-9))) < np.log(_SAME)).all()
    )


class Limits(Check):
    """Positions and torques beyond what the model allows, once channels are what the log calls them."""

    kinds = ("beyond_limits", "torque_size")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        reach, found = _Reach.of(robot, log), _torque_size(robot, log)
        # What goes round and round is no joint with limits, whatever the model says.
        round_and_round = reach.high - reach.low > _TURN
        beyond = reach.outside & ~reach.counted & ~round_and_round
        if beyond.any():
            names = tuple(np.array(log.header.joints)[beyond])
            excess = float(np.maximum(reach.lower - reach.low, reach.high - reach.upper)[beyond].max())
            text = (
                f"positions of {list_names(names)} lie {excess:.3g} rad outside the limits: wrong "
                "order of joints, sign or "
                "zero, or limits that are not this robot's"
            )
            finding = Finding(
                "beyond_limits",
                text,
                {"excess_rad": excess},
                names,
                severity="limits",
                remedy="compare the columns with the model, joint by joint",
            )
            found.append(finding)
        return Outcome(log, tuple(found))


@dataclass(frozen=True, eq=False)
class _Reach:
    """How far joints go, and how far they may, each ``(n_joints,)``; limits with a margin."""

    low: Array
    high: Array
    lower: Array
    upper: Array

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Which joints whole turns bring into their limits: an encoder counts on."""
        turns = _TURN * np.round(0.5 * (self.low + self.high - self.lower - self.upper) / _TURN)
        return np.asarray((self.low - turns >= self.lower) & (self.high - turns <= self.upper))

    @classmethod
    def of(cls, robot: Robot, log: Log) -> _Reach:
        columns = [robot.joint_index(name) for name in log.header.joints]
        lower, upper = robot.limits.position_lower[columns], robot.limits.position_upper[columns]
        margin = _BEYOND * (upper - lower)
        low = np.min([trial.q.min(axis=0) for trial in log.trials], axis=0)
        high = np.max([trial.q.max(axis=0) for trial in log.trials], axis=0)
        return cls(low, high, lower - margin, upper + margin)

    @property
    def outside(self) -> NDArray[np.bool_]:
        """Which joints leave their limits."""
        return (self.low < self.lower) | (self.high > self.upper)


def _in_radians(trial: Trial, which: NDArray[np.bool_]) -> Trial:
    """Some joints' positions in radians; commands and velocities too, where they go with them."""
    q = np.where(which, trial.q / _DEGREE, trial.q)

    def like(values: Array | None, reference: Array) -> Array | None:
        """Divided where that brings a column nearer in size."""
        if values is None:
            return None
        sizes = [np.maximum(np.abs(x).max(axis=0), 1e-12) for x in (values, reference)]
        times = sizes[0] / sizes[1]
        return np.where(np.abs(np.log(times / _DEGREE)) < np.abs(np.log(times)), values / _DEGREE, values)

    return replace(
        trial, q=q, q_cmd=like(trial.q_cmd, q), v=like(trial.v, np.gradient(q, trial.time, axis=0))
    )


def _torque_size(robot: Robot, log: Log) -> list[Finding]:
    limit = robot.limits.torque[[robot.joint_index(name) for name in log.header.joints]]
    parts = [np.abs(trial.tau).max(axis=0) for trial in log.trials if trial.tau is not None]
    if not parts:
        return []
    share = np.max(parts, axis=0) / limit
    over = np.isfinite(share) & (share > _TORQUE_BEYOND)
    if not over.any():
        return []
    names = tuple(np.array(log.header.joints)[over])
    text = (
        f"torques of {list_names(names)} reach {share[over].max():.3g} times their limit: "
        "another unit (N·mm, currents), or the gear counted twice"
    )
    return [
        Finding(
            "torque_size",
            text,
            {"share_of_limit": float(share[over].max())},
            names,
            severity="limits",
            remedy="check unit and side of the gear, or the model's limits",
        )
    ]


def _speed(trial: Trial) -> Array:
    """Fastest motion of each joint that noise and single steps do not make, ``(n_joints,)``."""
    rate = 1.0 / float(np.median(np.diff(trial.time)))
    cutoff = min(10.0, 0.2 * rate)
    if trial.n_samples <= settling_samples(rate, cutoff):
        return np.zeros(trial.q.shape[1])
    return np.abs(np.gradient(lowpass(trial.q, rate, cutoff), axis=0) * rate).max(axis=0)
