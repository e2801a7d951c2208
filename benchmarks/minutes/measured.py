"""Plans for minutes at the robot beside the best three motions of every joint: seconds for targets, D-efficiency."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from excite.campaign.candidates import Rule, choose_motions
from excite.campaign.plan import Plan, plan
from excite.errors import InputError
from excite.excitation.design_rows import ArmRows, can_design
from excite.excitation.selection import TARGETS
from excite.excitation.state_bound import bound_log_det, d_efficiency
from excite.progress import silent
from excite.regressor.base_parameters import structural_base_parameters
from excite.robot.catalogue import example_robot_data
from excite.robot.init_robot.files import write_scaffold
from excite.robot.loading import load_robot
from excite.robot.robot import Robot

# Seconds at the robot that are asked for: bars of the UR10 and of robots that stand, of others what meets most targets.
SECONDS = {
    "ur10": 22.0,
    "panda": 26.0,
    "iiwa14": 53.0,
    "g1": 80.0,
    **dict.fromkeys(("go2", "solo12", "g1_no_ft", "talos", "hrp2like"), 120.0),
}
# What the best three of every joint reach in this time is what a plan for minutes is to reach [s].
TODAY = 300.0
# Of robots that do not come with excite: their models in example-robot-data.
_MODELS = {"solo12": "solo_description/robots/solo12.urdf"}


@lru_cache(maxsize=1)
def measured_robot(name: str) -> Robot:
    """A robot that comes with excite, or the first description of a model."""
    if name not in _MODELS:
        return load_robot(name)
    with tempfile.TemporaryDirectory() as folder:
        model = example_robot_data() / _MODELS[name]
        return load_robot(write_scaffold(model, Path(folder), absolute=True).description)


@dataclass(frozen=True)
class Measured:
    """What a plan promises.

    Attributes:
        robot: its name.
        seed: of the plan.
        motions: ``minutes``, or ``best_three`` of every joint.
        seconds: of the chosen motions [s].
        targets: base parameters whose value in the model counts.
        met: of them those that are predicted within 15 %.
        seconds_for_all: of motion like this until all are [s]; infinite where it says nothing of one.
        today: of them those that 300 s of the best three reach.
        seconds_for_today: until all of those are [s].
        seconds_for_as_many: until as many are [s].
        d_efficiency: against the bound over states; None of robots without one.
        wall_s: time that planning took [s].
        processor_s: processor time of this process [s].
    """

    robot: str
    seed: int
    motions: str
    seconds: float
    targets: int
    met: int
    seconds_for_all: float
    today: int
    seconds_for_today: float
    seconds_for_as_many: float
    d_efficiency: float | None
    wall_s: float
    processor_s: float

    def row(self) -> dict[str, Any]:
        """For a table."""
        return asdict(self)


def measure(
    name: str, seed: int, jobs: int, candidates: int | None = None, seconds: float | None = None
) -> Iterator[Measured]:
    """Rows of one robot and seed; the first is that of the best three of every joint.

    Without ``seconds`` at the robot they are those of its bar.
    """
    robot, budget = measured_robot(name), SECONDS[name] if seconds is None else seconds
    bound = _bound(robot)
    today: set[str] = set()
    best: Plan | None = None
    for kind in ("best_three", "minutes"):
        began, worked = time.perf_counter(), time.process_time()
        if best is None:
            made = best = plan(robot, n_candidates=candidates, seed=seed, jobs=jobs)
        elif can_design(robot):
            count = candidates if robot.floating else None
            made = plan(robot, n_candidates=count, minutes=budget / 60.0, seed=seed, jobs=jobs)
        else:
            made = _chosen_again(best, budget, jobs)
        needed = {name: 60.0 * minutes for name, minutes in made.needed_min.items()}
        today = today or {name for name, seconds in needed.items() if seconds <= TODAY}
        took = time.perf_counter() - began, time.process_time() - worked
        yield Measured(
            robot=name,
            seed=seed,
            motions=kind,
            seconds=made.duration_s,
            targets=len(needed),
            met=sum(seconds <= made.duration_s for seconds in needed.values()),
            seconds_for_all=max(needed.values()),
            today=len(today),
            seconds_for_today=max((needed.get(name, np.inf) for name in today), default=0.0),
            seconds_for_as_many=sorted(needed.values())[len(today) - 1] if today else 0.0,
            d_efficiency=None if bound is None else d_efficiency(ArmRows(robot), list(made.motions), bound),
            wall_s=took[0],
            processor_s=took[1],
        )


def _chosen_again(made: Plan, budget_s: float, jobs: int) -> Plan:
    """What ``minutes`` choose of the motions of a plan without them, where no search designs others."""
    rule = Rule(TARGETS, budget_s, target_rsd=made.target_rsd)
    base = structural_base_parameters(made.robot)
    choice = choose_motions(made.robot, made.pool, base, rule, jobs, silent)
    return replace(made, pool=choice.pool, selection=choice.selection, minutes=budget_s / 60.0)


def _bound(robot: Robot) -> float | None:
    try:
        return bound_log_det(ArmRows(robot))
    except InputError:
        return None
