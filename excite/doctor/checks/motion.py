"""Rules for what was moved: standing, seams, steps, joints in unison, too little; limits, units, commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array, Flags, assign_rows
from excite.doctor.case import Case
from excite.doctor.channel_mapping import Reading
from excite.doctor.checks.clock import median_rate, velocity_ratios
from excite.doctor.inertial_prior import STRONG_ODDS
from excite.doctor.thresholds import THRESHOLD, is_near_one
from excite.finding import list_names
from excite.logs.log import Trial
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.logs.signals.resample import without_seams

_TURN = 2.0 * np.pi


def _smooth_velocity(trial: Trial, cutoff_hz: float, settlings: int) -> Array | None:
    """Velocities without the encoders' noise at even times, ``(n, n_joints)``; None for a trial too short to filter."""
    rate = median_rate([trial])
    cutoff = min(cutoff_hz, 0.2 * rate)
    if trial.n_samples <= settlings * settling_samples(rate, cutoff):
        return None
    # Rows may be missing, for long, too.
    time = np.arange(trial.time[0], trial.time[-1], 1.0 / rate)
    even = np.column_stack([np.interp(time, trial.time, q) for q in trial.q.T])
    return np.gradient(lowpass(even, rate, cutoff), 1.0 / rate, axis=0)


def _top_speeds(case: Case) -> Array:
    """Largest speeds of joints in all trials that are long enough, ``(n_joints,)``."""
    speeds = [v for trial in case.log.trials if (v := _smooth_velocity(trial, 10.0, 1)) is not None]
    return np.asarray(np.max([np.abs(v).max(axis=0) for v in speeds], axis=0, initial=0.0))


def find_standing(case: Case) -> None:
    """Trials in which nothing moves: they show gravity, not inertia."""
    still = tuple(trial.name for trial in case.log.trials if not _moves(trial))
    if still and {trial.name for trial in case.log.role("identification")} <= set(still):
        text = "no joint ever moves in the identification trials"
        case.add("nothing_moves", text, {}, ("q",), trials=still)
    elif still:
        text = f"nothing moves in {list_names(still)}: standing trials show only the effect of gravity"
        case.add("standing", text, {"trials": float(len(still))}, trials=still)


def _moves(trial: Trial) -> bool:
    """Whether a joint is faster than standing, and takes more positions than one that trembles in its steps."""
    v = _smooth_velocity(trial, 5.0, 2)
    size = np.ptp(trial.q, axis=0) if v is None else np.abs(v).max(axis=0)
    moving = np.flatnonzero(size > THRESHOLD.still)
    return any(len(np.unique(trial.q[:, j])) > THRESHOLD.trembling_positions for j in moving)


def find_whole_turns(case: Case) -> None:
    """Positions that jump by whole or half turns: an encoder that passed the end of its count, or was read anew."""
    turning, found, limits = np.flatnonzero(case.turning), set[int](), case.robot.limits
    middle = np.nan_to_num(0.5 * (limits.position_lower + limits.position_upper)[case.columns])

    def going_on(trial: Trial) -> Trial:
        """The trial with whole columns, and commands on the turn that their joint is on."""
        whole = {"q": trial.q.copy()} | ({} if trial.q_cmd is None else {"q_cmd": trial.q_cmd.copy()})
        changed = set()
        for values in whole.values():
            for j in turning:
                # In radians, degrees or revolutions; magnets with two pairs of poles look alike after half a turn.
                turns = {_TURN: False, 360.0: False, 1.0: True, np.pi: True, 180.0: True}
                for turn, within in turns.items():
                    column = without_seams(values[:, j], turn, within=within, time=trial.time)
                    if column is not None:
                        # In which half of a turn it begins nothing tells: in that of the middle of its range.
                        away = middle[j] - 0.5 * (column.min() + column.max()) if turn == np.pi else 0.0
                        values[:, j] = column + np.pi * np.round(away / np.pi)
                        changed.add(int(j))
                        break
        for j in changed if "q_cmd" in whole else ():
            apart = np.median(whole["q"][:, j] - whole["q_cmd"][:, j])
            whole["q_cmd"][:, j] += _TURN * np.round(apart / _TURN)
        found.update(changed)
        return replace(trial, **whole) if changed else trial  # type: ignore[arg-type]

    case.change_trials(going_on)
    if found:
        joints = tuple(case.log.header.joints[j] for j in sorted(found))
        text = (
            f"positions of {list_names(joints)} jump by whole or half turns: an encoder's count that overflows, "
            "or angles that are wrapped to a turn"
        )
        case.add("whole_turns", text, {"joints": float(len(joints))}, joints)


