"""Run motions that pass `excite check` in simulation under several conditions, and count what goes wrong."""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

import excite
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.simulation.execution import DivergedError, Machine
from excite.simulation.rehearsal import MODEL, MOST_SLIP_M, leaning_members
from excite.simulation.replay import Replay, watched_run
from excite.simulation.true_parameters import TrueParameters, possible_parameters
from excite.simulation.virtual_robot import VirtualRobot, nominal_robot

ROBOTS = ("g1", "talos", "hrp2like", "go2")
LATE_S = 0.01
FLOOR = 0.6
STEPS_S = (2.5e-3, 1e-3, 5e-4)
"""Steps of the physics, the next where it diverges."""


class Condition(NamedTuple):
    """What differs from the model: the machine, and what it is told to do."""

    name: str
    virtual: VirtualRobot
    commanded: Callable[[Motion], Motion]


def conditions(robot: Robot) -> Iterator[Condition]:
    """The model, the members of its stated set that lean furthest, late commands, a smooth floor."""
    nominal = nominal_robot(robot)
    yield Condition(MODEL, nominal, same)
    for name, phi in leaning_members(robot).items():
        bodies = zip(phi.reshape(-1, 10), robot.segments, strict=True)
        possible = np.concatenate([possible_parameters(own, segment.link) for own, segment in bodies])
        yield Condition(name, replace(nominal, truth=TrueParameters(possible)), same)
    yield Condition(f"commands {1e3 * LATE_S:g} ms late", nominal, late)
    smooth = FLOOR / max(foot.friction for foot in robot.feet)
    yield Condition(
        f"friction {FLOOR:g}",
        replace(nominal, world=replace(nominal.world, sole_friction=min(1.0, smooth))),
        same,
    )


def same(motion: Motion) -> Motion:
    """The motion as it is."""
    return motion


def late(motion: Motion) -> Motion:
    """The motion with its joints late; base and contacts, by which it is judged, stay when they were planned."""
    n_q, n_v = motion.q.shape[1] - len(motion.joint_names), motion.v.shape[1] - len(motion.joint_names)
    parts = [motion.q.copy(), motion.v.copy(), motion.a.copy()]
    for part, first in zip(parts, (n_q, n_v, n_v), strict=True):
        for column in part.T[first:]:
            column[:] = np.interp(motion.time - LATE_S, motion.time, column)
    return replace(motion, q=parts[0], v=parts[1], a=parts[2])


def run(condition: Condition, motion: Motion, machines: dict[tuple[str, float], Machine]) -> Replay | None:
    """What became of a motion; None where the simulation diverges in all steps."""
    virtual = condition.virtual
    for step in STEPS_S:
        key = (condition.name, step)
        if key not in machines:
            world = replace(virtual.world, timestep=step)
            machines[key] = Machine(replace(virtual, world=world), watch=True)
        try:
            return watched_run(
                virtual, condition.commanded(motion), may_slip_m=MOST_SLIP_M, forces=False,
                machine=machines[key],
            ).replay  # fmt: skip
        except DivergedError:
            continue
    return None


def outcome(replay: Replay | None) -> str:
    """``fell``, ``touched``, ``slipped`` by more than 10 mm, or ``stood``."""
    if replay is None or replay.fell:
        return "fell"
    if replay.self_collided:
        return "touched"
    return "slipped" if replay.max_slip_m > MOST_SLIP_M else "stood"


def motions_of(
    name: str, library: Path, candidates: int, seed: int, generator: str | None
) -> tuple[Robot, list[Motion]]:
    """Motions of a robot that pass the check: those of the library and of a fresh plan, or of one generator alone."""
    robot = excite.load_robot(name)
    motions = [] if generator else list(excite.load_motions(library / name / "motions", robot))
    if candidates:
        motions += excite.plan(robot, n_candidates=candidates, seed=seed, generator=generator).motions
    report = excite.check(robot, motions)
    safe = {verdict.motion for verdict in report.verdicts if verdict.safe}
    return robot, [motion for motion in motions if motion.name in safe]


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rehearsal", description=__doc__)
    parser.add_argument("--robot", action="append", choices=ROBOTS)
    parser.add_argument("--candidates", type=int, default=12, help="of the fresh plan of each robot")
    parser.add_argument("--generator", help="of the fresh plan, without the library")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=10.0, help="after which no other motion is begun")
    parser.add_argument("--library", type=Path, default=Path("motion_library"))
    parser.add_argument("--out", type=Path, help="file for the table")
    given = parser.parse_args()
    until = time.monotonic() + 60.0 * given.minutes
    lines = ["| robot | condition | runs | fell | touched | slipped | which |", "| --- | " + "--- | " * 6]
    print("\n".join(lines), flush=True)
    wrong = total = 0
    names = given.robot or ROBOTS
    for place, name in enumerate(names):
        robot, motions = motions_of(name, given.library, given.candidates, given.seed, given.generator)
        machines: dict[tuple[str, float], Machine] = {}
        counts: dict[str, Counter[str]] = {one.name: Counter() for one in conditions(robot)}
        which: dict[str, list[str]] = {one: [] for one in counts}
        # Each robot has an equal share of what is left, so that a short run is one of all of them.
        end = time.monotonic() + (until - time.monotonic()) / (len(names) - place)
        for motion in motions:
            if time.monotonic() > end:
                break
            for condition in conditions(robot):
                found = outcome(run(condition, motion, machines))
                counts[condition.name][found] += 1
                if found != "stood":
                    which[condition.name].append(f"{motion.name} {found}")
        for condition_name, count in counts.items():
            runs = sum(count.values())
            wrong, total = wrong + runs - count["stood"], total + runs
            cells = [name, condition_name, runs, count["fell"], count["touched"], count["slipped"]]
            lines.append("| " + " | ".join(map(str, [*cells, ", ".join(which[condition_name])])) + " |")
            print(lines[-1], flush=True)
    print(f"{wrong} of {total} runs went wrong", flush=True)
    if given.out is not None:
        given.out.write_text("\n".join([*lines, "", f"{wrong} of {total} runs went wrong.", ""]))


if __name__ == "__main__":
    main()
