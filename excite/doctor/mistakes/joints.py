"""Mistakes in joint and base positions: units, direction, order, zeros, clock, gravity, base frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import scipy
from numpy.typing import NDArray

from excite.arrays import Array, assign_rows
from excite.doctor.channel_mapping import BasePose, Reading
from excite.doctor.mistakes.mistake import Correction, Samples
from excite.doctor.torque_samples import TorqueSamples
from excite.doctor.wrench_samples import WrenchSamples
from excite.finding import list_names

# Positions that were logged in degrees or revolutions instead of radians.


def find_degrees(samples: Samples, reading: Reading) -> Iterable[Correction]:
    """Joints turn 57 times further than they can."""
    text = "positions look like degrees; convert them to radians"
    yield from _in_unit(samples, reading, np.pi / 180.0, text)


def find_revolutions(samples: Samples, reading: Reading) -> Iterable[Correction]:
    """Joints turn a sixth as far as their torques say: drives such as moteus and ODrive count turns."""
    text = "positions look like revolutions; convert them to radians"
    yield from _in_unit(samples, reading, 2.0 * np.pi, text)


def _in_unit(samples: Samples, reading: Reading, unit: float, text: str) -> Iterable[Correction]:
    """All joints that turn in another unit, where none of them is yet."""
    slides = [samples.slides(joint) for joint in range(len(samples.joints))]
    turning = tuple(name for name, slide in zip(samples.joints, slides, strict=True) if not slide)
    if turning and (reading.unit == 1.0).all():
        yield Correction(reading.in_units(unit, slides), text, turning)


# A base pose that is meant otherwise than the log's format says.


def find_base_frame(samples: WrenchSamples, reading: Reading) -> Iterable[Correction]:
    """Quaternions in another order or of the inverse, positions in millimetres: weights then stand askew."""
    if reading.pose is not BasePose.STATED:
        return
    for pose in BasePose:
        if pose is not BasePose.STATED:
            text = f"the base pose looks otherwise than stated: {pose.value}"
            yield Correction(replace(reading, pose=pose), text, ("base",))


# A clock that runs too fast or too slow.

# Inertias off by some tenths look like a clock off by half as much: less is not told by the torques.
_LEAST = 1.12
_TICKS = np.geomspace(0.1, 10.0, 41)
# A best clock this near to the slowest that is tried asks for a slower one still: inertial forces are not there at all.
_NEVER = 0.9 * _TICKS[-1]


def find_clock(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """Weights do not know the clock, inertial forces do: they grow with its square.

    Torques that lack inertial forces, or have too many, need not be a clock's: commands of gravity compensation and
    wrong inertias look alike. So the clock is put right where a second witness, the rate that the log states, says the
    same; where none does, or logged velocities agree with the stamps, it is asked for.
    """
    # Without weight nothing stays while the clock changes.
    if reading.tick != 1.0 or reading.weightless:
        return

    by_clock = samples.by_clock(reading)

    def left(log_tick: float) -> float:
        return float(by_clock(float(np.exp(log_tick))).sum())

    grid = np.log(_TICKS)
    scores = [left(value) for value in grid]
    k = int(np.argmin(scores))
    # About the stamps' own clock, a step of the grid is what the torques do not tell.
    if k == len(grid) // 2:
        return
    low, high = grid[max(0, k - 1)], grid[min(len(grid) - 1, k + 1)]
    best = float(
        np.exp(
            scipy.optimize.minimize_scalar(
                left, bounds=(low, high), method="bounded", options={"xatol": 0.003}
            ).x
        )
    )
    if 1.0 / _LEAST < best < _LEAST:
        return
    which = "fast" if best < 1.0 else "slow"
    text = f"the clock looks {which}: a second of the stamps is {best:.3g} s by the torques"
    stated = samples.rate_hz / samples.stated_hz
    if 1.0 / _LEAST < best / stated < _LEAST and not samples.speeds:
        text += f", {stated:.4g} s by rate_hz"
        yield Correction(replace(reading, tick=stated), text, ("time",), {"tick": stated})
        return
    ask = (
        f"the stamps are believed; if they are wrong, scale them (scale: {{time: {best:.3g}}} in map.yaml) and "
        "correct rate_hz; if the torques are commands, leave them out (log: {torque: none})"
    )
    but = (
        "logged velocities agree with the stamps, and a controller's commands or wrong lengths look so, too"
        if samples.speeds
        else "nothing but the torques says so, and wrong inertias or lengths or commands look so, too"
    )
    text = f"{text}; {but}"
    if best > _NEVER:
        text = (
            "the torques carry weight alone, and none of the inertial forces of this motion: what moves the robot "
            "is not in them, as where a person guides it by hand, or they are a gravity compensation's commands"
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


# Joints that are turned about altogether: position and torque count the other way.


def find_turned_joints(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """The model's axis and the robot's point opposite ways."""
    for j, joint in enumerate(samples.channels):
        turned = reading.with_position(int(samples.measured[j]), sign=-1.0).with_torque([j], -1.0)
        text = f"{joint} looks turned about: signs of its position and its torque"
        yield Correction(turned, text, (joint,), changes=2)


# Gravity that points elsewhere than the log says: a robot on a wall, under a ceiling, or a sign.

_G = 9.81
# A base that is tilted by less is an effect that a diagnosis measures; a table is not that crooked [rad].
_GRAVITY_LEAST = 0.15
# So near an axis it is along it [rad].
_ALONG = 0.1
_STEPS = (0.4, 0.2, 0.1, 0.05, 0.025)


def find_gravity(samples: Samples, reading: Reading) -> Iterable[Correction]:
    """The direction in which gravity explains the torques best."""
    axes = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]

    by_gravity = samples.by_gravity(reading)

    def best_of(directions: list[Array]) -> tuple[float, Array]:
        scores = by_gravity(_G * np.array(directions)).sum(axis=1)
        best = int(np.argmin(scores))
        return float(scores[best]), directions[best]

    stated = reading.gravity / max(float(np.linalg.norm(reading.gravity)), 1e-12)
    score, best = best_of([stated, *axes])
    for step in _STEPS if best.any() else ():
        found = best_of(_around(best, step))
        if found[0] < score:
            score, best = found
    angle = float(np.arccos(np.clip(best @ stated, -1.0, 1.0)))
    if angle < _GRAVITY_LEAST or not best.any():
        return
    nearest = max(axes, key=lambda axis: float(axis @ best))
    along = float(np.arccos(np.clip(nearest @ best, -1.0, 1.0))) < _ALONG
    if along:
        best = nearest
    x, y, z = (float(value) + 0.0 for value in np.round(_G * best, 12))
    off = f"looks {np.degrees(angle):.0f}° off what" if stated.any() else "is not nought as"
    text = f"gravity {off} the log says: write [{x:.2f}, {y:.2f}, {z:.2f}]"
    figures = {"angle_rad": angle, "x": x, "y": y, "z": z}
    yield Correction(replace(reading, gravity=_G * best), text, ("gravity",), figures, certain=along)


def _around(direction: Array, step: float) -> list[Array]:
    """Directions about one, at an angle [rad]."""
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first = first / np.linalg.norm(first)
    second = np.cross(direction, first)
    turned = [
        np.cos(step) * direction + np.sin(step) * (np.cos(t) * first + np.sin(t) * second)
        for t in np.arange(8) * np.pi / 4
    ]
    return [value / np.linalg.norm(value) for value in turned]


# Columns of one joint under the name of another.

# A further exchange has to bring this much, half the logarithm of the residual's power over all joints.
_LEAST_STEP = 0.15
# Share of its power that friction and inertias some tenths off leave of a torque in its right place, most of the time.
_EXPLAINED = 0.1


def find_torque_order(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """Torques stand under another joint's name, positions do not."""
    order = assign_rows(samples.across(reading))
    moved = np.flatnonzero(order != np.arange(len(order)))
    if not len(moved):
        return
    joints = samples.channels
    # Only columns that belong together: each cycle of the exchange on its own, and all of them.
    cycles = _cycles(order)
    for chosen in {tuple(cycle) for cycle in cycles} | {tuple(sorted(moved.tolist()))}:
        taken = np.arange(len(order))
        taken[list(chosen)] = order[list(chosen)]
        there, holds = (list_names([joints[i] for i in part]) for part in (chosen, taken[list(chosen)]))
        text = f"torques look exchanged: those of {there} fit columns {holds}"
        other = replace(reading, torque_of=reading.torque_of[taken])
        yield Correction(
            other,
            text,
            tuple(joints[i] for i in chosen),
            {"joints": float(len(chosen))},
            changes=max(1, len(chosen) - 1),
        )