def find_jumps(case: Case) -> None:
    """Positions that leap and stand: set points, or a log of steps, from which no acceleration is to be had."""
    changes = [np.abs(np.diff(trial.q, axis=0)) for trial in case.log.trials]
    leapt = np.zeros(len(case.log.header.joints))
    for change in changes:
        beside = np.maximum(change[:-2], change[2:])
        leaps = (change[1:-1] > THRESHOLD.leap * beside) & (change[1:-1] > THRESHOLD.leap_rad)
        leapt += (change[1:-1] * leaps).sum(axis=0)
    share = leapt / np.maximum(np.concatenate(changes).sum(axis=0), 1e-12)
    bad = share > THRESHOLD.leapt_share
    if bad.any():
        names, most = case.joints(bad), float(share.max())
        text = (
            f"positions of {list_names(names)} jump from row to row and stand still between ({100 * most:.0f} % "
            "of their travel): steps instead of motion"
        )
        case.add("steps", text, {"share": most}, names)


def find_unison(case: Case) -> None:
    """Joints that only ever moved together: what tells them apart is not in the log."""
    speeds = [v for trial in case.log.trials if (v := _smooth_velocity(trial, 5.0, 2)) is not None]
    v = np.concatenate(speeds) if speeds else np.zeros((1, len(case.log.header.joints)))
    size = np.sqrt((v**2).mean(axis=0))
    moving = size > THRESHOLD.still
    alike = np.abs(v.T @ v) / len(v) > THRESHOLD.unison * np.outer(size, size)
    pairs = np.triu(alike & np.outer(moving, moving), 1)
    if pairs.any():
        joints = case.joints((pairs | pairs.T).any(axis=0))
        places = [case.robot.model.getJointId(joint) for joint in joints]
        links = {segment.joint: segment.link for segment in reversed(case.robot.segments)}
        moved = [links.get(place, joint) for place, joint in zip(places, joints, strict=True)]
        unknown = [f"{name}({link})" for link in moved for name in ("m·c", "I")]
        text = (
            f"{list_names(joints)} move in unison: their parameters are not identifiable one by one: "
            f"{list_names(unknown, 6)} only in sums"
        )
        case.add("unison", text, {"pairs": float(pairs.sum())}, joints)


def find_too_few_rows(case: Case) -> None:
    """Too few rows for the parameters."""
    chosen = case.log.role("identification")
    seconds = sum(float(trial.time[-1] - trial.time[0]) for trial in chosen)
    channels = 6 if case.robot.floating else len(case.log.header.joints)
    numbers = channels * sum(trial.n_samples for trial in chosen)
    parameters = 10 * len(case.robot.segments)
    needed = THRESHOLD.numbers_per_parameter * parameters
    if chosen and (seconds < THRESHOLD.shortest_s or numbers < needed):
        text = f"{seconds:.1f} s and {numbers} numbers for {parameters} parameters: too few rows"
        case.add("too_few_rows", text, {"seconds": seconds, "numbers": float(numbers)})


# Measured channels beside what was commanded: another joint's, turned, in another unit. Which side is wrong is open.


def find_command_errors(case: Case) -> None:
    """Order, sign and unit of measured positions and torques against their commands."""
    for measured, attribute, what in (("q", "q_cmd", "positions"), ("tau", "tau_cmd", "torques")):
        pairs = [(getattr(trial, measured), getattr(trial, attribute)) for trial in case.log.trials]
        known = [pair for pair in pairs if pair[0] is not None and pair[1] is not None]
        if known:
            y, x = (np.concatenate(side) for side in zip(*known, strict=True))
            _compare_commands(case, y, x, what)


