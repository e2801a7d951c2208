"""Mistakes in joint and base positions: units, direction, order, zeros, clock, gravity, base frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from excite.arrays import Array, Flags, Indices, assign_rows
from excite.doctor.channel_mapping import BasePose, Reading
from excite.doctor.mistakes.torques import parts_in
from excite.doctor.samples import Correction, Samples, minimize_near
from excite.doctor.thresholds import THRESHOLD, is_near_one
from excite.doctor.torque_samples import TorqueSamples
from excite.doctor.wrench_samples import WrenchSamples
from excite.finding import list_names
from excite.robot.quantities import GRAVITY

Order = Indices


def find_unit(samples: Samples, reading: Reading, *, unit: float, name: str) -> Iterable[Correction]:
    """All joints that turn in another unit than radians, where none of them is yet.

    Joints in degrees turn 57 times further than they can, joints in revolutions, which drives such as moteus and ODrive
    count, a sixth as far as their torques say.
    """
    turning = tuple(np.array(samples.joints)[~samples.sliding].tolist())
    if turning and (reading.unit == 1.0).all():
        text = f"positions are probably in {name}; convert them to radians"
        yield Correction(replace(reading, unit=np.where(samples.sliding, 1.0, unit)), text, turning)


def find_revolutions(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """One joint in revolutions, which then goes no further than it may; degrees show by themselves."""
    turn, limits = 2.0 * np.pi, samples.robot.limits
    index = [samples.robot.joint_index(joint) for joint in samples.joints]
    lower, upper = limits.position_lower[index], limits.position_upper[index]
    q, v, _ = samples.motion(reading)
    q = turn * q[:, samples.places + q.shape[1] - v.shape[1]]
    within = (q.min(axis=0) >= lower) & (q.max(axis=0) <= upper) & ~samples.sliding & (reading.unit == 1.0)
    for j in np.flatnonzero(within):
        unit, name = reading.unit.copy(), samples.joints[j]
        unit[j] = turn
        text = f"positions of {name} are probably in revolutions; convert them to radians"
        yield Correction(replace(reading, unit=unit), text, (name,))


_SUMS = [
    0.5 * np.outer([one, other], [1, 1]) * [[1, way], [1, -way]]
    for one, other, way in product((1, -1), repeat=3)
]


def find_differential(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """Two motors turn two neighbours by their sum and difference; their own angles and torques were logged."""
    unexplained = samples.left(reading) > 0.5 * np.log(THRESHOLD.in_place)
    together = (np.diff(samples.measured) == 1) & (unexplained[1:] | unexplained[:-1])
    for j in samples.measured[:-1][together & np.array_equal(reading.joined, np.eye(len(reading.joined)))]:
        names = samples.joints[j : j + 2]
        for sums in _SUMS if not samples.sliding[j : j + 2].any() else ():
            joined = reading.joined.copy()
            joined[j : j + 2, j : j + 2] = sums
            text = f"{list_names(names)} are the two motors of a differential, not its joints: their sum and difference"
            yield Correction(replace(reading, joined=joined), text, names, changes=4)


def find_position_sign(samples: Samples, reading: Reading) -> Iterable[Correction]:
    """A joint's position counts the other way, its torque does not."""
    for j, joint in enumerate(samples.joints):
        text = f"the position of {joint} has the opposite sign"
        yield Correction(reading.with_position(j, sign=-1.0), text, (joint,))


