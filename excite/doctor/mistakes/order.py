"""Columns of one joint under the name of another."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, assign_rows
from excite.doctor.mistakes.mistake import Correction, Mistake, Samples
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples
from excite.finding import list_names

# A further exchange has to bring this much, half the logarithm of the residual's power over all joints.
_LEAST_STEP = 0.15
# Share of its power that friction and inertias some tenths off leave of a torque in its right place, most of the time.
_EXPLAINED = 0.1


class TorqueOrder(Mistake[TorqueSamples]):
    """Torques stand under another joint's name, positions do not."""

    name = "torque_order"

    def corrections(self, samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
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
                self.name,
                other,
                text,
                tuple(joints[i] for i in chosen),
                {"joints": float(len(chosen))},
                changes=max(1, len(chosen) - 1),
            )


class Order(Mistake[TorqueSamples]):
    """Whole joints, or their positions alone, stand under another joint's name."""

    name = "order"

    def corrections(self, samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
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
                self.name,
                _taken(reading, order, with_torques),
                text,
                moved,
                {"joints": float(len(moved))},
                changes=max(1, len(moved) - 1),
            )


class PositionOrder(Mistake[Samples]):
    """Two joints' positions stand under each other's name."""

    name = "order"
    of_posture = True

    def corrections(self, samples: Samples, reading: Reading) -> Iterable[Correction]:
        joints = samples.joints
        for i, j in combinations(range(len(joints)), 2):
            order = _exchanged(reading.position_of, i, j)
            text = f"positions of {joints[i]} and {joints[j]} look exchanged"
            yield Correction(
                self.name, replace(reading, position_of=order), text, (joints[i], joints[j]), {"joints": 2.0}
            )


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