def _compare_commands(case: Case, y: Array, x: Array, what: str) -> None:
    # A column of one number deviates by its rounding.
    moving = (x.std(axis=0) > 1e-6 * np.abs(x).max()) & (np.ptp(y, axis=0) > 0.0)
    if not moving.any():
        return
    names = np.array(case.log.header.joints)[moving]
    y, x = (values[:, moving] - values[:, moving].mean(axis=0) for values in (y, x))
    miss = np.array([[np.sqrt(np.mean((yi - xj) ** 2)) for xj in x.T] for yi in y.T]) / x.std(axis=0)
    own, rows, order = np.diag(miss), np.arange(len(miss)), assign_rows(np.minimum(miss, 10.0))
    best = miss[rows, order]
    moved = (rows != order) & (best < np.minimum(THRESHOLD.tracks, own / THRESHOLD.better_order))
    if moved.any():
        text = (
            f"{what} of {list_names(tuple(names[moved]))} follow the commanded {what} of "
            f"{list_names(tuple(names[order[moved]]))}: one of them has its joints in another order"
        )
        figures = {"own_miss": float(own[moved].max()), "other_miss": float(best[moved].max())}
        case.add("command_order", text, figures, tuple(names[moved]))
        return
    slope = (y * x).sum(axis=0) / (x**2).sum(axis=0)
    left = (y - slope * x).std(axis=0) / np.maximum(y.std(axis=0), 1e-300)
    follows = (left < THRESHOLD.tracks) & (own > THRESHOLD.tracks)
    degrees = np.minimum(np.abs(np.degrees(slope) - 1.0), np.abs(np.radians(slope) - 1.0)) < 0.3
    for kind, chosen, cause in (
        ("command_sign", follows & (slope < 0.0), "the sign of one of them is turned"),
        ("command_degrees", follows & degrees, "one is in degrees, the other in radians"),
    ):
        if chosen.any():
            joints, factor = tuple(names[chosen]), float(slope[chosen][0])
            text = f"{what} of {list_names(joints)} are {factor:.3g} times the commanded {what}: {cause}"
            case.add(kind, text, {"slope": factor}, joints)


# Positions, speeds and torques that the robot's limits do not allow.


@dataclass(frozen=True, eq=False)
class _Reach:
    """How far joints go, and how far they may, each ``(n_joints,)``; limits with a margin."""

    low: Array
    high: Array
    lower: Array
    upper: Array

    @classmethod
    def of(cls, case: Case, trials: Sequence[Trial]) -> _Reach:
        limits = case.robot.limits
        lower, upper = limits.position_lower[case.columns], limits.position_upper[case.columns]
        # Bent limits and calibration are no fault.
        margin = THRESHOLD.beyond_range * (upper - lower)
        low = np.min([trial.q.min(axis=0) for trial in trials], axis=0)
        high = np.max([trial.q.max(axis=0) for trial in trials], axis=0)
        return cls(low, high, lower - margin, upper + margin)

    @property
    def is_outside(self) -> Flags:
        """Which joints leave their limits."""
        return (self.low < self.lower) | (self.high > self.upper)

    @property
    def is_counted(self) -> Flags:
        """Which joints whole turns bring into their limits: an encoder counts on."""
        turns = _TURN * np.round(0.5 * (self.low + self.high - self.lower - self.upper) / _TURN)
        return np.asarray((self.low - turns >= self.lower) & (self.high - turns <= self.upper))


def find_degrees(case: Case) -> None:
    """Joints far beyond their limits that are inside them if the numbers are degrees."""
    turning = case.turning
    trials = [one for one in case.log.trials if (_Reach.of(case, [one]).is_outside & turning).any()]
    reach = _Reach.of(case, trials or case.log.trials)
    inside = (np.radians(reach.low) >= reach.lower) & (np.radians(reach.high) <= reach.upper)
    furthest = np.maximum(np.abs(reach.low), np.abs(reach.high))
    manifold = furthest > THRESHOLD.manifold * np.maximum(np.abs(reach.lower), np.abs(reach.upper))
    fast = _top_speeds(case) > THRESHOLD.manifold * case.robot.limits.velocity[case.columns]
    degrees = turning & inside & reach.is_outside & (manifold | fast)
    # Most joints in degrees: all are that turn, also those that hardly moved. Else those alone that nothing else
    # explains.
    most = bool(inside[turning].all()) and 2 * degrees.sum() > turning.sum()
    which = turning if most else degrees & manifold & ~reach.is_counted
    if not which.any() or (not fast[which].any() and _turns_over(case, which)):
        return
    names, far = case.joints(which), float(furthest[which].max())
    text = (
        f"positions of {list_names(names)} reach {far:.4g}, far beyond their limits in radians and within them in "
        "degrees: they are probably degrees"
    )
    said = tuple(one.name for one in case.log.trials if not _is_in_radians(case, one, which))
    text += "" if len(said) == len(case.log.trials) else f", in {list_names(said)} alone"
    case.add("degrees", text, {"largest": far}, names, trials=said)
    case.change_trials(lambda trial: _in_radians(trial, which) if trial.name in said else trial)