def find_order(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
    """Whole joints, or their positions alone, stand under another joint's name."""
    n = len(samples.channels)
    if n != len(samples.joints):
        return
    samples = samples.fewer(n * (n - 1) // 2)
    start = float(samples.left(reading).sum())
    for what, with_torques in (("columns", True), ("positions", False)):
        order = _climbed(samples, reading, start, with_torques=with_torques)
        moved = tuple(samples.joints[i] for i in np.flatnonzero(order != np.arange(n)))
        if not moved:
            continue
        real = ", ".join(samples.joints[i] for i in order)
        text = f"joints look exchanged: the {what} explain the torques far better in the order {real}"
        yield Correction(
            _taken(reading, order, with_torques),
            text,
            moved,
            {"joints": float(len(moved))},
            changes=max(1, len(moved) - 1),
        )


def find_exchanged_positions(samples: Samples, reading: Reading) -> Iterable[Correction]:
    """Two joints' positions stand under each other's name."""
    joints = samples.joints
    for i, j in combinations(range(len(joints)), 2):
        order = _exchanged(reading.position_of, i, j)
        text = f"positions of {joints[i]} and {joints[j]} look exchanged"
        yield Correction(replace(reading, position_of=order), text, (joints[i], joints[j]), {"joints": 2.0})


def _taken(reading: Reading, order: NDArray[np.int64], with_torques: bool) -> Reading:
    torques = reading.torque_of[order] if with_torques else reading.torque_of
    return replace(reading, position_of=reading.position_of[order], torque_of=torques)


def _climbed(
    samples: TorqueSamples, reading: Reading, start: float, *, with_torques: bool
) -> NDArray[np.int64]:
    """The best order that exchanges of two joints lead to, from the order as it is, and reversed where that is better.

    In each round every exchange is tried by itself, and those of different joints that still help are made, the best
    first: a humanoid's hundreds of exchanges are tried a few times, and not once for every exchange that is made.
    """
    same = np.arange(len(samples.joints))
    # What is explained where it stands need not move for another that is explained too.
    unexplained = set(np.flatnonzero(samples.left(reading) > 0.5 * np.log(_EXPLAINED)).tolist())
    pairs = [pair for pair in combinations(range(len(same)), 2) if unexplained & set(pair)]

    def score(order: NDArray[np.int64]) -> float:
        return float(samples.left(_taken(reading, order, with_torques)).sum())

    reverse = same[::-1].copy()
    backwards = score(reverse)
    best = (start, same)
    for beginning in [(start, same)] + ([(backwards, reverse)] if backwards < start else []):
        current = _round(score, pairs, beginning)
        while current[0] < beginning[0]:
            beginning, current = current, _round(score, pairs, current)
        best = min(best, current, key=lambda item: item[0])
    return best[1]


def _round(
    score: Callable[[NDArray[np.int64]], float],
    pairs: Sequence[tuple[int, int]],
    current: tuple[float, NDArray[np.int64]],
) -> tuple[float, NDArray[np.int64]]:
    """Score and order after exchanges of different joints, the best first; as it was where none brings enough."""
    start, order = current
    tried = sorted((score(_exchanged(order, *pair)), pair) for pair in pairs)
    moved: set[int] = set()
    for alone, pair in tried:
        if alone >= start - _LEAST_STEP:
            break
        if moved & set(pair):
            continue
        other = _exchanged(current[1], *pair)
        together = score(other) if moved else alone
        if together < current[0] - _LEAST_STEP:
            current = (together, other)
            moved |= set(pair)
    return current


def _exchanged(order: NDArray[np.int64], i: int, j: int) -> NDArray[np.int64]:
    other = order.copy()
    other[[i, j]] = other[[j, i]]
    return other


def _cycles(order: Array | NDArray[np.int64]) -> list[list[int]]:
    """Sets of places that an order exchanges among themselves."""
    seen: set[int] = set()
    found = []
    for start in range(len(order)):
        cycle, place = [], start
        while place not in seen:
            seen.add(place)
            cycle.append(place)
            place = int(order[place])
        if len(cycle) > 1:
            found.append(sorted(cycle))
    return found


# Joints whose position counts the other way.


def find_position_sign(samples: Samples, reading: Reading) -> Iterable[Correction]:
    """A joint's position has its sign turned, its torque has not."""
    for j, joint in enumerate(samples.joints):
        text = f"the sign of the position of {joint} looks turned"
        yield Correction(reading.with_position(j, sign=-1.0), text, (joint,))


# Zeros of joint positions that are far from the model's.

# An encoder that is off by less is an effect that a diagnosis measures; that much no calibration leaves [rad].
_ZERO_POSITION_LEAST = 0.15
_STEP = np.pi / 12
# Controllers and models place their zeros along different links: quarter turns apart. So near it is one [rad].
_QUARTER, _NEAR_QUARTER = 0.5 * np.pi, 0.12
# Two zeros can be off at once and one alone bring nothing: joints this far apart are tried together.
_TOGETHER = 2
# What a coarse step has to bring before it is refined, half the logarithm of the residual's power over all joints.
_PROMISES = 0.2
# Zeros whose quarter turns change it by less are in no torque at all, but for rounding.
_QUARTERS, _FELT = np.array([0.0, 1.0, 2.0, 3.0]) * _QUARTER, 1e-6


def find_zeros(samples: Samples, reading: Reading, *, together: int = _TOGETHER) -> Iterable[Correction]:
    """Gravity, and what joints do to each other, tell where a joint really is.

    Args:
        samples: samples of the log.
        reading: the reading so far.
        together: joints at most so far apart along the chain are tried in pairs, too.
    """
    start = float(samples.left(reading).sum())
    turning = [j for j in range(len(samples.joints)) if not samples.slides(j)]
    felt = []
    for j in turning:
        by_zero = samples.by_zero(reading, j)
        found = _best_zero(samples, reading, j, start, by_zero)
        if found is not None:
            yield found
        # What an upright first axis turns to from is in no torque: as one of two its zero would come for nothing.
        if np.ptp(by_zero(_QUARTERS).sum(axis=1)) > _FELT:
            felt.append(j)
    for j, k in ((j, k) for j in felt for k in felt if 0 < k - j <= together):
        for a, b in product((1, -1, 2), repeat=2):
            moved = reading.with_position(j, zero=a * _QUARTER).with_position(k, zero=b * _QUARTER)
            yield _moved_zeros(samples, moved, {j: a * _QUARTER, k: b * _QUARTER})


def _best_zero(
    samples: Samples, reading: Reading, joint: int, start: float, by_zero: Callable[[Array], Array]
) -> Correction | None:
    def left(angle: float) -> float:
        return float(by_zero(np.array([angle])).sum())

    angles = np.asarray(np.arange(-11, 13) * _STEP, dtype=float)
    scores = by_zero(angles).sum(axis=1)
    best = float(angles[int(np.argmin(scores))])
    if start - scores.min() < _PROMISES or abs(best) < 0.5 * _STEP:
        return None
    best = float(
        scipy.optimize.minimize_scalar(
            left, bounds=(best - _STEP, best + _STEP), method="bounded", options={"xatol": 0.01}
        ).x
    )
    quarter = _QUARTER * round(best / _QUARTER)
    if quarter and abs(best - quarter) < _NEAR_QUARTER:
        best = quarter
    if abs(best) < _ZERO_POSITION_LEAST:
        return None
    return _moved_zeros(samples, reading.with_position(joint, zero=best), {joint: best})


def _moved_zeros(samples: Samples, reading: Reading, added: dict[int, float]) -> Correction:
    places = tuple(samples.joints[j] for j in added)
    exact = all(abs(angle / _QUARTER - round(angle / _QUARTER)) < 1e-9 for angle in added.values())
    moved = ", ".join(f"{np.degrees(angle):+.0f}° to {samples.joints[j]}" for j, angle in added.items())
    off = "quarter turns off" if exact else "off"
    text = f"zeros of positions look {off} the model's: add {moved}"
    figures = {f"add_{samples.joints[j]}_rad": float(angle) for j, angle in added.items()}
    return Correction(reading, text, places, figures, changes=len(added), certain=exact)