def find_turned_joints(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """The model's axis and the robot's point opposite ways: position and torque count the other way."""
    for j, joint in enumerate(samples.channels):
        turned = reading.with_position(int(samples.measured[j]), sign=-1.0).with_torque([j], -1.0)
        text = (
            f"{joint} counts the other way, or its axis does in the model, as of another robot: its position and its "
            "torque have the opposite sign"
        )
        yield Correction(turned, text, (joint,), changes=2)


def find_base_frame(samples: WrenchSamples, reading: Reading) -> Iterable[Correction]:
    """Quaternions in another order or of the inverse, positions in millimetres: weights then stand askew."""
    for pose in [*BasePose][1:] if reading.pose is BasePose.STATED else ():
        text = f"the base pose is not what the format states: {pose.value}"
        yield Correction(replace(reading, pose=pose), text, ("base",))


# A clock that runs too fast or too slow.

_TICKS = np.linspace(np.log(0.1), np.log(10.0), 41)


def find_clock(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """Weights do not know the clock, inertial forces do: they grow with its square.

    Torques that lack inertial forces, or have too many, need not be a clock's: commands of gravity compensation and
    wrong inertias look alike. So the clock is put right where a second witness, the rate that the log states, says the
    same; where none does, or logged velocities agree with the stamps, it is asked for.
    """
    # Without weight nothing stays while the clock changes.
    if reading.tick != 1.0 or reading.is_compensated:
        return
    if parts_in(samples, reading).lack_weight(THRESHOLD.next_to_nothing):
        return
    by_clock = samples.by_clock(reading)
    k = int(np.argmin(by_clock(np.exp(_TICKS)).sum(axis=1)))
    # About the stamps' own clock, a step of the grid is what the torques do not tell.
    if k == len(_TICKS) // 2:
        return
    # Of an end of the grid the half that lies within.
    low, high = _TICKS[max(0, k - 1)], _TICKS[min(len(_TICKS) - 1, k + 1)]
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    best = float(np.exp(minimize_near(lambda log_tick: by_clock(np.exp(log_tick)), middle, half, 0.003)))
    if is_near_one(best, THRESHOLD.least_clock):
        return
    text = f"the clock is {'fast' if best < 1.0 else 'slow'}: one second of the stamps is {best:.3g} s by the torques"
    stated = samples.rate_hz / samples.stated_hz
    if is_near_one(best / stated, THRESHOLD.least_clock) and not samples.speeds:
        text += f", {stated:.4g} s by rate_hz"
        yield Correction(replace(reading, tick=stated), text, ("time",), {"tick": stated})
        return
    ask = (
        f"the time stamps are used; if they are wrong, scale them (scale: {{time: {best:.3g}}} in map.yaml) and "
        "correct rate_hz; if the torques are commands, leave them out (log: {torque: none})"
    )
    text += (
        "; but logged velocities agree with the stamps, and commands or wrong link lengths have the same effect"
        if samples.speeds
        else "; only the torques show it, and wrong inertias, wrong lengths or commands have the same effect"
    )
    # A best clock this near to the slowest that is tried asks for a slower one still: no inertial forces at all.
    if best > THRESHOLD.no_inertia_clock:
        text = (
            "the torques contain the weight and none of the inertial forces of this motion: something else moves the "
            "robot, as where a person guides it by hand, or they are the commands of a gravity compensation"
        )
        ask = (
            "record motion under the robot's own controller, with measured torques; if these are commands, leave "
            "them out (log: {torque: none})"
        )
    yield Correction(
        replace(reading, tick=best),
        text,
        ("time",),
        {"tick": best},
        ask=ask,
        as_logged=lambda read: replace(read, tick=1.0),
        certain=False,
    )


# Gravity that points elsewhere than the log says: a robot on a wall, under a ceiling, or a sign.


def find_gravity(samples: Samples, reading: Reading) -> Iterable[Correction]:
    """The direction in which gravity explains the torques best."""
    if reading.is_compensated:
        return
    by_gravity = samples.by_gravity(reading)
    axes = np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None]
    stated = reading.gravity / max(float(np.linalg.norm(reading.gravity)), 1e-12)
    tried, best, least = np.vstack([stated, axes]), stated, np.inf
    for step in (0.4, 0.2, 0.1, 0.05, 0.025, 0.0):
        scores = by_gravity(GRAVITY * tried).sum(axis=1)
        if scores.min() < least:
            best, least = tried[int(np.argmin(scores))], float(scores.min())
        if not best.any():
            return
        # Directions about it, at an angle [rad].
        first = np.cross(best, np.eye(3)[int(np.argmin(np.abs(best)))])
        across = np.array([first / np.linalg.norm(first), np.cross(best, first / np.linalg.norm(first))])
        turn = np.arange(8) * np.pi / 4
        tried = np.cos(step) * best + np.sin(step) * np.column_stack([np.cos(turn), np.sin(turn)]) @ across
    angle = _angle_between(best, stated)
    if angle < THRESHOLD.least_tilt_rad:
        return
    nearest = max(axes, key=lambda axis: float(axis @ best))
    along = _angle_between(nearest, best) < THRESHOLD.along_axis_rad
    best = nearest if along else best
    x, y, z = (float(value) + 0.0 for value in np.round(GRAVITY * best, 12))
    off = f"is {np.degrees(angle):.0f}° off what" if stated.any() else "is not zero as"
    text = f"gravity {off} the log says: write [{x:.2f}, {y:.2f}, {z:.2f}]"
    figures = {"angle_rad": angle, "x": x, "y": y, "z": z}
    yield Correction(replace(reading, gravity=GRAVITY * best), text, ("gravity",), figures, certain=along)


def _angle_between(one: Array, other: Array) -> float:
    return float(np.arccos(np.clip(one @ other, -1.0, 1.0)))


def find_torque_order(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """Torques stand under another joint's name, positions do not."""
    order, joints = np.asarray(assign_rows(samples.across(reading))), samples.channels
    moved = tuple(np.flatnonzero(order != np.arange(len(order))).tolist())
    # Only columns that belong together: each cycle of the exchange on its own, and all of them.
    for chosen in {_cycle(order, start) for start in moved} | ({moved} if moved else set()):
        taken = np.arange(len(order))
        taken[list(chosen)] = order[list(chosen)]
        there, holds = (list_names([joints[i] for i in part]) for part in (chosen, taken[list(chosen)]))
        yield Correction(
            replace(reading, torque_of=reading.torque_of[taken]),
            f"torques are exchanged: those of {there} are in the columns of {holds}",
            tuple(joints[i] for i in chosen),
            {"joints": float(len(chosen))},
            changes=len(chosen) - 1,
        )


def _cycle(order: Order, start: int) -> tuple[int, ...]:
    """Places that an order exchanges among themselves, from one of them."""
    cycle = [start]
    while int(order[cycle[-1]]) != start:
        cycle.append(int(order[cycle[-1]]))
    return tuple(sorted(cycle))


def find_order(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """Whole joints, or their positions alone, stand under another joint's name."""
    n, joints = len(samples.channels), samples.joints
    if n != len(joints):
        return
    some = samples.thin_out(n * (n - 1) // 2)
    for what, with_torques in (("columns", True), ("positions", False)):

        def taken(order: Order, both: bool = with_torques) -> Reading:
            torques = reading.torque_of[order] if both else reading.torque_of
            return replace(reading, position_of=reading.position_of[order], torque_of=torques)

        order = _best_order(some, taken)
        moved = tuple(joints[i] for i in np.flatnonzero(order != np.arange(n)))
        if moved:
            real = ", ".join(joints[i] for i in order)
            text = f"joints are exchanged: the {what} explain the torques far better in the order {real}"
            figures = {"joints": float(len(moved))}
            yield Correction(taken(order), text, moved, figures, changes=len(moved) - 1)


def _best_order(samples: TorqueSamples, taken: Callable[[Order], Reading]) -> Order:
    """The best order that exchanges of two joints lead to, from the order as it is, and reversed where that is better.

    In each round every exchange is tried by itself, and those of different joints that still help are made, the best
    first: a humanoid's hundreds of exchanges are tried a few times, and not once for every exchange that is made.
    """
    same = np.arange(len(samples.joints))
    # What is explained where it stands need not move for another that is explained too.
    unexplained = set(np.flatnonzero(samples.left(taken(same)) > 0.5 * np.log(THRESHOLD.in_place)).tolist())
    pairs = [pair for pair in combinations(range(len(same)), 2) if unexplained & set(pair)]

    def score(order: Order) -> float:
        return float(samples.left(taken(order)).sum())

    def improve(start: float, order: Order) -> tuple[float, Order]:
        left, moved = start, set[int]()
        for alone, pair in sorted((score(exchange_places(order, *pair)), pair) for pair in pairs):
            if alone < start - THRESHOLD.least_exchange and not moved & set(pair):
                other = exchange_places(order, *pair)
                together = score(other) if moved else alone
                if together < left - THRESHOLD.least_exchange:
                    left, order = together, other
                    moved |= set(pair)
        return left, order

    first = score(same)
    best = (first, same)
    for order in (same, same[::-1].copy()):
        found, before = (score(order), order), np.inf
        while found[0] <= first and found[0] < before:
            before, found = found[0], improve(*found)
        best = min(best, found, key=lambda item: item[0])
    return best[1]


def find_exchanged_positions(samples: Samples, reading: Reading) -> Iterable[Correction]:
    """Two joints' positions stand under each other's name."""
    for i, j in combinations(range(len(samples.joints)), 2):
        names = (samples.joints[i], samples.joints[j])
        other = replace(reading, position_of=exchange_places(reading.position_of, i, j))
        text = f"positions of {names[0]} and {names[1]} are exchanged"
        yield Correction(other, text, names, {"joints": 2.0})


def exchange_places(order: Order, i: int, j: int) -> Order:
    """An order in which two exchange their places."""
    other = order.copy()
    other[[i, j]] = other[[j, i]]
    return other


# Zeros of joint positions that are far from the model's. Controllers and models place their zeros along different
# links: quarter turns apart.

_QUARTER = 0.5 * np.pi
_QUARTERS = np.array([0.0, 0.5, 1.0, 1.5]) * np.pi
_COARSE = np.pi / 12


def find_zeros(samples: Samples, reading: Reading, *, together: int = 2) -> Iterable[Correction]:
    """Gravity, and what joints do to each other, tell where a joint really is.

    Args:
        samples: samples of the log.
        reading: the reading so far.
        together: joints at most so far apart along the chain are tried in pairs, too: two zeros can be off at once and
            one alone bring nothing.
    """
    start = float(samples.left(reading).sum())
    felt = []
    for j in np.flatnonzero(~samples.sliding).tolist():
        by_zero = samples.by_zero(reading, j)
        best = _best_zero(by_zero, start)
        if best is not None:
            yield _move_zeros(samples, reading, {j: best})
        # What an upright first axis turns to from is in no torque: as one of two its zero would come for nothing.
        if np.ptp(by_zero(_QUARTERS).sum(axis=1)) > THRESHOLD.felt_quarter:
            felt.append(j)
    for j, k in ((j, k) for j in felt for k in felt if 0 < k - j <= together):
        for a, b in product((1, -1, 2), repeat=2):
            yield _move_zeros(samples, reading, {j: a * _QUARTER, k: b * _QUARTER})


def _best_zero(by_zero: Callable[[Array], Array], start: float) -> float | None:
    """The angle that is to be added to a joint's zero [rad]; None where none brings enough."""
    angles = np.asarray(np.arange(-11, 13) * _COARSE, dtype=float)
    scores = by_zero(angles).sum(axis=1)
    best = float(angles[int(np.argmin(scores))])
    if start - scores.min() < THRESHOLD.promising_zero or abs(best) < 0.5 * _COARSE:
        return None
    best = minimize_near(by_zero, best, _COARSE, 0.01)
    quarter = _QUARTER * round(best / _QUARTER)
    if quarter and abs(best - quarter) < THRESHOLD.near_quarter_rad:
        return quarter
    return best if abs(best) >= THRESHOLD.least_zero_rad else None


def zeros_together(samples: Samples, reading: Reading, off: Flags, std: Array) -> Correction:
    """Zeros of some joints that were fitted together, with their standard deviations; asked for where these are wide.

    Args:
        samples: samples of the log.
        reading: with the zeros.
        off: ``(n_joints,)`` joints whose zeros are off, ``std`` how well these are known [rad].
    """
    names, sizes, within = np.array(samples.joints)[off].tolist(), reading.zero[off], std[off]
    degrees = zip(names, np.degrees(sizes), np.degrees(within), strict=True)
    moved = ", ".join(f"{size:+.0f}° ± {wide:.1g}° to {joint}" for joint, size, wide in degrees)
    figures = {f"add_{joint}_rad": float(size) for joint, size in zip(names, sizes, strict=True)}
    figures |= {f"std_{joint}_rad": float(wide) for joint, wide in zip(names, within, strict=True)}
    ask = (
        "the torques do not determine how far which zero is off: put the robot in a posture that is known, compare "
        "its logged positions with the model's, and state the differences (offset: {q.JOINT: …} in map.yaml)"
    )
    return Correction(
        reading,
        f"zeros of positions are off the model's: add {moved}",
        tuple(names),
        figures,
        changes=len(names),
        certain=False,
        ask=ask if within.max() > THRESHOLD.least_zero_rad else "",
        as_logged=lambda read: replace(read, zero=np.where(off, 0.0, read.zero)),
    )


def _move_zeros(samples: Samples, reading: Reading, added: Mapping[int, float]) -> Correction:
    names = {samples.joints[j]: angle for j, angle in added.items()}
    exact = all(abs(angle / _QUARTER - round(angle / _QUARTER)) < 1e-9 for angle in added.values())
    moved = ", ".join(f"{np.degrees(angle):+.0f}° to {joint}" for joint, angle in names.items())
    off = "quarter turns off" if exact else "off"
    text = f"zeros of positions are {off} the model's: add {moved}"
    figures = {f"add_{joint}_rad": float(angle) for joint, angle in names.items()}
    for j, angle in added.items():
        reading = reading.with_position(j, zero=angle)
    return Correction(reading, text, tuple(names), figures, changes=len(added), certain=exact)