def _is_in_radians(case: Case, trial: Trial, which: Flags) -> bool:
    """Whether a trial is not in degrees as others of its log are: by its limits, by torques, or else by its size."""
    if (_Reach.of(case, [trial]).is_outside & which).any():
        return False
    alone = Case(case.robot, replace(case.log, trials=(replace(trial, role="identification"),)))
    if alone.samples is not None:
        return _turns_over(alone, which)
    size = [np.sqrt((one.q[:, which] ** 2).mean()) for one in (trial, *case.log.trials)]
    return bool(size[0] < np.sqrt(np.radians(1.0)) * max(size))


def _turns_over(case: Case, which: Flags) -> bool:
    """Whether torques, or velocities where there are none, say of joints beyond their limits that these turn over."""
    if case.samples is not None:
        reading = Reading.as_stated(case.log)
        degrees = replace(reading, unit=np.where(which, np.radians(1.0), reading.unit))
        found = case.samples.judged(reading)
        return found.posterior(case.samples.judged(degrees, found.counts)) < STRONG_ODDS
    compared = velocity_ratios(case.log.trials)
    if compared is None:
        return False
    ratios = np.nan_to_num(compared[0][which], nan=1.0)
    return all(is_near_one(ratio, THRESHOLD.same_velocity) for ratio in ratios)


def _in_radians(trial: Trial, which: Flags) -> Trial:
    """Some joints' positions in radians; commands and velocities too, where that brings them nearer in size."""
    q = np.where(which, np.radians(trial.q), trial.q)

    def like(values: Array | None, reference: Array) -> Array | None:
        if values is None:
            return None
        size, other = (np.maximum(np.abs(x).max(axis=0), 1e-12) for x in (values, reference))
        nearer = np.abs(np.log(np.radians(size / other))) < np.abs(np.log(size / other))
        return np.where(nearer, np.radians(values), values)

    slope = np.gradient(q, trial.time, axis=0)
    return replace(trial, q=q, q_cmd=like(trial.q_cmd, q), v=like(trial.v, slope))


def find_beyond_limits(case: Case) -> None:
    """Positions, speeds and torques beyond what the model allows, once channels are what the log calls them."""
    torques = [np.abs(trial.tau).max(axis=0) for trial in case.log.trials if trial.tau is not None]
    for kind, what, reached, limits, most, cause in (
        (
            "torque_size",
            "torques",
            np.max(torques, axis=0, initial=0.0),
            case.robot.limits.torque,
            THRESHOLD.torque_beyond,
            "another unit (N·mm, currents), or the gear counted twice",
        ),
        (
            "too_fast",
            "speeds",
            _top_speeds(case),
            case.robot.limits.velocity,
            THRESHOLD.fastest_share,
            "another unit, a clock in another one, or limits of another robot",
        ),
    ):
        share = reached / limits[case.columns]
        over = np.isfinite(share) & (share > most)
        if over.any():
            names, largest = case.joints(over), float(share[over].max())
            text = f"{what} of {list_names(names)} reach {largest:.3g} times their limit: {cause}"
            case.add(kind, text, {"share_of_limit": largest}, names)
    reach = _Reach.of(case, case.log.trials)
    # What goes round and round is no joint with limits, whatever the model says.
    beyond = reach.is_outside & ~reach.is_counted & (reach.high - reach.low <= _TURN)
    if beyond.any():
        names = case.joints(beyond)
        excess = float(np.maximum(reach.lower - reach.low, reach.high - reach.upper)[beyond].max())
        text = (
            f"positions of {list_names(names)} lie {excess:.3g} rad outside the limits: wrong joint order, sign or "
            "zero, or limits of another robot"
        )
        case.add("beyond_limits", text, {"excess_rad": excess}, names)
