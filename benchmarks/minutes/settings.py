"""What each setting of the gradient search is worth: one after the other is changed, all else stays."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from excite.excitation.design_rows import ArmRows
from excite.excitation.gradient_design import DesignSettings, design_motions, first_information
from excite.excitation.selection import LogDeterminant
from excite.motion.generators.mixture import plan_proposals
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.filter import filter_candidates

USUAL = DesignSettings()
CHANGES: tuple[dict[str, Any], ...] = (
    {},
    {"knot_s": 0.125},
    {"knot_s": 0.5},
    {"rate_hz": 8.0},
    {"rate_hz": 32.0},
    {"velocity": 0.95},
    {"velocity": 1.0},
    {"acceleration": 0.9},
    {"acceleration": 0.98},
    {"near_m": 0.02},
    {"near_m": 0.12},
    {"extra_m": 0.002},
    {"extra_m": 0.015},
    {"rounds": 3},
    {"rounds": 8},
    {"iterations": 18},
    {"iterations": 72},
    {"coarse": 1.0},
    {"reach": 0.2},
    {"enough": 0.0},
    {"weight": 1.0},
    {"growth": 3.0},
    {"growth": 8.0},
)


@dataclass(frozen=True)
class Gain:
    """What designs with a change gain.

    Attributes:
        robot: its name.
        change: of the settings, in words.
        nats: gain of the log-determinant over the sources', a parameter, mean over pairs of motions.
        undesigned: motions that no step made safe.
        step: mean part of the way to the optimum that is safe.
        processor_s: processor time a motion [s].
    """

    robot: str
    change: str
    nats: float
    undesigned: int
    step: float
    processor_s: float

    def row(self) -> dict[str, Any]:
        """For a table."""
        return asdict(self)


def safe_motions(robot: Robot, seed: int, count: int) -> Sequence[Motion]:
    """Random motions that the filter accepts."""
    proposals = plan_proposals(
        robot, count, np.random.SeedSequence(seed), mix={"random_joint": 1.0}, targets=()
    )
    return filter_candidates(robot, proposals).motions


def compare_settings(robot: Robot, seed: int, pairs: int = 4) -> Iterator[Gain]:
    """Gains by change, each on the same pairs of motions that are run together."""
    rows, sources = ArmRows(robot), safe_motions(robot, seed, 3 * pairs)[: 2 * pairs]
    start = first_information(rows, sources)
    sampled = [motion.resampled(robot, USUAL.rate_hz) for motion in sources]
    own = [rows.information(one.q, one.v, one.a) for one in sampled]
    for change in CHANGES:
        settings = replace(USUAL, **change)
        began, nats, steps = time.process_time(), list[float](), list[float]()
        for i in range(0, len(sources), 2):
            made = design_motions(rows, sources[i : i + 2], start, LogDeterminant(), settings=settings)
            again = [one.motion.resampled(robot, USUAL.rate_hz) for one in made]
            found = sum(rows.information(one.q, one.v, one.a) for one in again)
            plain = own[i] + own[i + 1]
            nats.append(float(np.linalg.slogdet(start + found)[1] - np.linalg.slogdet(start + plain)[1]))
            steps += [one.step for one in made]
        words = ", ".join(f"{name} {value:g}" for name, value in change.items()) or "none"
        yield Gain(
            robot=robot.name,
            change=words,
            nats=float(np.mean(nats)) / len(start),
            undesigned=sum(step == 0.0 for step in steps),
            step=float(np.mean(steps)),
            processor_s=(time.process_time() - began) / len(sources),
        )
